"""Pictures of a sweep over one or two axes."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from vctune.analysis.extrema import Floats
from vctune.document.schema.number_units import heading
from vctune.report.style import BLUE, RED, STYLE
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
    labels = [*(heading(key, table.units.get(key, "")) for key in varied), "transparency error"]
    with rc_context(STYLE):
        figure = Figure(figsize=(8, 5))
        axes = figure.subplots()
        x, *others = varied.values()
        if others:
            y, none, floor = others[0], others[0], axes.transData
            _map(figure, axes, (x, y), error, grid=grid)
        else:
            y, none, floor = error, np.zeros_like(x), axes.get_xaxis_transform()
            order, size = np.argsort(x, kind="stable"), 4 if x.size <= FEW else 1.5
            axes.plot(x[order], error[order], "o-", color=BLUE, markersize=size, label="certified")
        if not certified.all():
            without: Any = {"transform": floor, "clip_on": False, "label": "no certified design"}
            axes.plot(x[~certified], none[~certified], "x", color=RED, markersize=4, **without)
        if idle.any():  # designs whose velocity loop has hardly any effect
            ring: Any = {"markersize": 9, "markerfacecolor": "none", "markeredgecolor": RED}
            axes.plot(x[idle], y[idle], "o", label="idle: the loop hardly works", **ring)
        axes.set(xlabel=labels[0], ylabel=labels[1], xscale=_scale(x), yscale=_scale(y) if others else "linear")
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure


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


def _scale(values: Floats) -> Literal["linear", "log"]:
    """Return the scale on which points are evenly spaced: logarithmic if their ratios are more even."""
    steps = np.unique(values)
    return "log" if steps[0] > 0 and _uneven(np.log(steps)) < _uneven(steps) else "linear"


def _uneven(values: Floats) -> float:
    steps = np.diff(values)
    return float(steps.std() / steps.mean())
