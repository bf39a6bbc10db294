"""Labels beside the curves that they name, if there is room. A legend names the other curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.report.svg.elements import INK, LETTER, LINE, path, polyline, text
from vctune.report.svg.marks import Mark, area, marked
from vctune.report.svg.panel import Panel

Mask = NDArray[np.bool_]
SMALL = 7.8  # Size of a label's letters, points
ROOM, ENOUGH = 2, 12  # Least distance from a label to a curve, and distance beyond which more room is no better, points
# Greatest distance from a label to its curve, and least distance from a label to the single point that it names, points
NEAR = 6.0
# Weight of the distance from the label to the named point, relative to the weight of the room around the label
FAR = 0.15
# Length of a curve in a legend, and space between its columns, as multiples of the letters' size
HANDLE, SPACE = 1.7, 1.0


def label_curves(panel: Panel, columns: int = 2) -> None:
    """Write the name of each curve and point beside it, and the name of each area within it."""
    width, height = panel.box[2:]
    shape, scale = (int(height) + 1, int(width) + 1), np.array([width, height])
    # plain areas and bands are pale, so a label may lie on them
    obstacles = [mark for mark in panel.marks if not mark.closed or (mark.hatch and not mark.edges)]
    drawn = {id(mark): (_of_area if mark.closed else _of_line)(panel.shares(mark) * scale, shape) for mark in obstacles}
    taken = np.zeros(shape, bool)
    taken[[0, -1]] = taken[:, [0, -1]] = True
    for each in drawn.values():
        taken |= each
    unplaced: list[Mark] = []
    named = [mark for mark in panel.marks if mark.named]
    # the shortest curves come first, because they have the fewest places; areas come last
    for mark in sorted(named, key=lambda each: drawn[id(each)].sum() if id(each) in drawn else np.inf):
        own = drawn.get(id(mark))
        rows, letters = mark.label.count("\n") + 1, max(map(len, mark.label.split("\n")))
        box = int(LINE * SMALL * rows) + 1, int(LETTER * SMALL * letters) + 1
        if own is not None:
            place = _beside(taken, own, box, alone=mark.alone)
        else:
            place = _within(taken, panel.shares(mark) * scale, box)
        if place is None:
            unplaced.append(mark)
            continue
        y, x = place
        taken[max(y - box[0] // 2, 0) : y + box[0] // 2 + 1, max(x - box[1] // 2, 0) : x + box[1] // 2 + 1] = True
        at = panel.box[0] + x, panel.box[1] + height - y
        panel.over.append(text(*at, mark.label, size=SMALL, ha="center", va="center"))
        if mark.alone and own is not None and (point := np.argwhere(own)).size:
            _lead(panel, point.mean(axis=0), place, box)
    if unplaced:
        words, _, high = legend(unplaced, columns)
        panel.over.append(f'<g transform="translate({panel.box[0]:.1f} {panel.box[1] - high - 2:.1f})">{words}</g>')


def legend(marks: Sequence[Mark], columns: int, size: float = 8.0) -> tuple[str, float, float]:
    """Return a legend from its upper left corner, and its width and height."""
    if not marks:
        return "", 0.0, 0.0
    rows, x, parts = -(-len(marks) // columns), 0.0, []
    for column in (marks[k : k + rows] for k in range(0, len(marks), rows)):
        names = [mark.label.replace("\n", " ") for mark in column]
        for row, (mark, name) in enumerate(zip(column, names, strict=True)):
            y = size * LINE * (row + 0.5)
            parts += [_piece(mark, x, y, size), text(x + (HANDLE + 0.5) * size, y, name, size=size, va="center")]
        x += size * (HANDLE + 0.5 + LETTER * max(map(len, names)) + SPACE)
    return "\n".join(parts), x - SPACE * size, rows * LINE * size


def _piece(mark: Mark, x: float, y: float, size: float) -> str:
    """Return a sample of a mark for a legend."""
    end, half = x + HANDLE * size, 0.35 * size
    if mark.closed:
        data = f"M{x:.1f} {y - half:.1f}h{end - x:.1f}v{2 * half:.1f}h-{end - x:.1f}z"
        hatches = f"M{x:.1f} {y + half:.1f}" + f"l{2 * half:.1f}-{2 * half:.1f}m0 {2 * half:.1f}" * 2 * bool(mark.hatch)
        return area(data, replace(mark, hatch=""), "") + path(hatches, stroke=mark.colour, width=0.6) * bool(mark.hatch)
    line = np.array([[x, y], [end, y]])
    drawn = path(polyline(line), stroke=mark.colour, width=mark.width, dashes=mark.dashes) if mark.width else ""
    return drawn + (marked(line.mean(axis=0)[None], mark) if mark.marker else "")


def _of_line(points: Floats, shape: tuple[int, int]) -> Mask:
    """Return a mask of the raster's cells through which a line passes."""
    mask, points = np.zeros(shape, bool), np.clip(points[np.isfinite(points).all(axis=1)], -1e4, 1e4)
    if len(points) > 1:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        at = np.linspace(0, along[-1], int(along[-1]) + 2)
        points = np.stack([np.interp(at, along, points[:, k]) for k in (0, 1)], axis=1)
    x, y = np.round(points).astype(int).T if len(points) else (np.empty(0, int), np.empty(0, int))
    seen = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    mask[y[seen], x[seen]] = True
    return mask


def _of_area(corners: Floats, shape: tuple[int, int]) -> Mask:
    """Return a mask of the cells that an area covers. A cell is inside if an odd number of edges lies to its right."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    inside = np.zeros(shape, bool)
    for (x_0, y_0), (x_1, y_1) in pairwise([*corners, corners[0]]):
        if y_0 != y_1:
            crossed = (y_0 > y) != (y_1 > y)
            inside ^= crossed & (x < x_0 + (x_1 - x_0) * (y - y_0) / (y_1 - y_0))
    return inside


def _room(taken: Mask, box: tuple[int, int]) -> Floats:
    """Return the distance from a box around each cell to the nearest taken cell, at most `ENOUGH`; -1 if the box covers
    a taken cell."""
    (rows, columns), room = taken.shape, np.full(taken.shape, -1.0)
    around = [(each // 2 + ENOUGH + 1, each // 2 + ENOUGH) for each in box]
    total = np.pad(taken, around).cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    for distance in range(ENOUGH + 1):
        high, wide = (2 * (each // 2 + distance) + 1 for each in box)
        start = ENOUGH - distance
        first, second, third, last = (
            total[y : y + rows, x : x + columns] for y in (start, start + high) for x in (start, start + wide)
        )
        room[first + last == second + third] = distance
    return room


def _beside(taken: Mask, own: Mask, box: tuple[int, int], *, alone: bool) -> tuple[int, int] | None:
    """Return the middle of the box with the most room beside a line, or around a single point (`alone`)."""
    if not own.any():
        return None
    if alone:
        places = np.meshgrid(*map(np.arange, own.shape), indexing="ij")
        point = np.argwhere(own).mean(axis=0)
        y, x = (np.maximum(abs(at - of) - side / 2, 0) for at, of, side in zip(places, point, box, strict=True))
        room, apart = _room(taken, box), np.hypot(y, x)
        return _best(np.where((room >= ROOM) & (apart >= NEAR), room - FAR * apart, -np.inf))
    room, apart = _room(taken & ~own, box), _room(own, box)
    return _best(np.where((room >= ROOM) & (apart >= ROOM) & (apart <= NEAR), room - apart, -np.inf))


def _within(taken: Mask, corners: Floats, box: tuple[int, int]) -> tuple[int, int] | None:
    """Return the middle of the box with the most room between the leftmost and the rightmost corner of an area."""
    room = _room(taken, box)
    x = np.arange(taken.shape[1])
    inside = (x - box[1] / 2 >= corners[:, 0].min() - 1) & (x + box[1] / 2 <= corners[:, 0].max() + 1)
    return _best(np.where((room >= ROOM) & inside, room, -np.inf))


def _best(score: Floats) -> tuple[int, int] | None:
    """Return the row and column of the cell with the greatest finite score; None if no score is finite."""
    y, x = np.unravel_index(int(np.argmax(score)), score.shape)
    return (int(y), int(x)) if np.isfinite(score[y, x]) else None


def _lead(panel: Panel, point: Floats, middle: tuple[int, int], box: tuple[int, int]) -> None:
    """Draw a thin line from a point to its label if they are far apart."""
    half, (left, top, _, height) = np.array(box) / 2, panel.box
    end = np.clip(point, middle - half, middle + half)
    if np.hypot(*(end - point)) > 2 * NEAR:
        (y_0, x_0), (y, x) = point, end
        ends = np.array([[left + x_0, top + height - y_0], [left + x, top + height - y]])
        panel.over.append(path(polyline(ends), stroke=INK, width=0.5))
