"""The style of all figures, the scales that they share, and their files."""

from __future__ import annotations

import re
from io import BytesIO
from math import ceil, floor, log10, pi
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.analysis.extrema import Floats
from vctune.model.problem import Band
from vctune.report.typography import prefixed, svg_texts, tick
from vctune.running import check_time

INK, PAPER = "#010203", "#fefdfc"  # A page replaces both by its own text and ground
BLUE, ORANGE, GREEN, RED, GREY = "#3b82d0", "#e08a1e", "#2f9e62", "#d6453d", "#8a8f98"
WIDTH = 4.2  # Width of a figure of a page, inches
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
    "legend.fontsize": 8,
    "lines.linewidth": 1.6,
    "path.simplify_threshold": 0.25,
}
# Superfluous text in Matplotlib's SVG files, and its replacement
SUPERFLUOUS = {
    r"<metadata>.*?</metadata>\n": "",
    r"; font-family: [^;\"]*": "",
    r"<svg ": '<svg font-family="sans-serif" ',
    r'<g id="[^"]*">': "<g>",
    r' transform="rotate\(-0 [^"]*\)"': "",
    r"\n +": "\n",
}


def canvas(
    width: float, height: float, *, left: float = 0.85, right: float = 0.15, bottom: float = 0.5, top: float = 0.15,
    gaps: tuple[float, float] = (0.0, 0.0),
) -> Figure:  # fmt: skip
    """Return a figure whose axes keep their position for any texts around them; all lengths in inches."""
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left / width, bottom / height, 1 - right / width, 1 - top / height, wspace=gaps[0], hspace=gaps[1]
    )
    return figure


def legend_above(axes: Axes, columns: int, **options: Any) -> None:
    """Put the legend above the axes, where it covers no curve."""
    close: dict[str, Any] = {"borderaxespad": 0.2, "columnspacing": 1.1, "handlelength": 1.9, "handletextpad": 0.5}
    axes.legend(loc="lower left", bbox_to_anchor=(-0.03, 1.0), ncols=columns, **close | options)


def frequency_axis(axes: Axes, low: float, high: float) -> None:
    """Turn the x axis into a frequency axis with plain decimals."""
    axes.set(xscale="log", xlim=(low, high), xlabel="frequency, Hz")
    marked = decades_between(low, high)
    axes.set_xticks(marked, [tick(value) for value in marked])
    between = [step * 10.0**k for k in range(floor(log10(low)), ceil(log10(high))) for step in (2, 5)]
    inside = [hz for hz in between if low < hz < high]
    axes.set_xticks(inside, [""] * len(inside), minor=True)


def decades(axes: Axes) -> None:
    """Make the y axis logarithmic with ticks at the powers of ten, and also between them if there are few powers."""
    axes.set_yscale("log")
    marked = decades_between(*axes.get_ylim())
    axes.set_yticks(marked, [tick(value) for value in marked])
    axes.set_yticks([], minor=True)


def decades_between(low: float, high: float, most: int = 8) -> list[float]:
    """Return powers of ten between two numbers, or 1, 2 and 5 times these powers if there are few of them."""
    first, last = floor(log10(low)), ceil(log10(high))
    every = max(ceil((log10(high) - log10(low)) / most), 1)
    steps = (1.0,) if high > 100 * low else (1.0, 2.0, 5.0)
    values = [step * 10.0**k for k in range(first, last + 1) if k % every == 0 for step in steps]
    inside = [value for value in values if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
    return inside if len(inside) > 1 else round_numbers(low, high, 5)


def round_numbers(low: float, high: float, most: int = 7) -> list[float]:
    """Return round numbers between two numbers."""
    if not low < high:
        return [low]
    power = 10.0 ** floor(log10((high - low) / most))
    step = next(each * power for each in (1.0, 2.0, 2.5, 5.0, 10.0) if (high - low) / (each * power) <= most)
    return [step * k for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def in_prefixed(values: Floats, unit: str) -> tuple[Floats, str]:
    """Return values in a unit whose prefix suits the greatest value, and this unit."""
    power, named = prefixed(float(np.max(np.abs(values), initial=0.0)), unit)
    return values / 10.0**power, named


def shade(axes: Axes, band: Band, colour: str, label: str, hatch: str = "") -> None:
    """Shade the part of a band that lies on the frequency axis."""
    low, high = axes.get_xlim()
    ends = max(band.min / (2 * pi), low), min(band.max / (2 * pi), high)
    axes.axvspan(*ends, facecolor=colour, alpha=0.13, label=label, hatch=hatch, edgecolor=colour, linewidth=0)


def stamp(figure: Figure, words: str) -> None:
    """Write across each pair of axes why a design is not for use. The text remains visible in print and in grey."""
    for axes in figure.axes:
        wide = axes.get_position().width * figure.get_figwidth() * 72
        axes.text(
            0.5, 0.5, words, transform=axes.transAxes, fontsize=min(21.0, 1.6 * wide / len(words)), rotation=20,
            ha="center", va="center", color=RED, weight="bold", alpha=0.45,
        )  # fmt: skip


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG; the same figure and name give the same text."""
    check_time()
    stream = BytesIO()
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    text = stream.getvalue().decode()
    for long, short in SUPERFLUOUS.items():
        text = re.sub(long, short, text, flags=re.DOTALL)
    text = re.sub(r'(?<=[ \n])(d|x|y|transform)="[^"]*"', _shortened, text)
    return svg_texts(text)


def _shortened(attribute: re.Match[str]) -> str:
    """Return an attribute with its positions rounded to a tenth of a point, which no screen resolves."""
    text = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}".removesuffix(".0"), attribute[0])
    return text.replace(" \n", "\n")


def figure_file(figure: Figure, folder: Path, stem: str) -> dict[Path, str]:
    """Return a figure as an SVG file."""
    return {folder / f"{stem}.svg": svg(figure, stem)}
