"""Strong branching: halve boxes along every axis on trial, and keep the halves of the axis that raises the bound
most."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from vctune.design.bound.design_boxes import K_P, Axis, DesignBoxes, halves
from vctune.design.bound.lower_bounds import LowerBounds, lower_bounds, without_integrator
from vctune.design.bound.nodes import OpenNodes, joined
from vctune.design.bound.relaxation import Relaxation
from vctune.model.problem import Problem
from vctune.proof.enclosures.intervals import Flags, Floats

BETTER_HALF = 0.1  # Weight of the greater increase relative to the smaller one
LENGTH = 1e-2  # Weight, in the score, of the share of an axis that a box spans
DIGITS = 9  # Number of decimals to which the code rounds scores before it compares them


@dataclass(frozen=True, slots=True)
class Halved:
    """Boxes after halving each along its best axis."""

    nodes: OpenNodes  # two nodes for each box
    along_gains: Flags
    worked_out: int  # number of lower bounds computed


@dataclass(frozen=True, slots=True)
class _Candidate:
    """The halves of all boxes along one axis, lower and upper, with their bounds; `row` is the row of the axis."""

    row: int
    halves: tuple[DesignBoxes, DesignBoxes]
    bounds: tuple[LowerBounds, LowerBounds]


def halved(
    relaxed: Relaxation, axes: Sequence[Axis], parents: OpenNodes, incumbent: float, pool: ThreadPoolExecutor
) -> Halved:
    """Halve each box along the axis with the greatest score."""
    candidates = _candidates(relaxed, axes, parents.boxes, pool)
    if not candidates:
        error = np.maximum(lower_bounds(relaxed, parents.boxes).error, parents.bound)
        return Halved(replace(parents, bound=error), np.zeros(len(parents), bool), len(parents))
    best = _best_axis(axes, candidates, parents, incumbent)
    children: list[OpenNodes] = []
    along_gains: list[Flags] = []
    for number, candidate in enumerate(candidates):
        chosen = best == number
        for half, bounds in zip(candidate.halves, candidate.bounds, strict=True):
            error = np.maximum(bounds.error, parents.bound)
            children.append(OpenNodes(half.subset(chosen), error[chosen], parents.stable[chosen]))
            along_gains.append(np.full(len(children[-1]), candidate.row <= K_P))
    return Halved(joined(children), np.concatenate(along_gains), 2 * len(candidates) * len(parents))


def _candidates(
    relaxed: Relaxation, axes: Sequence[Axis], boxes: DesignBoxes, pool: ThreadPoolExecutor
) -> list[_Candidate]:
    rows = [row for row, axis in enumerate(axes) if axis.low < axis.high]
    pairs = [halves(axes[row], row, boxes) for row in rows]
    tried = [_without_idle_position(relaxed.problem, half) for pair in pairs for half in pair]
    bounds = list(pool.map(lambda half: lower_bounds(relaxed, half), tried))
    return [
        _Candidate(row, (tried[2 * k], tried[2 * k + 1]), (bounds[2 * k], bounds[2 * k + 1]))
        for k, row in enumerate(rows)
    ]


def _best_axis(
    axes: Sequence[Axis], candidates: list[_Candidate], parents: OpenNodes, incumbent: float
) -> NDArray[np.intp]:
    """Return the index of the candidate with the greatest score, for each box."""
    # the search prunes a half whose bound is far above the incumbent, so the score caps such a bound
    most = 2 * incumbent if incumbent < inf else 1.0
    scores = []
    for candidate in candidates:
        one, two = (np.minimum(_worth(bounds, parents, incumbent), most) for bounds in candidate.bounds)
        row = candidate.row
        length = axes[row].share(parents.boxes.low[row], parents.boxes.high[row])
        scores.append(np.minimum(one, two) + BETTER_HALF * np.maximum(one, two) + LENGTH * most * length)
    best: NDArray[np.intp] = np.argmax(np.round(np.array(scores) / most, DIGITS), axis=0)
    return best


def _worth(bounds: LowerBounds, parents: OpenNodes, incumbent: float) -> Floats:
    return np.maximum(bounds.error, parents.bound) if incumbent < inf else bounds.infeasibility


def _without_idle_position(problem: Problem, boxes: DesignBoxes) -> DesignBoxes:
    """Return the boxes; a box that contains K_p = 0, but no feasible design with K_p > 0, shrinks to K_p = 0."""
    high = boxes.high.copy()
    high[K_P, (boxes.low[K_P] == 0) & without_integrator(problem, boxes)] = 0.0
    return DesignBoxes(boxes.low, high)
