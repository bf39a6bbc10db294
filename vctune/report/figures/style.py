"""The common style of all figures: colours, a layout that texts cannot change, and bands."""

from __future__ import annotations

from math import ceil, floor, log10, pi
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import TICKDOWN
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from vctune.analysis.extrema import Floats
from vctune.model.problem import Band
from vctune.report.typography import prefixed, quantity, tick

INK, PAPER = "#010203", "#fefdfc"
"""Colours of text and background; the page replaces them by its own."""
BLUE, ORANGE, GREEN, RED, GREY = "#3b82d0", "#e08a1e", "#2f9e62", "#d6453d", "#8a8f98"
"""Two curves never differ by colour only: their line style or marker differs, too."""
PLAIN = FuncFormatter(lambda value, _: tick(value))
LEAST_SPAN = 0.1
"""Least difference of ratios for which the axis adapts to them; closer ratios share one view."""
FEW_DECADES = 100.0
WIDTH = 4.2
"""Width of a design's figure, inches. Two figures fit side by side on a desktop screen. One figure remains legible on a
telephone and in a column of 8 cm."""
STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.titlesize": 9,
    "axes.titley": 1.0,
    "figure.facecolor": PAPER,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": GREY,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "lines.linewidth": 1.6,
    "path.simplify_threshold": 0.25,
}


def canvas(
    width: float,
    height: float,
    *,
    left: float = 0.85,
    right: float = 0.15,
    bottom: float = 0.5,
    top: float = 0.15,
    gaps: tuple[float, float] = (0.0, 0.0),
) -> Figure:
    """Return a figure whose axes keep their position whatever texts surround them.

    Parameters
    ----------
    width, height : inches
    left, right, bottom, top : margins, inches
    gaps : between columns and between rows, shares of the axes' size
    """
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left / width, bottom / height, 1 - right / width, 1 - top / height, wspace=gaps[0], hspace=gaps[1]
    )
    return figure


def legend_above(axes: Axes, columns: int, **options: Any) -> None:
    """Put the legend above the axes, where it covers no curve.

    Parameters
    ----------
    axes : axes with labelled lines
    columns : columns of the legend
    options : options of `Axes.legend`
    """
    close: dict[str, Any] = {
        "borderaxespad": 0.2,
        "columnspacing": 1.1,
        "handlelength": 1.7,
        "handletextpad": 0.5,
        "fontsize": 8,
    } | options
    axes.legend(loc="lower left", bbox_to_anchor=(-0.03, 1.0), ncols=columns, **close)


def frequency_axis(axes: Axes, low: float, high: float) -> None:
    """Turn the x axis into a frequency axis with plain decimals.

    Parameters
    ----------
    axes : axes to change
    low, high : ends, Hz
    """
    axes.set(xscale="log", xlim=(low, high), xlabel="frequency, Hz")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high > FEW_DECADES * low else (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(PLAIN)
    axes.xaxis.set_minor_locator(NullLocator())
    between = [step * 10.0**k for k in range(floor(log10(low)), ceil(log10(high))) for step in (2, 5)]
    inside = [hz for hz in between if low < hz < high]  # one artist: ten times as fast as Matplotlib's minor ticks
    foot = axes.get_xaxis_transform()
    axes.plot(
        inside,
        [0.0] * len(inside),
        marker=TICKDOWN,
        linestyle="none",
        markersize=2,
        color=INK,
        transform=foot,
        clip_on=False,
    )


def in_prefixed(values: Floats, unit: str) -> tuple[Floats, str]:
    """Return values in their unit with a prefix that suits the greatest of them, and that unit.

    Parameters
    ----------
    values : values to draw
    unit : their unit without a prefix
    """
    power, named = prefixed(float(np.max(np.abs(values), initial=0.0)), unit)
    return values / 10.0**power, named


def decades(axes: Axes) -> None:
    """Make the y axis logarithmic with ticks at the powers of ten, and also between them if there are few powers."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > FEW_DECADES * low else (1.0, 2.0, 5.0)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(PLAIN)


def around_one(axes: Axes, factor: float, least: float | None, worst_hz: float | None, where: str = "") -> None:
    """Draw the limit, the safety factor and the least ratio. The axis is linear around them.

    Parameters
    ----------
    axes : axes of a ratio
    factor : the safety factor
    least, worst_hz : the least ratio and its frequency, Hz; None for inf
    where : description of the hand with the least ratio
    """
    axes.axhline(1.0, color=RED, linewidth=1.2, linestyle="-.", label="1: the limit")
    axes.axhline(factor, color=INK, linewidth=1, linestyle=(0, (1, 1)), label=f"safety factor {factor:g}")
    if worst_hz and least:
        label = f"least: {quantity(least)} at {quantity(worst_hz, 'Hz')}" + (f",\n{where}" if where else "")
        axes.plot(worst_hz, least, "o", color=RED, label=label)
    marks = (1.0, factor, min(least or 1.0, 2 * factor))
    low, span = min(marks), max(max(marks) - min(marks), LEAST_SPAN)
    axes.set(ylim=(max(low - 0.9 * span, 0.0), max(marks) + 2.6 * span), ylabel="coupling / required")


def stamp(figure: Figure, words: str) -> None:
    """Write across a figure why its design is not for use. The text remains visible in print and in grey.

    Parameters
    ----------
    figure : figure to mark
    words : the text; longer texts get a smaller size
    """
    style: dict[str, Any] = {"ha": "center", "va": "center", "rotation": 20, "fontweight": "bold"}
    for axes in figure.axes:
        if axes.get_label() != "<colorbar>":
            width = 72 * figure.get_figwidth() * axes.get_position().width
            size = min(21.0, 1.6 * width / len(words))
            axes.text(0.5, 0.5, words, transform=axes.transAxes, color=RED, alpha=0.45, fontsize=size, **style)


def shade(axes: Axes, band: Band, colour: str, label: str, hatch: str = "") -> None:
    """Shade the part of a band that lies on the axis.

    Parameters
    ----------
    axes : axes whose limits are set, Hz
    band : rad/s
    colour, label : colour of the shade and its label in the legend
    hatch : hatching over the shade; "" for none
    """
    low, high = axes.get_xlim()
    ends = max(band.min / (2 * pi), low), min(band.max / (2 * pi), high)
    axes.axvspan(*ends, facecolor=colour, alpha=0.13, label=label, hatch=hatch, edgecolor=colour, linewidth=0)
