"""The common style of all figures: scales of frequency and of ratios, bands and stamps, on any axes."""

from __future__ import annotations

from math import ceil, floor, log10, pi

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.model.problem import Band
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.elements import INK, RED, text
from vctune.report.svg.panel import Axes
from vctune.report.svg.scales import decades_between
from vctune.report.typography import prefixed, quantity, tick

LEAST_SPAN = 0.1  # Least span of ratios that sets the limits of the axis
WIDTH = 4.2  # Width of a design's figure, inches


def frequency_axis(axes: Axes, low: float, high: float) -> None:
    """Turn the x axis into a frequency axis with plain decimals."""
    axes.set(xscale="log", xlim=(low, high), xlabel="frequency, Hz")
    marked = decades_between(low, high)
    axes.set_xticks(marked, [tick(value) for value in marked])
    between = [step * 10.0**k for k in range(floor(log10(low)), ceil(log10(high))) for step in (2, 5)]
    inside = [hz for hz in between if low < hz < high]
    axes.set_xticks(inside, [""] * len(inside), minor=True)


def in_prefixed(values: Floats, unit: str) -> tuple[Floats, str]:
    """Return values in a unit whose prefix suits the greatest value, and this unit."""
    power, named = prefixed(float(np.max(np.abs(values), initial=0.0)), unit)
    return values / 10.0**power, named


def decades(axes: Axes) -> None:
    """Make the y axis logarithmic with ticks at the powers of ten, and also between them if there are few powers."""
    axes.set(yscale="log")
    marked = decades_between(*axes.get_ylim())
    axes.set_yticks(marked, [tick(value) for value in marked])
    axes.set_yticks([], minor=True)


def around_one(axes: Axes, factor: float, least: float | None, worst_hz: float | None, where: str = "") -> None:
    """Draw the limit, the safety factor and the least ratio on a linear axis around them."""
    axes.axhline(1.0, color=RED, linewidth=1.2, linestyle="-.", label="1: the limit")
    axes.axhline(factor, color=INK, linewidth=1, linestyle=(0, (1, 1)), label=f"safety factor {factor:g}")
    if worst_hz and least:
        label = f"least: {quantity(least)} at {quantity(worst_hz, 'Hz')}" + (f",\n{where}" if where else "")
        axes.plot(worst_hz, least, "o", color=RED, label=label)
    marks = (1.0, factor, min(least or 1.0, 2 * factor))
    low, span = min(marks), max(max(marks) - min(marks), LEAST_SPAN)
    axes.set(ylim=(max(low - 0.9 * span, 0.0), max(marks) + 2.6 * span), ylabel="coupling / required")


def stamp(drawing: Drawing, words: str) -> None:
    """Write across a figure why its design is not for use. The text remains visible in print and in grey."""
    for panel in drawing.panels:
        left, top, width, height = panel.box
        place, size = (left + width / 2, top + height / 2), min(21.0, 1.6 * width / len(words))
        panel.over.append(
            text(*place, words, size=size, ha="center", va="center", colour=RED, rotation=20, bold=True, opacity=0.45)
        )


def shade(axes: Axes, band: Band, colour: str, label: str, hatch: str = "") -> None:
    """Shade the part of a band that lies on the axis."""
    low, high = axes.get_xlim()
    ends = max(band.min / (2 * pi), low), min(band.max / (2 * pi), high)
    axes.axvspan(*ends, facecolor=colour, alpha=0.13, label=label, hatch=hatch, edgecolor=colour, linewidth=0)
