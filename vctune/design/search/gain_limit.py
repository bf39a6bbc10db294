"""The greatest feasible K_v at each corner frequency, where most good designs lie.

    K_v |     infeasible
        |  _____
        | /     `--..__  <- the limit, by |S| or by stability
        |/  feasible   `-.
        +----------------- corner K_p/(b + K_v)

The error falls with K_v up to the limit; half a step of the grid below it, it may be a third higher than on it. So the
limit is found first, by dividing the step that it lies in, and is then a grid of its own over the other three axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.search.feasibility import LoopFeasibility, loop_feasibility
from vctune.design.search.grid import Axes, Scores, evaluated, position_gain, responses
from vctune.design.search.refine import between_neighbours
from vctune.design.search.samples import Samples
from vctune.model.gains import Gains
from vctune.model.problem import Problem
from vctune.running import check_time

ROUNDS, PARTS = 3, 4
"""How often the step that contains the limit is divided, and into how many parts: 64 parts of a step, 1 % of K_v."""
BELOW, ABOVE = 0.93, 1.03
"""Between which factors of a limit its neighbours lie: below it the best design for the coupling, which may need some
gain less; above it little, since the limit is known to 1 % on the scan's frequencies."""


@dataclass(frozen=True, slots=True)
class GainLimits:
    """The greatest K_v of each corner below the least whose loop is infeasible; only of corners that have one.

    Attributes
    ----------
    corner, below : index of the grid's corner, and its last K_v below the limit there
    velocity : the limits
    scores : scores of the designs there, shape (corners, 1, time constants, drags)
    """

    corner: NDArray[np.intp]
    below: NDArray[np.intp]
    velocity: Floats
    scores: Scores

    def places(self, problem: Problem, grid: Axes, minima: list[tuple[int, ...]]) -> Axes:
        """Return designs at limits, by their indices in the scores, between their neighbours.

        Parameters
        ----------
        problem : problem, dimensionless
        grid : grid whose limits these are
        minima : indices of designs in `scores`

        Returns
        -------
        Axes
            The result has shape (minima, 3).
        """
        near = between_neighbours(
            grid, [(int(self.below[k]), int(self.corner[k]), tau, drag) for k, _, tau, drag in minima]
        )
        K_v, bounds = self.velocity[[k for k, *_ in minima]], problem.bounds.velocity
        beside = np.maximum(BELOW * K_v, bounds.min), K_v, np.minimum(ABOVE * K_v, bounds.max)
        return replace(near, velocity=np.stack(beside, axis=1))


def gain_limits(problem: Problem, samples: Samples, grid: Axes, loops: LoopFeasibility) -> GainLimits:
    """Find the limits between a grid's loops, corner by corner, all at once, and score the designs there.

    Parameters
    ----------
    problem : problem, dimensionless
    samples : samples of the scan
    grid : one grid of designs
    loops : violations of its loops, shape (velocities, corners)

    Returns
    -------
    GainLimits
        The limits and the scores of their designs; empty if no corner has one.
    """
    last = loops.feasible[:-1] & ~loops.feasible[1:]
    corner = np.flatnonzero(last.any(axis=0))
    if not corner.size:
        nothing = np.empty((0, 1, grid.time_constant.size, grid.drag.size))
        return GainLimits(corner, corner, np.empty(0), Scores(nothing.astype(np.int8), nothing, nothing, nothing))
    below = last[:, corner].argmax(axis=0)
    low, high, omega = grid.velocity[below], grid.velocity[below + 1], grid.corner[corner, None]
    t, places = np.arange(1, PARTS) / PARTS, np.arange(corner.size)
    for _ in range(ROUNDS):
        check_time()
        K_v = low[:, None] + (high - low)[:, None] * t
        gains = Gains(K_v, position_gain(problem, K_v, omega))
        good = loop_feasibility(problem, samples, gains, responses(samples, gains)).feasible
        steps, at = np.column_stack((low, K_v, high)), np.logical_and.accumulate(good, axis=1).sum(axis=1)
        low, high = steps[places, at], steps[places, at + 1]
    scores, _ = evaluated(problem, samples, replace(grid, velocity=low[:, None], corner=omega))
    return GainLimits(corner, below, low, scores[:, 0])
