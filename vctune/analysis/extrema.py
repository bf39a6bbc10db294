"""Find the extrema of a function of frequency: evaluate a logarithmic grid, with more points at a resonance, and refine
the local extrema."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.mechanism import chain
from vctune.model.numbers.arithmetic import FLOATS
from vctune.running import check_time

# Range around a structure's resonances in which the relative spacing of the grid is half their damping ratio, and the
# finest relative spacing
RESONANCE_REACH, NARROWEST = 1.1, 2e-3
NARROWER = 6.0  # Number of points that a drawn curve has within the width of a resonance


def with_resonance(device: Device, grid: Floats) -> Floats:
    """Return a grid, rad/s, with more frequencies between the resonances of a held motor and of a free one."""
    return _around(device, grid, 1.0)


def round_at_resonance(device: Device, hz: Floats) -> Floats:
    """Return frequencies with more of them around a structure's resonance, so that a curve over them looks smooth."""
    return _around(device, 2 * pi * hz, NARROWER) / (2 * pi) if device.modes else hz


def _around(device: Device, grid: Floats, finer: float) -> Floats:
    if not device.modes:
        return grid
    # half the damping ratio, a quarter of the relative width 2 zeta of a resonance
    ratio = min(float(mode.damping_ratio) for mode in device.modes) / finer
    step = min(max(ratio / 2, NARROWEST), 0.02)
    for held, free in zip(*_resonances(device), strict=True):
        low, high = max(grid[0], held / RESONANCE_REACH), min(grid[-1], free * RESONANCE_REACH)
        if low < high:  # 1 + int(...) steps, so that no step exceeds `step`, and one more frequency than steps
            grid = np.union1d(grid, np.geomspace(low, high, 2 + int(np.log(high / low) / step)))
    return grid


def _resonances(device: Device) -> tuple[Floats, Floats]:
    """Return the resonances behind a motor that stands still, with the handle's load, and those of a free motor without
    it, rad/s; each of the first is below one of the second."""
    of = chain(device, FLOATS)
    masses = np.array([*of.masses.values()], float)
    stiffness = np.zeros((masses.size, masses.size))
    for k, link in enumerate(of.links):
        stiffness[k : k + 2, k : k + 2] += float(link.stiffness) * np.array([[1, -1], [-1, 1]])
    free = masses.copy()
    free[-1] = float(device.modes[-1].handle_mass)

    def swings(matrix: Floats, mass: Floats) -> Floats:
        root = 1 / np.sqrt(mass)
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(matrix * root * root[:, None]), 0.0)))

    return swings(stiffness[1:, 1:], masses[1:]), swings(stiffness, free)[1:]


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


def last_to_hold(holds: Callable[[float], bool], good: float, bad: float, halvings: int) -> float:
    """Return the number nearest to `bad` for which a condition holds, of halvings between one that has it and one that
    has it not."""
    for _ in range(halvings):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


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
