"""Strong branching: halve boxes along every axis on trial, and keep the halves of the axis that gains the most.

The rule is that of Achterberg, Koch, Martin (2005), section 2. The score of an axis is a weighted sum of the gains of
its worse and its better half,

    score = min(gain_1, gain_2) + BETTER_HALF max(gain_1, gain_2),

with the worse half first, because it becomes the bound of the box. The code compares bounds instead of gains, since all
axes of a box start from the same bound.
"""

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
from vctune.proof.enclosures.array_intervals import Flags, Floats

BETTER_HALF = 0.1
"""Weight of the better half relative to the worse. It is 0.2 in the paper's mixed-integer programs (mu = 1/6)."""
LENGTH = 1e-2
"""Weight of the share of its axis that a box spans, relative to the incumbent's error. It decides while no axis gains
anything, as at the root, and it is less than a gain that matters. With 0, a search without gain might halve one axis
forever."""
DIGITS = 9
"""Number of digits after which scores count as equal, so that rounding errors, which differ between machines, do not
choose an axis."""


@dataclass(frozen=True, slots=True)
class Halved:
    """Boxes after halving each along its best axis.

    Attributes
    ----------
    nodes : two nodes for each box
    along_gains : whether each box was halved along K_v or K_p, so that its loops may have become provably stable
    worked_out : number of lower bounds computed
    """

    nodes: OpenNodes
    along_gains: Flags
    worked_out: int


@dataclass(frozen=True, slots=True)
class _Candidate:
    """An axis along which all boxes are halved on trial, with the bounds of the lower and upper halves."""

    row: int
    halves: tuple[DesignBoxes, DesignBoxes]
    bounds: tuple[LowerBounds, LowerBounds]


def halved(
    relaxed: Relaxation, axes: Sequence[Axis], parents: OpenNodes, incumbent: float, pool: ThreadPoolExecutor
) -> Halved:
    """Halve each box along the axis that raises its lower bound the most.

    If no axis has an extent, bound the box again.

    While no design is known, the greatest infeasibility of a box replaces its bound.

    Parameters
    ----------
    relaxed : the relaxed problem
    axes : axes of the designs, in the order of the rows of `DesignBoxes`
    parents : n open boxes
    incumbent : error of the best known design; inf without one
    pool : threads that share the lower bounds

    Returns
    -------
    Halved
        2 n boxes, or the same n boxes if no axis has an extent.
    """
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
    """Return the best candidate for each box."""
    most = 2 * incumbent if incumbent < inf else 1.0  # a half beyond this is pruned, by however much it exceeds it
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
    """Return the boxes, reduced to K_p = 0 where they include it and no feasible design in them has K_p > 0."""
    high = boxes.high.copy()
    high[K_P, (boxes.low[K_P] == 0) & without_integrator(problem, boxes)] = 0.0
    return DesignBoxes(boxes.low, high)
