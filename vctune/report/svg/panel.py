"""A panel of a drawing, with its scales, lines, bands and areas. Its methods have the names of Matplotlib's Axes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, Protocol

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.report.svg.elements import BEYOND, DASHES, GREY, INK, LETTER, SIZE, number, path, polyline, text
from vctune.report.svg.marks import MARKER, MARKERS, Mark, area, marked, spread
from vctune.report.svg.scales import Scale, around, ticks_of

TICK = 3.5  # Length of a tick, and distance between a tick and its number, points


APART = (38.0, 20.0)  # Least distance between the round numbers of x and of y, points


class Axes(Protocol):
    """The methods of axes that `panels.py`, `hands_figure.py` and `style.py` call. `Panel` and Matplotlib's Axes have
    them."""

    def plot(self, *args: Any, **kwargs: Any) -> Any: ...
    def semilogy(self, *args: Any, **kwargs: Any) -> Any: ...
    def fill(self, *args: Any, **kwargs: Any) -> Any: ...
    def axhline(self, *args: Any, **kwargs: Any) -> Any: ...
    def axvspan(self, *args: Any, **kwargs: Any) -> Any: ...
    def set(self, **kwargs: Any) -> Any: ...
    def set_xticks(self, *args: Any, **kwargs: Any) -> Any: ...
    def set_yticks(self, *args: Any, **kwargs: Any) -> Any: ...
    def get_xlim(self) -> Any: ...
    def get_ylim(self) -> Any: ...


@dataclass(slots=True)
class Panel:
    """A rectangle with two scales."""

    box: tuple[float, float, float, float]  # left, top, width and height in the drawing, points
    name: str = ""  # name of the panel in the code
    title: str = ""  # text above the panel
    x: Scale = field(default_factory=Scale)  # scales
    y: Scale = field(default_factory=Scale)
    marks: list[Mark] = field(default_factory=list)  # lines, points and areas, in data coordinates
    over: list[str] = field(default_factory=list)  # elements of SVG above the marks, in points of the drawing
    grid: bool = True  # whether the panel has grid lines at its ticks

    def plot(self, x: Any, y: Any, form: str = "", **style: Any) -> None:
        """Add a line or points."""
        across, up = np.broadcast_arrays(np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(y, float)))
        self._line(across, up, form, style)

    def _line(self, x: Floats, y: Floats, form: str, style: Any, edges: bool = False) -> None:
        line = style.get("linestyle") or ("none" if form in MARKERS else form or "-")
        self.marks.append(
            Mark(
                x,
                y,
                label=str(style.get("label") or ""),
                colour=style.get("color", INK),
                width=0.0 if line == "none" else style.get("linewidth", 1.6),
                dashes=DASHES.get(line, ()) if isinstance(line, str) else line[1],
                marker=form if form in MARKERS else style.get("marker", ""),
                across=style.get("markersize", MARKER),
                every=style.get("markevery"),
                ground=style.get("markeredgecolor", "none"),
                edges=edges,
                clipped=style.get("clip_on", True),
            )
        )

    def semilogy(self, *args: Any, **style: Any) -> None:
        """Add a line, and make the y scale logarithmic."""
        self.y.logarithmic = True
        self.plot(*args, **style)

    def fill(self, x: Any, y: Any, **style: Any) -> None:
        """Add an area."""
        self._area(np.asarray(x, float), np.asarray(y, float), False, style)

    def axhline(self, y: float, **style: Any) -> None:
        """Add a horizontal line."""
        self._line(np.array([-inf, inf]), np.array([y, y]), "", style, edges=True)

    def axvline(self, x: float, **style: Any) -> None:
        """Add a vertical line."""
        self._line(np.array([x, x]), np.array([-inf, inf]), "", style, edges=True)

    def axvspan(self, low: float, high: float, **style: Any) -> None:
        """Add a band between two values of x."""
        self._area(np.array([low, high, high, low]), np.array([-inf, -inf, inf, inf]), True, style)

    def _area(self, x: Floats, y: Floats, edges: bool, style: Any) -> None:
        self.marks.append(
            Mark(
                x,
                y,
                label=str(style.get("label") or ""),
                colour=style.get("edgecolor", INK),
                width=style.get("linewidth", 1.0),
                ground=style.get("facecolor", "none"),
                opacity=style.get("alpha", 1.0),
                hatch=style.get("hatch") or "",
                edges=edges,
                closed=True,
            )
        )

    def set(self, **given: Any) -> None:
        """Set properties of the scales."""
        for key, value in given.items():
            scale, what = (self.x if key[0] == "x" else self.y), key[1:]
            if what == "scale":
                scale.logarithmic = value == "log"
            elif what == "lim":
                scale.limits = value
            elif what == "label":
                scale.label = value
            elif key == "title":
                self.title = value

    def set_xticks(self, ticks: Sequence[float], labels: Sequence[str] | None = None, *, minor: bool = False) -> None:
        """Set the ticks on x."""
        _set_ticks(self.x, ticks, labels, minor)

    def set_yticks(self, ticks: Sequence[float], labels: Sequence[str] | None = None, *, minor: bool = False) -> None:
        """Set the ticks on y."""
        _set_ticks(self.y, ticks, labels, minor)

    def get_xlim(self) -> tuple[float, float]:
        """Return the limits of x: those that were set, or limits around the marks."""
        return self.x.limits or around(self.x, [mark.x for mark in self.marks])

    def get_ylim(self) -> tuple[float, float]:
        """Return the limits of y: those that were set, or limits around the marks."""
        return self.y.limits or around(self.y, [mark.y for mark in self.marks])

    def shares(self, mark: Mark) -> Floats:
        """Return the points of a mark as shares of the panel from its lower left corner, shape (n, 2)."""
        shares = np.stack([self.x.shares(mark.x, self.get_xlim()), self.y.shares(mark.y, self.get_ylim())], axis=1)
        if mark.edges:
            across = np.stack([mark.x, mark.y], axis=1)
            shares = np.where(np.isinf(across), across > 0, shares)
        return np.where(np.isinf(shares), np.nan, shares)

    def points(self, mark: Mark) -> Floats:
        """Return the points of a mark in the drawing, shape (n, 2)."""
        left, top, width, height = self.box
        out = (self.shares(mark) - 0.5) * (width, -height)
        far = np.maximum(np.hypot(*out.T) / BEYOND, 1.0)
        return np.asarray(out / far[:, None] + (left + width / 2, top + height / 2))

    def svg(self, name: str) -> Iterator[str]:
        """Yield the panel's elements."""
        left, top, width, height = self.box
        frame = f"M{number(left)} {number(top)}h{number(width)}v{number(height)}h-{number(width)}z"
        ends = self.get_xlim(), self.get_ylim()
        ticks = [
            ticks_of(scale, *end, max(int(long / apart), 2))
            for scale, end, long, apart in zip((self.x, self.y), ends, (width, height), APART, strict=True)
        ]
        at_x = [left + width * share for share in self.x.shares(np.array([at for at, _ in ticks[0]]), ends[0])]
        at_y = [top + height * (1 - share) for share in self.y.shares(np.array([at for at, _ in ticks[1]]), ends[1])]
        yield f'<clipPath id="{name}"><path d="{frame}"/></clipPath>'
        if self.grid:
            lines = [f"M{number(x)} {number(top)}v{number(height)}" for x in at_x]
            lines += [f"M{number(left)} {number(y)}h{number(width)}" for y in at_y]
            yield path("".join(lines), stroke=GREY, width=0.6, stroke_opacity=0.3)
        yield f'<g clip-path="url(#{name})">'
        for k, mark in enumerate(sorted(self.marks, key=lambda each: not each.closed)):
            yield from self._drawn(mark, f"{name}-{k}") if mark.clipped else ()
        yield "</g>"
        minor = left + width * self.x.shares(np.asarray(self.x.minor, float), ends[0])
        foot, marks = top + height, [(x, TICK) for x in at_x] + [(x, 2.0) for x in minor]
        yield path(
            frame + "".join(f"M{number(x)} {number(foot)}v{number(long)}" for x, long in marks)
            + "".join(f"M{number(left)} {number(y)}h-{TICK}" for y in at_y), stroke=INK, width=0.8,
        )  # fmt: skip
        for mark in self.marks:
            yield from () if mark.clipped else self._drawn(mark, "")
        yield from self._words(at_x, at_y, ticks)
        yield from self.over

    def _drawn(self, mark: Mark, name: str) -> Iterator[str]:
        points = self.points(mark)
        if mark.closed:
            yield area(polyline(points) + "z", mark, name)
            return
        if mark.width and not mark.alone:
            yield path(
                polyline(points), stroke=mark.colour, width=mark.width, dashes=mark.dashes, stroke_linejoin="round"
            )
        if mark.marker:
            at = points[np.isfinite(points).all(axis=1)]
            at = at if mark.every is None else at[spread(at, mark.every, float(np.hypot(*self.box[2:])))]
            yield marked(at, mark)

    def _words(self, at_x: list[float], at_y: list[float], ticks: list[list[tuple[float, str]]]) -> Iterator[str]:
        """Yield the numbers at the ticks, the names of the scales and the title."""
        left, top, width, height = self.box
        foot = top + height + 2 * TICK
        for at, (_, word) in zip(at_x, ticks[0], strict=True):
            yield text(at, foot, word, ha="center", va="top")
        for at, (_, word) in zip(at_y, ticks[1], strict=True):
            yield text(left - 2 * TICK, at, word, ha="right", va="center")
        if self.x.label:
            yield text(left + width / 2, foot + 1.5 * SIZE, self.x.label, ha="center", va="top")
        if self.y.label:
            widest = LETTER * SIZE * max((len(word) for _, word in ticks[1]), default=0)
            middle = max(left - 2 * TICK - widest - SIZE, 0.6 * SIZE)
            yield text(middle, top + height / 2, self.y.label, ha="center", va="center", rotation=90)
        if self.title:
            yield text(left + width / 2, top - 0.5 * SIZE, self.title, size=8, ha="center")


def _set_ticks(scale: Scale, ticks: Sequence[float], labels: Sequence[str] | None, minor: bool) -> None:
    if minor:
        scale.minor = ticks
    else:
        scale.ticks, scale.words = ticks, labels
