"""The edge of the loops in order, where most good designs lie and where a grid of K_v sees only steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.grid import Axes, Order, order_of, position_gain, responses, scored
from vctune.design.samples import Samples
from vctune.design.zoom import around
from vctune.document.problem import Problem
from vctune.model.quantities import Gains

ROUNDS, PARTS = 3, 4
"""How often the step that the edge lies in is divided, and into how many parts."""
BELOW, ABOVE = 0.93, 1.03
"""Between which factors of a K_v on the edge its neighbours lie."""


@dataclass(frozen=True, slots=True)
class Edge:
    """The greatest K_v of each corner below the least whose loop is not in order; only corners that have one.

    Attributes
    ----------
    column, row : which of the grid's corners, and its last K_v below the edge there
    velocity : K_v on the edge
    score : of the designs there, shape (corners, 1, time constants, drags)
    """

    column: NDArray[np.intp]
    row: NDArray[np.intp]
    velocity: Floats
    score: Floats

    def places(self, problem: Problem, grid: Axes, minima: list[tuple[int, ...]]) -> Axes:
        """Return designs on the edge, by their indices in its score, between their neighbours: `zoom.around`."""
        near = around(grid, [(int(self.row[k]), int(self.column[k]), tau, drag) for k, _, tau, drag in minima])
        K_v, bounds = self.velocity[[k for k, *_ in minima]], problem.bounds.velocity
        beside = np.maximum(BELOW * K_v, bounds.min), K_v, np.minimum(ABOVE * K_v, bounds.max)
        return replace(near, velocity=np.stack(beside, axis=1))


def edge_of(problem: Problem, samples: Samples, grid: Axes, order: Order) -> Edge:
    """Find the edge between a grid's loops, corner by corner, all at once, and score the designs on it."""
    good = order.rank == 0
    last = good[:-1] & ~good[1:]
    column = np.flatnonzero(last.any(axis=0))
    if not column.size:
        nothing = (0, 1, grid.time_constant.size, grid.drag.size)
        return Edge(column, column, np.empty(0), np.empty(nothing))
    row = last[:, column].argmax(axis=0)
    low, high, corner = grid.velocity[row], grid.velocity[row + 1], grid.corner[column, None]
    t, places = np.arange(1, PARTS) / PARTS, np.arange(column.size)
    for _ in range(ROUNDS):
        K_v = low[:, None] + (high - low)[:, None] * t
        gains = Gains(K_v, position_gain(problem, K_v, corner))
        good = order_of(problem, samples, gains, responses(samples, gains)).rank == 0
        steps, at = np.column_stack((low, K_v, high)), np.logical_and.accumulate(good, axis=1).sum(axis=1)
        low, high = steps[places, at], steps[places, at + 1]
    on_edge = scored(problem, samples, replace(grid, velocity=low[:, None], corner=corner))
    return Edge(column, row, low, on_edge.score[:, 0])
