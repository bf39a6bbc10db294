"""Pictures of a sweep over one or two axes."""

from __future__ import annotations

from collections.abc import Callable
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
    varied = {key: column[finite] for key, column in table.axes.items() if np.unique(column[finite]).size > 1}
    if len(varied) not in (1, 2):
        return None
    certified, idle = table.certified[finite], table.idle[finite]
    error = np.where(certified, table.numbers["error"][finite], np.nan)
    labels = [heading(key, table.units.get(key, "")) for key in varied]
    with rc_context(STYLE):
        figure = canvas(8, 5, right=0.3, top=0.45)
        axes = figure.subplots()
        if len(varied) == 1:
            (x,) = varied.values()
            y, none, labels = error, np.zeros(np.count_nonzero(~certified)), [*labels, "transparency error"]
            floor = axes.get_xaxis_transform()
            _line(axes, x, error)
        else:
            x, y = varied.values()
            none, floor = y[~certified], axes.transData
            _map(figure, axes, (x, y), error, grid=grid)
        if not certified.all():
            axes.plot(
                x[~certified], none, "x", color=RED, markersize=4, transform=floor, clip_on=False,
                label="no certified design",
            )  # fmt: skip
        if idle.any():  # designs whose velocity loop has hardly any effect
            ring: Any = {"markersize": 9, "markerfacecolor": "none", "markeredgecolor": RED}
            axes.plot(x[idle], y[idle], "o", label="idle: the loop hardly works", **ring)
        for values, spaced in zip(varied.values(), (axes.set_xscale, axes.set_yscale), strict=False):
            _space(values, spaced)
        axes.set(xlabel=labels[0], ylabel=labels[1])
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure


def _line(axes: Axes, x: Floats, error: Floats) -> None:
    order = np.argsort(x, kind="stable")
    size = 4 if x.size <= FEW else 1.5
    axes.plot(x[order], error[order], "o-", color=BLUE, markersize=size, label="certified")


def _map(figure: Figure, axes: Axes, places: tuple[Floats, Floats], error: Floats, *, grid: bool) -> None:
    """Colour the cells of a grid, or points, by the error."""
    found = error[np.isfinite(error)]
    wide = found.size and found.min() > 0 and found.max() > WIDE * found.min()
    colours: Any = {"cmap": COLOURS, "norm": LogNorm() if wide else None}
    if grid:
        (columns, i), (rows, j) = (np.unique(each, return_inverse=True) for each in places)
        cells = np.full((rows.size, columns.size), np.nan)
        cells[j, i] = error
        drawn: Any = axes.pcolormesh(columns, rows, np.ma.masked_invalid(cells), rasterized=True, **colours)
        axes.grid(visible=False)
    else:
        x, y = (each[np.isfinite(error)] for each in places)
        drawn = axes.scatter(x, y, c=found, s=18, **colours)
    if found.size:
        figure.colorbar(drawn, label="transparency error")


def _space(values: Floats, spaced: Callable[[str], None]) -> None:
    """Space an axis as its points are: on a logarithmic scale if their ratios are more even than their differences."""
    steps = np.unique(values)
    if steps[0] > 0 and _uneven(np.log(steps)) < _uneven(steps):
        spaced("log")


def _uneven(values: Floats) -> float:
    steps = np.diff(values)
    return float(steps.std() / steps.mean())
