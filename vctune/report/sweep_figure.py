"""The picture of a sweep: a column of its table over one or two axes, at the width of a paper's column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullLocator

from vctune.analysis.extrema import Floats
from vctune.model.display import Display
from vctune.model.numbers.units import SYMBOLS
from vctune.model.parts import PART_NUMBERS
from vctune.report.style import BLUE, GREEN, INK, ORANGE, PAPER, RED, STYLE, logarithmic, text_of_ticks
from vctune.study.row_record import COLUMN_OF_KEY, SHOWN_COLUMNS
from vctune.study.study_table import Table

SIZE = 3.5, 2.9  # Width of a column of a paper, and height, inches
WIDE = 10.0  # Numbers that span more than this ratio have a logarithmic axis
COLOURS = "viridis_r"  # as light as it is small, also in grey
FEW = 4  # Greatest number of values of an axis of which each gets a line
LINES = tuple(zip((INK, BLUE, ORANGE, GREEN, RED), ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1))), strict=True))
MANY = 40  # Number of points above which markers are small
APART = 0.1  # Least distance of two values, as a share of the axis, at which each of them has a tick
LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)  # Quantiles of a column at which it has contours
UNEVEN = 0.4  # Relative deviation of the steps of an axis from which its values are evenly spaced categories of cells
MOST = 20  # Greatest number of categories
EDGES = {0: "lower", 1: "upper"}


@dataclass(frozen=True, slots=True)
class _Axis:
    """An axis that varies: its values as drawn, in ms if they are short times, and its scale."""

    label: str
    values: Floats
    scale: Literal["linear", "log", "categories"]

    @property
    def steps(self) -> Floats:
        """The distinct values."""
        return np.unique(self.values)

    @property
    def places(self) -> Floats:
        """Where the values are drawn: a category at its number."""
        return np.searchsorted(self.steps, self.values).astype(float) if self.scale == "categories" else self.values

    @property
    def edges(self) -> Floats:
        """The edges of cells around the distinct values, halfway on the axis's scale."""
        at = np.unique(self.places)
        at = np.log(at) if self.scale == "log" else at
        inner = (at[1:] + at[:-1]) / 2
        edges = np.concatenate([[2 * at[0] - inner[0]], inner, [2 * at[-1] - inner[-1]]])
        return np.exp(edges) if self.scale == "log" else edges

    def put(self, axes: Axes, which: Literal["x", "y"]) -> None:
        """Give the axis of a figure its label, its scale and its ticks."""
        axes.set(**{f"{which}label": self.label})
        if self.scale == "log":
            logarithmic(axes, which)
        at = np.log(self.steps) if self.scale == "log" else np.unique(self.places)
        if self.scale == "categories" or np.diff(at).min() >= APART * np.ptp(at):
            ticks: Any = np.unique(self.places)
            axes.set(**{f"{which}ticks": ticks, f"{which}ticklabels": text_of_ticks(self.steps.tolist())})
            (axes.xaxis if which == "x" else axes.yaxis).set_minor_locator(NullLocator())


def sweep_figure(table: Table, column: str = "error", *, grid: bool) -> Figure | None:
    """Return the figure of a column of numbers over the axes that vary; None unless one or two axes vary."""
    finite = np.logical_and.reduce([np.isfinite(values) for values in table.axes.values()])
    varied = {key: values[finite] for key, values in table.axes.items() if np.unique(values[finite]).size > 1}
    if len(varied) not in (1, 2):
        return None
    lines = len(varied) == 1 or (grid and min(np.unique(values).size for values in varied.values()) <= FEW)
    axes_of = [
        _axis(_named(key, table.kind), values, table.units.get(key, ""), cells=grid and not lines)
        for key, values in varied.items()
    ]
    certified, shown = table.certified[finite], SHOWN_COLUMNS[column]
    found = np.where(certified, table.numbers[column][finite], np.nan)
    symbol = {COLUMN_OF_KEY[key]: table.kind.symbol(key) for key in SYMBOLS}.get(column, shown.label)
    name = _with_unit(symbol, table.units.get(column, ""))
    along, *others = sorted(axes_of, key=lambda axis: axis.steps.size > FEW, reverse=True)
    with rc_context(STYLE | {"font.size": 8, "legend.fontsize": 7}):
        figure = Figure(figsize=SIZE)
        axes = figure.subplots()
        if lines:
            _curves(axes, along, others[0] if others else None, found, name)
        else:
            _map(figure, axes, axes_of, found, name, grid=grid)
            without = np.isnan(found)
            if without.any():
                x, y = (axis.places[without] for axis in axes_of)
                axes.plot(x, y, "x", color=RED, markersize=3, label="no certified design")
        idle = table.idle[finite] & np.isfinite(found)
        if idle.any():  # designs whose velocity loop has hardly any effect
            x, y = (along.places, found) if lines else (axis.places for axis in axes_of)
            ring: Any = {"markersize": 7, "markerfacecolor": "none", "markeredgecolor": RED}
            axes.plot(x[idle], y[idle], "o", label="idle: the loop hardly works", **ring)
        if len(axes.get_legend_handles_labels()[0]) > (1 if len(axes_of) == 1 else 0):
            title = others[0].label if lines and others else None
            figure.legend(loc="outside upper center", ncols=3, title=title, handlelength=2.4, columnspacing=1.2)
    return figure


def _axis(name: str, values: Floats, unit: str, *, cells: bool) -> _Axis:
    if unit == "s" and np.abs(values).max() < 1:
        values, unit = 1e3 * values, "ms"
    steps = np.unique(values)
    scales: list[tuple[float, Literal["linear", "log"]]] = [(_uneven(steps), "linear")]
    if steps[0] > 0:
        scales.append((_uneven(np.log(steps)), "log"))
    uneven, scale = min(scales)
    if cells and uneven > UNEVEN and steps.size <= MOST:
        return _Axis(_with_unit(name, unit), values, "categories")
    return _Axis(_with_unit(name, unit), values, scale)


def _named(key: str, kind: Display) -> str:
    """Return the name of an axis in words."""
    table, _, name = key.partition(".")
    end = {"max": "greatest ", "min": "least "}.get(name.rpartition(".")[2], "")
    name = name.removesuffix(".max").removesuffix(".min")
    if name.startswith("band_hz"):
        return f"{EDGES[int(name[-2])]} edge of the {table} band"
    if f"{table}.{name}" in SYMBOLS:
        return f"{end}{kind.symbol(f'{table}.{name}')}"
    if table == "device" and name in PART_NUMBERS:
        return PART_NUMBERS[name].label
    words = name.removesuffix("_hz").replace("_", " ").replace(".", " ")
    hand = {"operator": " of the hand", "tool": " of the tool", "environment": " of the environment"}.get(table, "")
    return f"{end}{words}{hand}"


def _with_unit(label: str, unit: str) -> str:
    return f"{label}, {unit}" if unit else label


def _uneven(values: Floats) -> float:
    steps = np.diff(values)
    return float(steps.std() / steps.mean())


def _curves(axes: Axes, along: _Axis, other: _Axis | None, found: Floats, name: str) -> None:
    """Draw the column over one axis: a line for each value of the other."""
    of: list[tuple[str, Any]] = [("certified", np.ones(found.size, bool))]
    if other is not None:
        texts = text_of_ticks(other.steps.tolist())
        of = [(text, other.values == value) for text, value in zip(texts, other.steps, strict=True)]
    for (text, here), (colour, dashes) in zip(of, LINES, strict=False):
        order = np.flatnonzero(here)[np.argsort(along.places[here], kind="stable")]
        style: Any = {"color": colour if other is not None else BLUE, "linestyle": dashes, "linewidth": 1.2}
        size = 3.0 if order.size <= MANY else 1.0
        axes.plot(along.places[order], found[order], marker="o", markersize=size, label=text, **style)
    without = np.unique(along.places[np.isnan(found)])
    if without.size:
        floor: Any = {"transform": axes.get_xaxis_transform(), "clip_on": False}
        axes.plot(without, np.zeros_like(without), "x", color=RED, markersize=4, label="no certified design", **floor)
    along.put(axes, "x")
    axes.set_ylabel(name)
    sizes = found[np.isfinite(found)]
    if sizes.size and sizes.min() > 0 and sizes.max() > WIDE * sizes.min():
        logarithmic(axes, "y")


def _map(figure: Figure, axes: Axes, of: list[_Axis], found: Floats, name: str, *, grid: bool) -> None:
    """Colour the cells of a grid, or points, by the column."""
    x, y = of
    sizes = found[np.isfinite(found)]
    wide = sizes.size and sizes.min() > 0 and sizes.max() > WIDE * sizes.min()
    colours: Any = {"cmap": COLOURS, "norm": LogNorm() if wide else None}
    if grid:
        i, j = (np.searchsorted(axis.steps, axis.values) for axis in of)
        cells = np.full((y.steps.size, x.steps.size), np.nan)
        cells[j, i] = found
        drawn: Any = axes.pcolormesh(x.edges, y.edges, np.ma.masked_invalid(cells), rasterized=True, **colours)
        axes.grid(visible=False)
        if min(cells.shape) > FEW and sizes.size:
            levels = sorted({float(f"{level:.2g}") for level in np.quantile(sizes, LEVELS)})
            places = (np.unique(axis.places) for axis in of)
            lines = axes.contour(*places, np.ma.masked_invalid(cells), levels=levels, colors=INK, linewidths=0.7)
            for text in axes.clabel(lines, fmt="%g", fontsize=7):
                text.set_path_effects([withStroke(linewidth=1.5, foreground=PAPER)])
    else:
        certified = np.isfinite(found)
        drawn = axes.scatter(x.places[certified], y.places[certified], c=sizes, s=12, **colours)
    x.put(axes, "x")
    y.put(axes, "y")
    if sizes.size:
        bar = figure.colorbar(drawn, label=name)
        if wide:
            logarithmic(bar.ax, "y")
