"""A cheap global scan: starts for the optimiser in every basin it can see (DESIGN 1.9)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.grid import INADMISSIBLE, NEGATIVE, SENSITIVE, Axes, Grid, axes, position_gain, scored
from vctune.design.samples import Samples, samples_of
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains

ZOOMS, BETWEEN = 4, (0.25, 0.5, 0.75)
STARTS = 8
CLOSE = 0.02
AROUND = {"velocity": np.array([0.8, 0.9, 0.96, 0.99, 1.0, 1.02, 1.1]), "corner": np.geomspace(0.25, 4.0, 13)}
PROMISING = 3.0
"""A local minimum of the coarse grid is refined if its error is at most this many times the least."""


@dataclass(frozen=True, slots=True)
class Start:
    """A point worth polishing.

    Attributes
    ----------
    gains, coupling : the point
    error : its transparency error when admissible on the scan's frequencies, else above `INADMISSIBLE`
    """

    gains: Gains
    coupling: Coupling
    error: float

    @property
    def admissible(self) -> bool:
        """Whether the point met every demand at the scan's frequencies."""
        return self.error < INADMISSIBLE

    @property
    def workable(self) -> bool:
        """Whether its loop is stable with Re G_hh > 0, so that the optimiser's formulas are defined there."""
        return self.error < INADMISSIBLE * NEGATIVE

    @property
    def shortfall(self) -> float:
        """By how much it missed the worst of the demands, as the logarithm of a ratio; 0 for an admissible point."""
        return 0.0 if self.admissible else (self.error / INADMISSIBLE - 1) % SENSITIVE


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Starts, best first, and what the scan saw of the demands.

    Attributes
    ----------
    starts : local minima of the scan, best first
    peak_sensitivity : greatest |S| among stable loops with Re G_hh > 0
    """

    starts: list[Start]
    peak_sensitivity: float


def scan(problem: Problem) -> ScanResult:
    """Scan a dimensionless problem for starts.

    K_p = 0 is scanned by itself: the integrator's absence changes the low-frequency demands. Minima of the rest that
    lie at its lowest K_p belong to that basin and are left to it.
    """
    faces = _faces(problem)
    found: list[Start] = []
    peak = 0.0
    for integral in faces:
        coarse, samples = axes(problem, integral=integral), samples_of(problem, integrator=integral)
        grid = scored(problem, samples, coarse)
        sound = (grid.loops.deficit == 0) & grid.loops.stable
        peak = max(peak, float(grid.loops.sensitivity[sound].max(initial=0.0)))
        least = min([float(grid.score.min()), *(start.error for start in found)])
        for index in _candidates(problem, grid.score)[:STARTS]:
            vanishing = integral and False in faces and index[1] == 0
            if not vanishing and grid.score[index] <= PROMISING * least:
                found.append(_zoom(problem, samples, coarse, index))
    found.sort(key=lambda start: start.error)
    return ScanResult(_distinct(found)[:STARTS], peak)


def _faces(problem: Problem) -> list[bool]:
    """Return whether to search without and with an integrator, as far as the bounds and DESIGN 1.6 allow.

    With damping, without drag and without an operator's damping no K_p > 0 is admissible on a band from 0.
    """
    position, device = problem.bounds.position, problem.device
    barred = problem.stability.band.min == 0 and device.held.damping == device.damping > 0
    faces = [False] if position.min == 0 else []
    return [*faces, True] if position.max > 0 and not (barred and problem.bounds.drag.max == 0) else faces


def rescan(problem: Problem, gains: Gains) -> Start | None:
    """Scan around polished gains, with every coupling: the best design of another coupling may be a basin away."""
    integral = gains.position > 0
    coarse, samples = axes(problem, integral=integral), samples_of(problem, integrator=integral)
    bounds = problem.bounds
    K_v = np.unique(np.clip(gains.velocity * AROUND["velocity"], bounds.velocity.min, bounds.velocity.max))
    corner = gains.position / (problem.device.damping + gains.velocity) * (AROUND["corner"] if integral else np.ones(1))
    fine = Axes(K_v, corner, coarse.time_constant, coarse.drag)
    grid = scored(problem, samples, fine)
    at = _lowest(grid)
    return _zoom(problem, samples, fine, at) if grid.score[at] < INADMISSIBLE else None


def _candidates(problem: Problem, score: Floats) -> list[tuple[int, ...]]:
    """Return the local minima of a grid; where the coupling costs nothing, over the loops only."""
    if problem.transparency.weights.coupling > 0:
        return _local_minima(score)
    flat = score.reshape(*score.shape[:2], -1)
    best = flat.argmin(axis=-1)
    return [
        (*loop, *(int(i) for i in np.unravel_index(int(best[loop]), score.shape[2:])))
        for loop in _local_minima(flat.min(axis=-1))
    ]


def _local_minima(score: Floats) -> list[tuple[int, ...]]:
    """Return the indices of grid points not above any neighbour, lowest first."""
    padded = np.pad(score, 1, constant_values=np.inf)
    lowest = np.ones(score.shape, dtype=bool)
    for offset in product(*((-1, 0, 1) if n > 1 else (0,) for n in score.shape)):
        window = tuple(slice(1 + d, 1 + d + n) for d, n in zip(offset, score.shape, strict=True))
        lowest &= score <= padded[window]
    found = np.argwhere(lowest)
    order = np.argsort(score[lowest], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]


def _zoom(problem: Problem, samples: Samples, coarse: Axes, index: tuple[int, ...]) -> Start:
    """Refine a grid minimum between its neighbours."""
    at, fine = index, coarse
    for _ in range(ZOOMS):
        fine = Axes(*(_between(axis, i) for axis, i in zip(fine.each(), at, strict=True)))
        grid = scored(problem, samples, fine)
        at = _lowest(grid)
    return _start(problem, fine, grid, at)


def _lowest(grid: Grid) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(int(np.argmin(grid.score)), grid.score.shape))


def _between(axis: Floats, i: int) -> Floats:
    low, middle, high = float(axis[max(i - 1, 0)]), float(axis[i]), float(axis[min(i + 1, axis.size - 1)])
    if low == high:
        return np.array([middle])
    spread = [low * (high / low) ** t if low > 0 else high * t for t in BETWEEN]
    return np.array(sorted({low, *spread, middle, high}))


def _start(problem: Problem, fine: Axes, grid: Grid, at: tuple[int, ...]) -> Start:
    K_v, corner, tau_c, drag = (axis[i] for axis, i in zip(fine.each(), at, strict=True))
    b_c, bounds = grid.damping[at], problem.bounds
    return Start(
        Gains(float(K_v), float(position_gain(problem, K_v, corner))),
        Coupling(
            float(np.clip(b_c, bounds.damping.min, bounds.damping.max)),
            float(np.clip(b_c * tau_c, bounds.mass.min, bounds.mass.max)),
            float(drag),
        ),
        float(grid.score[at]),
    )


def _distinct(starts: list[Start]) -> list[Start]:
    kept: list[Start] = []
    for start in starts:
        if not any(np.allclose(_numbers(start), _numbers(other), rtol=CLOSE, atol=0) for other in kept):
            kept.append(start)
    return kept


def _numbers(start: Start) -> list[float]:
    gains, coupling = start.gains, start.coupling
    return [gains.velocity, gains.position, coupling.damping, coupling.mass, coupling.drag]
