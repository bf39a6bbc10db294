"""Find the extrema of a function of frequency. The code evaluates a logarithmic grid, and refines the local extrema."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from vctune.running import check_time

Floats = NDArray[np.float64]

POINTS_PER_DECADE = 60  # Points per decade of the grid; neighbours are 4 % apart
ZOOMS = 3  # Number of rounds with a finer grid
ZOOM_POINTS = 17  # Number of points of a finer grid, including both ends


@dataclass(frozen=True, slots=True)
class Minima:
    """Frequencies, rad/s, and values of local minima, the lowest first."""

    omega: Floats
    value: Floats


@lru_cache(maxsize=16)
def frequency_grid(
    omega_min: float, omega_max: float, points_per_decade: int = POINTS_PER_DECADE, widest: float = inf
) -> Floats:
    """Return a logarithmic grid that contains both ends exactly."""
    decades = np.log10(omega_max / omega_min)
    grid = np.geomspace(omega_min, omega_max, max(9, int(np.ceil(decades * points_per_decade)) + 1))
    wide = np.flatnonzero(np.diff(grid) > widest)
    if wide.size:
        count = int(np.ceil((omega_max - grid[wide[0]]) / widest)) + 1
        grid = np.append(grid[: wide[0]], np.linspace(grid[wide[0]], omega_max, count))
    grid[0], grid[-1] = omega_min, omega_max
    grid.setflags(write=False)
    return grid


def local_minima(f: Callable[[Floats], Floats], grid: Floats) -> Minima:
    """Find the local minima of f over the grid's span, ends included."""

    def value(omega: Floats) -> Floats:
        values = f(omega)
        return np.where(np.isnan(values), np.inf, values)

    values = value(grid)
    padded = np.concatenate(([np.inf], values, [np.inf]))
    at = np.flatnonzero(
        (values <= padded[:-2]) & (values < padded[2:]) | (values < padded[:-2]) & (values <= padded[2:])
    )
    if at.size == 0:
        at = np.array([int(np.argmin(values))])
    lower, upper = grid[np.maximum(at - 1, 0)], grid[np.minimum(at + 1, grid.size - 1)]
    best, lowest = grid[at], values[at]
    position = np.linspace(0.0, 1.0, ZOOM_POINTS)
    rows = np.arange(at.size)
    for _ in range(ZOOMS):
        check_time()
        points = lower[:, None] * (upper / lower)[:, None] ** position
        points[:, 0], points[:, -1] = lower, upper
        fine = value(points)
        k = np.argmin(fine, axis=1)
        better = fine[rows, k] < lowest
        best, lowest = np.where(better, points[rows, k], best), np.where(better, fine[rows, k], lowest)
        lower, upper = points[rows, np.maximum(k - 1, 0)], points[rows, np.minimum(k + 1, ZOOM_POINTS - 1)]
    vertex = np.clip(_vertex(points, fine, rows, k), lower, upper)
    at_vertex = value(vertex)
    better = at_vertex < lowest
    best, lowest = np.where(better, vertex, best), np.where(better, at_vertex, lowest)
    order = np.argsort(lowest, kind="stable")
    return Minima(best[order], lowest[order])


def _vertex(points: Floats, values: Floats, rows: NDArray[np.intp], k: NDArray[np.intp]) -> Floats:
    """Return the minima of the parabolas through the k-th points and their neighbours."""
    middle = np.clip(k, 1, ZOOM_POINTS - 2)
    left, centre, right = (values[rows, middle + side] for side in (-1, 0, 1))
    with np.errstate(all="ignore"):
        shift = 0.5 * (left - right) / (left - 2 * centre + right)
    place = points[rows, middle]
    step = np.where(shift > 0, points[rows, middle + 1] - place, place - points[rows, middle - 1])
    return np.where(np.isfinite(shift) & (k == middle), place + shift * step, points[rows, k])
