"""Pictures of a sweep over one or two axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from vctune.analysis.extrema import Floats
from vctune.document.schema.number_units import heading
from vctune.report.style import BLUE, RED, STYLE, canvas
from vctune.study.study_table import Table

WIDE = 10.0  # Errors that span more than this ratio are coloured by their logarithm
COLOURS = "viridis_r"
FEW = 40  # Greatest number of points with large markers


def sweep_figure(table: Table, *, grid: bool) -> Figure | None:
    """Return the figure of the error over the axes that vary; None unless one or two axes vary."""
    finite = np.logical_and.reduce([np.isfinite(column) for column in table.axes.values()])
    table = table.subset(np.flatnonzero(finite))
    varied = {key: column for key, column in table.axes.items() if np.unique(column).size > 1}
    with rc_context(STYLE):
        if len(varied) == 1:
            return _line(table, *varied.items())
        if len(varied) == 2:
            return _map(table, *varied.items(), grid=grid)
    return None


def _line(table: Table, axis: tuple[str, Floats]) -> Figure:
    figure, axes = _frame()
    key, x = axis
    order, certified = np.argsort(x, kind="stable"), table.certified
    error = np.where(certified, table.numbers["error"], np.nan)[order]
    axes.plot(x[order], error, "o-", color=BLUE, markersize=4 if x.size <= FEW else 1.5, label="certified")
    if not certified.all():
        floor, at_floor = np.zeros(np.count_nonzero(~certified)), axes.get_xaxis_transform()
        axes.plot(x[~certified], floor, "x", color=RED, transform=at_floor, clip_on=False, label="no certified design")
    _ring_idle(axes, table, x, table.numbers["error"])
    _scale(axes, "x", x)
    axes.set(xlabel=_heading(table, key), ylabel="transparency error")
    axes.legend(loc="best")
    return figure


def _map(table: Table, across: tuple[str, Floats], up: tuple[str, Floats], *, grid: bool) -> Figure:
    figure, axes = _frame()
    (x_key, x), (y_key, y) = across, up
    certified = table.certified
    error = np.where(certified, table.numbers["error"], np.nan)
    norm = LogNorm() if _wide(error[certified]) else None
    if grid:
        columns, i = np.unique(x, return_inverse=True)
        rows, j = np.unique(y, return_inverse=True)
        cells = np.full((rows.size, columns.size), np.nan)
        cells[j, i] = error
        drawn: Any = axes.pcolormesh(
            columns, rows, np.ma.masked_invalid(cells), cmap=COLOURS, norm=norm, rasterized=True
        )
    else:
        drawn = axes.scatter(x[certified], y[certified], c=error[certified], cmap=COLOURS, norm=norm, s=18)
    if certified.any():
        figure.colorbar(drawn, label="transparency error")
    if not certified.all():
        axes.plot(x[~certified], y[~certified], "x", color=RED, markersize=4, label="no certified design")
    _ring_idle(axes, table, x, y)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    _scale(axes, "x", x)
    _scale(axes, "y", y)
    axes.set(xlabel=_heading(table, x_key), ylabel=_heading(table, y_key))
    axes.grid(visible=not grid)
    return figure


def _ring_idle(axes: Axes, table: Table, x: Floats, y: Floats) -> None:
    """Draw rings around the designs whose velocity loop has hardly any effect."""
    at, label = table.idle, "idle: the loop hardly works"
    if at.any():
        axes.plot(x[at], y[at], "o", markersize=9, markerfacecolor="none", markeredgecolor=RED, label=label)


def _frame() -> tuple[Figure, Axes]:
    figure = canvas(8, 5, right=0.3, top=0.45)
    return figure, figure.subplots()


def _heading(table: Table, key: str) -> str:
    return heading(key, table.units.get(key, ""))


def _scale(axes: Axes, which: str, values: Floats) -> None:
    """Space an axis as its points are: on a logarithmic scale if their ratios are more even than their differences."""
    steps = np.unique(values)
    if steps[0] > 0 and _uneven(np.log(steps)) < _uneven(steps):
        (axes.set_xscale if which == "x" else axes.set_yscale)("log")


def _uneven(values: Floats) -> float:
    steps = np.diff(values)
    return float(steps.std() / steps.mean())


def _wide(values: Floats) -> bool:
    return bool(values.size and values.min() > 0 and values.max() > WIDE * values.min())
