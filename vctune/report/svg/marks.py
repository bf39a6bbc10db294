"""Define the marks of a panel (lines, points and areas) and draw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.report.svg.elements import number, path

# Path of each marker from its middle; {r} stands for half its width, {d} for its width
MARKERS = {
    "o": "m-{r} 0a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0z",
    "s": "m-{r}-{r}h{d}v{d}h-{d}z",
    "^": "m0-{r}l{r} {d}h-{d}z",
    "D": "m0-{r}l{r} {r}l-{r} {r}l-{r}-{r}z",
    "+": "m-{r} 0h{d}m-{r}-{r}v{d}",
}
MARKER = 6.0  # Width of a marker, points


@dataclass(frozen=True, slots=True)
class Mark:
    """A line, points or an area."""

    x: Floats  # points; with `edges`, an infinite coordinate is at an edge of the panel
    y: Floats
    label: str  # name; the figure does not show an empty name or a name that begins with _
    colour: str  # style of the line; a width of 0 for no line
    width: float = 1.6
    dashes: tuple[float, ...] = ()
    marker: str = ""  # marker ("" for no marker), and its width, points
    across: float = MARKER
    every: tuple[float, float] | None = None
    ground: str = "none"  # fill of an area, or colour of a marker's edge
    opacity: float = 1.0  # opacity of the fill
    hatch: str = ""  # hatching of an area as in Matplotlib, "/" or "-"; "" for none
    edges: bool = False  # whether the mark extends to the panel's edges
    closed: bool = False  # whether the mark is an area
    clipped: bool = True  # whether the mark ends at the panel's edges

    @property
    def alone(self) -> bool:
        """Whether the mark is a single point."""
        return len(self.x) == 1

    @property
    def named(self) -> bool:
        """Whether the figure shows the label of the mark."""
        return bool(self.label) and not self.label.startswith("_")


def marked(points: Floats, mark: Mark) -> str:
    """Return the markers at points."""
    half = mark.across / 2
    one = MARKERS[mark.marker].format(r=number(half), d=number(2 * half))
    data = "".join(f"M{number(x)} {number(y)}{one}" for x, y in points)
    if mark.marker == "+":
        return path(data, stroke=mark.colour, width=1)
    return path(data, fill=mark.colour, stroke=mark.colour if mark.ground == "none" else mark.ground)


def area(data: str, mark: Mark, name: str) -> str:
    """Return an area, filled and hatched."""
    filled = path(
        data, stroke=mark.colour if mark.width else "", width=mark.width, fill=mark.ground, fill_opacity=mark.opacity
    )
    drawn = filled if mark.ground != "none" or mark.width else ""
    if not mark.hatch:
        return drawn
    strokes = "M0 3H11M0 8.5H11" if "-" in mark.hatch else "M-1 6.5 6.5-1M4.5 12 12 4.5"
    lines = path(strokes, stroke=mark.colour, width=0.6)
    size = 'width="11" height="11" viewBox="0 0 11 11" patternUnits="userSpaceOnUse"'
    return f'<pattern id="{name}" {size}>{lines}</pattern>{drawn}{path(data, fill=f"url(#{name})")}'


def spread(points: Floats, every: tuple[float, float], diagonal: float) -> list[int]:
    """Return the indices of the points of a curve that are nearest to positions at equal distances along it."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]) / diagonal
    return sorted({int(np.abs(along - at).argmin()) for at in np.arange(every[0], along[-1], every[1])})
