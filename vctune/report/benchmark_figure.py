"""Pictures of benchmarks: points on logarithmic axes."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from vctune.report.style import BLUE, GREEN, GREY, INK, ORANGE, RED, STYLE

INKS = (BLUE, ORANGE, GREEN, RED, GREY, "#8e5bb5", "#a0703c", "#cc5fa0", "#2aa5a0", "#9aa11e", INK)
MARKS = "osD^vP*X<>hd"
PANEL_WIDTH, PANEL_HEIGHT = 5.4, 4.2
MANY = 400  # Number of points above which a bitmap is smaller than a file with the coordinates


@dataclass(frozen=True, slots=True)
class Series:
    """A series of points with a name."""

    label: str
    x: list[float]
    y: list[float]


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of logarithmic axes and its series."""

    title: str  # labels
    x: str
    y: str
    series: list[Series]  # the drawn series
    floor: float | None = None  # position of the dotted line that shows values at or below it


def benchmark_figure(panels: list[Panel]) -> Figure:
    """Return a figure with the panels that have points, side by side."""
    panels = [panel for panel in panels if any(series.x for series in panel.series)]
    with rc_context(STYLE):
        figure = Figure(figsize=(PANEL_WIDTH * len(panels), PANEL_HEIGHT), layout="constrained")
        for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            axes.set(xscale="log", yscale="log")  # set before the points are drawn, because all points may coincide
            for k, series in enumerate(panel.series):
                y = [max(value, panel.floor) for value in series.y] if panel.floor else series.y
                style = {"color": INKS[k % len(INKS)], "marker": MARKS[k % len(MARKS)], "markersize": 5}
                axes.plot(series.x, y, linestyle="", label=series.label, rasterized=len(series.x) > MANY, **style)
            if panel.floor:
                axes.axhline(panel.floor, color=GREY, linewidth=1, linestyle=":")
            axes.set(title=panel.title, xlabel=panel.x, ylabel=panel.y)
            axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            axes.legend(loc="best", fontsize=8)
    return figure
