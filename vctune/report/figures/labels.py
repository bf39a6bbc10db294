"""Labels beside the curves that they name, where there is room; a legend names the others.

The axes are a raster of points (1/72 inch). The distance of each to the nearest curve gives the room around a label at
every place at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.report.figures.style import INK, legend_above

Mask = NDArray[np.bool_]
SIZE = 7.8
"""Points of a label."""
LETTER, LINE = 0.54, 1.2
"""Width of a letter and height of a line over the size: rather more than most fonts have."""
ROOM, ENOUGH = 2, 12
"""Least distance from a label to a curve, and the distance from which on more is no better, points."""
NEAR = 6.0
"""Greatest distance from a label to its curve, points. From further on a line leads from a point to its label."""
FAR = 0.15
"""Points of room that a point of distance to the named point is worth."""


def label_curves(axes: Axes, columns: int = 2) -> None:
    """Write each curve's, point's and area's name beside it, or into a legend above the axes if there is no room.

    Parameters
    ----------
    axes : axes with labelled artists, final limits and their place in a figure
    columns : columns of the legend
    """
    figure = axes.get_figure()
    assert figure is not None, "axes are on a figure"
    width, height = (72 / figure.dpi * length for length in axes.get_window_extent().size)
    shape = int(height) + 1, int(width) + 1
    to_points = axes.transAxes.inverted()

    def placed(points: Floats) -> Floats:
        return np.asarray(to_points.transform(points) * (width, height))

    drawn: dict[Artist, Mask] = {line: _of_line(placed(_ends(line)), shape) for line in axes.lines}
    drawn |= {area: _of_area(area, placed, shape) for area in axes.patches if isinstance(area, Polygon)}
    taken = np.zeros(shape, bool)
    taken[[0, -1]] = taken[:, [0, -1]] = True
    for each in drawn.values():
        taken |= each
    left: list[Artist] = []
    named = [each for each in (*axes.lines, *axes.patches) if not str(each.get_label()).startswith("_")]
    for artist in sorted(named, key=lambda each: drawn[each].sum() if each in drawn else np.inf):
        text = str(artist.get_label())
        rows, letters = text.count("\n") + 1, max(map(len, text.split("\n")))
        size = int(LINE * SIZE * rows) + 1, int(LETTER * SIZE * letters) + 1
        alone = isinstance(artist, Line2D) and np.size(artist.get_xdata(orig=False)) == 1
        if artist in drawn:
            place = _beside(taken, drawn[artist], size, alone=alone)
        else:
            extent = placed(np.asarray(artist.get_window_extent()))
            place = _within(taken, extent, size)
        if place is None:
            left.append(artist)
            continue
        y, x = place
        taken[max(y - size[0] // 2, 0) : y + size[0] // 2 + 1, max(x - size[1] // 2, 0) : x + size[1] // 2 + 1] = True
        style: Any = {"fontsize": SIZE, "ha": "center", "va": "center", "linespacing": 1.05}
        axes.text(x / width, y / height, text, transform=axes.transAxes, **style)
        if alone and (point := np.argwhere(drawn[artist])).size:
            _lead(axes, point.mean(axis=0), place, size, (height, width))
    if left:
        legend_above(axes, columns, handles=left)


def _ends(line: Line2D) -> Floats:
    """Return the points of a line on the screen."""
    x, y = (np.asarray(each, float) for each in (line.get_xdata(orig=False), line.get_ydata(orig=False)))
    with np.errstate(all="ignore"):
        points = line.get_transform().transform(np.stack(np.broadcast_arrays(x, y), axis=1))
    return np.asarray(points[np.isfinite(points).all(axis=1)])


def _of_line(points: Floats, shape: tuple[int, int]) -> Mask:
    """Return which cells a line passes."""
    mask, points = np.zeros(shape, bool), np.clip(points, -1e4, 1e4)
    if len(points) > 1:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        at = np.linspace(0, along[-1], int(along[-1]) + 2)
        points = np.stack([np.interp(at, along, points[:, k]) for k in (0, 1)], axis=1)
    x, y = np.round(points).astype(int).T if len(points) else (np.empty(0, int), np.empty(0, int))
    seen = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    mask[y[seen], x[seen]] = True
    return mask


def _of_area(area: Polygon, placed: Any, shape: tuple[int, int]) -> Mask:
    """Return which cells a hatched area covers, which no label may."""
    path = type(area.get_path())(placed(area.get_transform().transform(area.get_xy())))
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.asarray(path.contains_points(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(shape))


def _room(taken: Mask, size: tuple[int, int]) -> Floats:
    """Return the distance from a box around each cell to the nearest one that is taken; -1 if it covers one."""
    (rows, columns), room = taken.shape, np.full(taken.shape, -1.0)
    around = [(each // 2 + ENOUGH + 1, each // 2 + ENOUGH) for each in size]
    total = np.pad(taken, around).cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    for distance in range(ENOUGH + 1):
        high, wide = (2 * (each // 2 + distance) + 1 for each in size)
        start = ENOUGH - distance
        first, second, third, last = (
            total[y : y + rows, x : x + columns] for y in (start, start + high) for x in (start, start + wide)
        )
        room[first + last == second + third] = distance
    return room


def _beside(taken: Mask, own: Mask, size: tuple[int, int], *, alone: bool) -> tuple[int, int] | None:
    """Return the middle of the box beside a line, or around a point that is alone, with the most room."""
    if not own.any():
        return None
    if alone:
        places = np.meshgrid(*map(np.arange, own.shape), indexing="ij")
        point = np.argwhere(own).mean(axis=0)
        y, x = (np.maximum(abs(at - of) - side / 2, 0) for at, of, side in zip(places, point, size, strict=True))
        room, apart = _room(taken, size), np.hypot(y, x)
        return _best(np.where((room >= ROOM) & (apart >= NEAR), room - FAR * apart, -np.inf))
    room, apart = _room(taken & ~own, size), _room(own, size)
    return _best(np.where((room >= ROOM) & (apart >= ROOM) & (apart <= NEAR), room - apart, -np.inf))


def _within(taken: Mask, extent: Floats, size: tuple[int, int]) -> tuple[int, int] | None:
    """Return the middle of the box with the most room in the columns of an area."""
    room = _room(taken, size)
    x = np.arange(taken.shape[1])
    inside = (x - size[1] / 2 >= extent[0, 0] - 1) & (x + size[1] / 2 <= extent[1, 0] + 1)
    return _best(np.where((room >= ROOM) & inside, room, -np.inf))


def _best(score: Floats) -> tuple[int, int] | None:
    y, x = np.unravel_index(int(np.argmax(score)), score.shape)
    return (int(y), int(x)) if np.isfinite(score[y, x]) else None


def _lead(axes: Axes, point: Floats, middle: tuple[int, int], size: tuple[int, int], of: tuple[float, float]) -> None:
    """Draw a thin line from a point to its label, if they are apart."""
    half = np.array(size) / 2
    end = np.clip(point, middle - half, middle + half)
    if np.hypot(*(end - point)) > 2 * NEAR:
        (y_0, x_0), (y, x) = point / of, end / of
        style: Any = {"color": INK, "linewidth": 0.5, "transform": axes.transAxes, "label": "_leader"}
        axes.plot([x_0, x], [y_0, y], scalex=False, scaley=False, **style)
