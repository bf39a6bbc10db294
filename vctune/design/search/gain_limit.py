"""Find the greatest feasible K_v at each corner frequency, where most good designs lie."""

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

# Number of times that the code divides the step with the limit, and number of parts of each division
ROUNDS, PARTS = 3, 4
BELOW, ABOVE = 0.93, 1.03  # Factors of the limit that give the neighbours of a design at the limit


@dataclass(frozen=True, slots=True)
class GainLimits:
    """The greatest feasible K_v at each corner frequency at which the grid contains a limit."""

    corner: NDArray[np.intp]  # index of the corner in the grid, and index of the last K_v of the grid below the limit
    below: NDArray[np.intp]
    velocity: Floats  # greatest feasible K_v, accurate to 1 %
    scores: Scores  # scores of the designs at the limits, shape (corners, 1, time constants, drags)

    def places(self, problem: Problem, grid: Axes, minima: list[tuple[int, ...]]) -> Axes:
        """Return small grids around designs at the limits: on each axis the design and its two neighbours."""
        near = between_neighbours(
            grid, [(int(self.below[k]), int(self.corner[k]), tau, drag) for k, _, tau, drag in minima]
        )
        K_v, bounds = self.velocity[[k for k, *_ in minima]], problem.bounds.velocity
        beside = np.maximum(BELOW * K_v, bounds.min), K_v, np.minimum(ABOVE * K_v, bounds.max)
        return replace(near, velocity=np.stack(beside, axis=1))


def gain_limits(problem: Problem, samples: Samples, grid: Axes, loops: LoopFeasibility) -> GainLimits:
    """Find the greatest feasible K_v at all corners of a grid at once, and score the designs with these K_v."""
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
