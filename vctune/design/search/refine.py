"""Refine the local minima of a grid of designs between their neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.search.grid import Axes, Scores, evaluated, position_gain
from vctune.design.search.samples import Samples
from vctune.design.search.shapes import coupling_of
from vctune.design.search.start import Missed, Start
from vctune.model.gains import Gains
from vctune.model.problem import Problem

HALVINGS = 3  # Number of times that the code halves the grid spacing around a local minimum

Index = tuple[int, ...]  # Index of a design on a grid with the axes K_v, corner, tau_c and b_0


def minima_of(problem: Problem, scores: Scores) -> list[Index]:
    """Return the local minima among the feasible designs of a grid, the best first."""
    ranks = scores.ranks()
    if problem.transparency.weights.coupling > 0:
        return local_minima(ranks)
    return [(*loop, *lowest(scores[loop])) for loop in local_minima(ranks.min(axis=(2, 3)))]


def lowest(scores: Scores) -> Index:
    """Return the index of the best design of a grid."""
    return tuple(int(at[0]) for at in scores[None].lowest()[1:])


def local_minima(ranks: Floats) -> list[Index]:
    """Return the indices of the finite values on a grid that are not greater than any neighbour, the lowest first."""
    least = ranks
    for axis in range(ranks.ndim):  # take the least of each point's neighbourhood along one axis after the other
        before, after = (least.take(at, axis) for at in _beside(ranks.shape[axis]))
        least = np.minimum(least, np.minimum(before, after))
    found = np.argwhere((ranks <= least) & np.isfinite(ranks))
    order = np.argsort(ranks[tuple(found.T)], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]


def between_neighbours(grid: Axes, places: list[Index]) -> Axes:
    """Return small grids around designs: on each axis the design and its two neighbours, axes of shape (designs, 3)."""
    by_axis = np.array(places, dtype=np.intp).reshape(-1, len(grid.each())).T
    return Axes(*(_between(np.tile(axis, (at.size, 1)), at) for axis, at in zip(grid.each(), by_axis, strict=True)))


def refined(problem: Problem, samples: Samples, near: Axes) -> list[Start]:
    """Refine all local minima together."""
    if not len(near.velocity):
        return []
    for _ in range(HALVINGS):
        finer = [_finer(axis) for axis in near.each()]
        scores, _loops = evaluated(problem, samples, Axes(*(axis[:, 1:-1] for axis in finer)))
        at = scores.lowest()
        near = Axes(*(_between(axis, 1 + i) for axis, i in zip(finer, at[1:], strict=True)))
    best = scores[at]
    middles = zip(*(axis[:, 1] for axis in near.each()), strict=True)
    return [_start(problem, middle, best, k) for k, middle in enumerate(middles)]


def _beside(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices before and after each index of an axis; at an end, the index itself."""
    at = np.arange(size)
    return np.maximum(at - 1, 0), np.minimum(at + 1, size - 1)


def _between(axes: Floats, at: NDArray[np.intp]) -> Floats:
    """Return the value of each design and of its two neighbours on an axis, shape (designs, 3)."""
    beside = np.clip(at[:, None] + np.array([-1, 0, 1]), 0, axes.shape[1] - 1)
    return np.take_along_axis(axes, beside, axis=1)


def _finer(near: Floats) -> Floats:
    """Return three points on a logarithmic axis and the two midpoints between them; three equal points stay three."""
    low, middle, high = near.T
    if np.array_equal(low, high):
        return near
    middles = [np.where(a > 0, np.sqrt(a * b), b / 2) for a, b in ((low, middle), (middle, high))]
    return np.stack((low, middles[0], middle, middles[1], high), axis=1)


def _start(problem: Problem, at: tuple[float, ...], best: Scores, k: int) -> Start:
    K_v, corner, tau_c, drag = map(float, at)
    missed, violation, error = best.rank((k,))
    return Start(
        Gains(K_v, float(position_gain(problem, np.array(K_v), np.array(corner)))),
        coupling_of(problem, float(best.scale[k]), tau_c, drag),
        error,
        Missed(missed),
        violation,
    )
