"""Write the elements of an SVG file: texts with subscripts, and short paths."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.report.typography import svg_text

# Colours of text and background
INK, PAPER = "#010203", "#fefdfc"
# Colours of curves
BLUE, ORANGE, GREEN, RED, GREY = "#3b82d0", "#e08a1e", "#2f9e62", "#d6453d", "#8a8f98"
SIZE = 9.0  # Default size of a text, points
LETTER, LINE = 0.54, 1.2  # Width of a letter and height of a line, as multiples of the font size
STRAIGHT = 0.05  # Greatest distance, in points, between the curve and a point that one of `PASSES` passes omits
PASSES = 4
BEYOND = 5e3  # Greatest distance of a point from the middle of its panel
# Distance of the baseline below the stated position, as a multiple of the size
BASELINE = {"center": 0.36, "top": 0.8, "bottom": -0.2, "baseline": 0.0}
ANCHORS = {"left": "", "center": ' text-anchor="middle"', "right": ' text-anchor="end"'}
# Lengths of strokes and gaps, as multiples of the line's width
DASHES = {"-": (), "--": (3.7, 1.6), ":": (1.0, 1.65), "-.": (6.4, 1.6, 1.0, 1.6)}


def number(value: float) -> str:
    """Return a length as text, rounded to a tenth of a point."""
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") else text


def text(
    x: float,
    y: float,
    words: str,
    *,
    size: float = SIZE,
    ha: str = "left",
    va: str = "baseline",
    colour: str = "",
    rotation: float = 0.0,
    bold: bool = False,
    opacity: float = 1.0,
) -> str:
    """Return a text of one or more lines."""
    lines = words.split("\n")
    above = {"center": (len(lines) - 1) / 2, "bottom": len(lines) - 1}.get(va, 0.0)
    style = ANCHORS[ha] + (f' font-size="{number(size)}"' if size != SIZE else "")
    style += f' fill="{colour}"' if colour else ""
    style += ' font-weight="bold"' if bold else ""
    style += f' opacity="{opacity:g}"' if opacity < 1 else ""
    style += f' transform="rotate({-rotation:g} {number(x)} {number(y)})"' if rotation else ""
    base = y + size * (BASELINE[va] - 1.1 * above)
    return "\n".join(
        f'<text x="{number(x)}" y="{number(base + 1.1 * size * k)}"{style}>{svg_text(line)}</text>'
        for k, line in enumerate(lines)
    )


def path(
    data: str, *, stroke: str = "", width: float = 1.0, dashes: tuple[float, ...] = (), **style: str | float
) -> str:
    """Return a path."""
    given = {"fill": "none"} | {key: value for key, value in style.items() if value != 1.0}
    if stroke:
        given |= {"stroke": stroke, "stroke-width": f"{width:g}"}
        given |= {"stroke-dasharray": " ".join(f"{width * each:.3g}" for each in dashes)} if dashes else {}
    words = "".join(f' {key.replace("_", "-")}="{escape(str(value))}"' for key, value in given.items())
    return f'<path d="{data}"{words}/>'


def polyline(points: Floats) -> str:
    """Return the data of a path through points, in steps of tenths. The path has a gap where a point is not finite."""
    seen = np.isfinite(points).all(axis=1)
    runs = np.split(points, np.flatnonzero(np.diff(seen)) + 1) if len(points) else []
    return "".join(_run(_thinned(run)) for run in runs if np.isfinite(run[0]).all())


def _run(points: Floats) -> str:
    tenths: NDArray[np.int_] = np.rint(10 * points).astype(int)
    steps = np.diff(tenths, axis=0)
    kept = steps[(steps != 0).any(axis=1)]
    start = " ".join(number(each / 10) for each in tenths[0])
    return f"M{start}l{' '.join(map(_tenths, kept.ravel().tolist())) or '0 0'}".replace(" -", "-")


def _tenths(step: int) -> str:
    """Return a number of tenths as a decimal text, such as ".5" for 5."""
    whole, tenth = divmod(abs(step), 10)
    return "-" * (step < 0) + (str(whole) if whole or not tenth else "") + (f".{tenth}" if tenth else "")


def _thinned(points: Floats) -> Floats:
    """Return the points of a curve except those that lie on the line between their neighbours, up to `STRAIGHT`."""
    for _ in range(PASSES):
        if len(points) < 3:
            break
        start, middle, end = points[:-2:2], points[1:-1:2], points[2::2]
        along, out = end - start, middle - start
        share = (out * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18)
        off = np.hypot(*(out - np.clip(share, 0, 1)[:, None] * along).T)
        kept = np.ones(len(points), bool)
        kept[1:-1:2] = off > STRAIGHT
        points = points[kept]
    return points
