"""Local minima of scanned grids, refined between their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.grid import INADMISSIBLE, NEGATIVE, SENSITIVE, Axes, position_gain, scored
from vctune.design.samples import Samples
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains

ZOOMS = 3
"""How often the grid around a local minimum is refined, its spacing halved."""


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


def minima_of(problem: Problem, score: Floats) -> list[tuple[int, ...]]:
    """Return the local minima of a grid; where the coupling costs nothing, over the loops only."""
    if problem.transparency.weights.coupling > 0:
        return _local_minima(score)
    flat = score.reshape(*score.shape[:2], score.shape[2] * score.shape[3])
    best = flat.argmin(axis=-1)
    return [
        (*loop, *(int(i) for i in np.unravel_index(int(best[loop]), score.shape[2:])))
        for loop in _local_minima(flat.min(axis=-1))
    ]


def _local_minima(score: Floats) -> list[tuple[int, ...]]:
    """Return the indices of grid points not above any neighbour, lowest first."""
    least = score
    for axis in range(score.ndim):  # the least of each point's neighbourhood, one axis after the other
        before, after = (least.take(at, axis) for at in _beside(score.shape[axis]))
        least = np.minimum(least, np.minimum(before, after))
    found = np.argwhere(score <= least)
    order = np.argsort(score[tuple(found.T)], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]


def _beside(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the places before and after each one on an axis, the place itself at an end."""
    at = np.arange(size)
    return np.maximum(at - 1, 0), np.minimum(at + 1, size - 1)


def lowest(score: Floats) -> tuple[int, ...]:
    """Return the index of the least score."""
    return tuple(int(i) for i in np.unravel_index(int(np.argmin(score)), score.shape))


def around(grid: Axes, minima: list[tuple[int, ...]]) -> Axes:
    """Return places of a grid, each between its neighbours: axes of shape (places, 3)."""
    places = np.array(minima, dtype=np.intp).reshape(-1, 4).T
    return Axes(*(_between(np.tile(axis, (at.size, 1)), at) for axis, at in zip(grid.each(), places, strict=True)))


def zoomed(problem: Problem, samples: Samples, near: Axes) -> list[Start]:
    """Refine local minima, all of them together.

    Parameters
    ----------
    problem : dimensionless
    samples : where to look
    near : each minimum between its neighbours, axes of shape (minima, 3)
    """
    if not len(near.velocity):
        return []
    for _ in range(ZOOMS):
        finer = [_finer(axis) for axis in near.each()]
        grid = scored(problem, samples, Axes(*(axis[:, 1:-1] for axis in finer)))
        at = np.array([lowest(score) for score in grid.score]).T
        near = Axes(*(_between(axis, 1 + i) for axis, i in zip(finer, at, strict=True)))
    middles = zip(*(axis[:, 1] for axis in near.each()), strict=True)
    return [
        _start(problem, middle, float(grid.damping[k, *at[:, k]]), float(grid.score[k, *at[:, k]]))
        for k, middle in enumerate(middles)
    ]


def _between(axes: Floats, at: NDArray[np.intp]) -> Floats:
    """Return a place on each of several axes between its neighbours."""
    beside = np.clip(at[:, None] + np.array([-1, 0, 1]), 0, axes.shape[1] - 1)
    return np.take_along_axis(axes, beside, axis=1)


def _finer(near: Floats) -> Floats:
    """Return the places with the middles between them, on a logarithmic axis; a fixed number stays one place."""
    low, middle, high = near.T
    if np.array_equal(low, high):
        return near
    middles = [np.where(a > 0, np.sqrt(a * b), b / 2) for a, b in ((low, middle), (middle, high))]
    return np.stack((low, middles[0], middle, middles[1], high), axis=1)


def _start(problem: Problem, at: tuple[float, ...], b_c: float, error: float) -> Start:
    (K_v, corner, tau_c, drag), bounds = at, problem.bounds
    return Start(
        Gains(float(K_v), float(position_gain(problem, np.array(K_v), np.array(corner)))),
        Coupling(
            float(np.clip(b_c, bounds.damping.min, bounds.damping.max)),
            float(np.clip(b_c * tau_c, bounds.mass.min, bounds.mass.max)),
            float(drag),
        ),
        error,
    )
