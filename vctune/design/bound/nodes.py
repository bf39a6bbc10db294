"""The open nodes of the branch and bound, which are boxes that may contain a better design: how they are halved, and
proofs that all of their loops, or none of them, are stable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from vctune.design.bound.quadratics import K_P
from vctune.design.bound.relaxation import Relaxation, lower_bounds, without_integrator
from vctune.design.prepared import Posed
from vctune.design.search.shapes import SLACK
from vctune.design.variables import coordinates
from vctune.model.problem import Problem, Range
from vctune.proof.boxes import Cells, Integers
from vctune.proof.claims.cells import by_integrator, pole_turns
from vctune.proof.claims.loop_claims import of_cells
from vctune.proof.enclosures.intervals import Flags, Floats

BETTER_HALF = 0.1  # Weight of the greater bound of two halves relative to the smaller one
LENGTH = 1e-2  # Weight, in the score, of the share of an axis that a box spans
DIGITS = 9  # Number of decimals to which the code rounds scores before it compares them


@dataclass(frozen=True, slots=True)
class Axes:
    """The variables K_v, K_p, tau_c and b_0, with the coordinate log(scale + x) in which the search halves them."""

    whole: Cells  # the box of all designs, SI units
    scale: Floats  # >= 0, shape (4, 1)

    @property
    def free(self) -> list[int]:
        """The rows of the variables that are not fixed."""
        return np.flatnonzero(self.whole.low < self.whole.high).tolist()

    def middle(self, boxes: Cells) -> Floats:
        """Return the points at which the search halves boxes: their midpoints in the coordinate."""
        root = np.sqrt(self.scale + boxes.low) * np.sqrt(self.scale + boxes.high)
        return np.clip(root - self.scale, boxes.low, boxes.high)

    def share(self, boxes: Cells) -> Floats:
        """Return the share of each axis that the boxes span; nan for a fixed variable."""
        length, whole = (np.log((self.scale + x.high) / (self.scale + x.low)) for x in (boxes, self.whole))
        return np.asarray(length / whole)


def axes_of(problem: Problem) -> Axes:
    """Return the variables of a problem in SI units."""
    impedance, time, bounds = problem.transparency.reference_impedance, problem.device.sample_time, problem.bounds
    scaled = coordinates(problem.in_units(impedance, time), integrator=True)
    scale = {c.name: c.scale * impedance for c in scaled}
    above, below = (bounds.damping, bounds.stiffness) if problem.device.kind.inverse else (bounds.mass, bounds.damping)
    tau_c = Range(above.min / below.max, above.max / below.min)
    ranges = bounds.velocity, bounds.position, tau_c, bounds.drag
    scales = [
        scale.get("velocity", 0.0),
        scale.get("position", 0.0) / time,
        SLACK * time if tau_c.min == 0 < tau_c.max else 0.0,
        scale.get("drag", 0.0),
    ]
    low, high, scale_ = np.array([(of.min, of.max, size) for of, size in zip(ranges, scales, strict=True)]).T[
        :, :, None
    ]
    return Axes(Cells(low, high), scale_)


@dataclass(frozen=True, slots=True)
class OpenNodes:
    """Boxes that the search has neither pruned nor halved."""

    boxes: Cells  # n boxes: [low, high] in each of K_v, K_p, tau_c and b_0, SI units
    bound: Floats  # a lower bound on the error in each box, shape (n,)
    stable: Flags  # whether all loops of the box are proved stable, shape (n,)

    def __len__(self) -> int:
        return len(self.bound)

    def subset(self, which: Flags | Integers) -> OpenNodes:
        """Return some of the nodes."""
        return OpenNodes(self.boxes.subset(which), self.bound[which], self.stable[which])

    @property
    def lowest(self) -> float:
        """The least lower bound; inf if no node is open."""
        return float(self.bound.min(initial=np.inf))


def joined(parts: Sequence[OpenNodes]) -> OpenNodes:
    """Return several sets of nodes as one set."""
    boxes = Cells(*(np.hstack([getattr(part.boxes, edge) for part in parts]) for edge in ("low", "high")))
    return OpenNodes(boxes, *(np.concatenate([getattr(part, of) for part in parts]) for of in ("bound", "stable")))


def halved(relaxed: Relaxation, axes: Axes, parents: OpenNodes, incumbent: float) -> tuple[OpenNodes, Flags, int]:
    """Return nodes halved along the axis that raises their bounds most, whether that is a gain's, and the number of
    computed bounds. The worse half counts most, because it becomes the bound of the box."""
    n, rows = len(parents), axes.free
    if not rows:
        bound = np.maximum(lower_bounds(relaxed, parents.boxes)[0], parents.bound)
        return replace(parents, bound=bound), np.zeros(n, bool), n
    middle = axes.middle(parents.boxes)
    tried = [_halves(relaxed, parents, row, middle[row]) for row in rows]
    # a half far above the incumbent is pruned, however far; without one, a half goes whose designs exceed a limit
    gained = [each.bound / (2 * incumbent) if incumbent < inf else excess for each, excess in tried]
    worth = np.minimum(np.reshape(gained, (len(rows), 2, n)), 1.0)
    score = worth.min(axis=1) + BETTER_HALF * worth.max(axis=1) + LENGTH * axes.share(parents.boxes)[rows]
    best = np.tile(np.argmax(np.round(score, DIGITS), axis=0), 2)
    chosen = joined([each.subset(best == k) for k, (each, _) in enumerate(tried)])
    return chosen, np.sort(best) < sum(row <= K_P for row in rows), 2 * n * len(rows)


def _halves(relaxed: Relaxation, parents: OpenNodes, row: int, middle: Floats) -> tuple[OpenNodes, Floats]:
    """Return the lower and then the upper halves of nodes along an axis, and their excess over limits. A half that
    contains K_p = 0, but no feasible design with K_p > 0, shrinks to K_p = 0."""
    low, high = np.tile(parents.boxes.low, 2), np.tile(parents.boxes.high, 2)
    low[row, len(parents) :] = high[row, : len(parents)] = middle
    high[K_P, (low[K_P] == 0) & without_integrator(relaxed.problem, Cells(low, high))] = 0.0
    boxes = Cells(low, high)
    bound, excess = lower_bounds(relaxed, boxes)
    return OpenNodes(boxes, np.maximum(bound, np.tile(parents.bound, 2)), np.tile(parents.stable, 2)), excess


def proved_stability(posed: Posed, boxes: Cells) -> tuple[Flags, Flags, int]:
    """Return the boxes whose loops are all proved stable, those whose loops are all proved unstable, and the number of
    boxes in the proofs."""
    gains = np.concatenate((boxes.low[: K_P + 1], boxes.high[: K_P + 1]))
    rectangles, rectangle_of = np.unique(gains, axis=1, return_inverse=True)  # many boxes have the same gains
    face = np.flatnonzero((rectangles[K_P] == 0) & (rectangles[2 + K_P] > 0))
    faces = rectangles[:, face].copy()
    faces[2 + K_P] = 0.0  # without an integrator the loop has another order
    stable, unstable, count = _of_rectangles(posed, np.hstack((rectangles, faces)))
    for flags in (stable, unstable):
        flags[face] &= flags[rectangles.shape[1] :]
    return stable[rectangle_of.ravel()], unstable[rectangle_of.ravel()], count


def _of_rectangles(posed: Posed, edges: Floats) -> tuple[Flags, Flags, int]:
    """Return the same for rectangles, given as the low and then the high K_v and K_p."""
    number, boxes = edges.shape[1], 0
    cells = Cells(*(np.concatenate((end, np.ones((3, number)))) for end in (edges[:2], edges[2:])))  # any coupling
    stable, unstable = np.zeros(number, bool), np.zeros(number, bool)
    demands = [replace(posed.demands, device=device) for device in {case.device.modelled: None for case in posed.cases}]
    for which in by_integrator(cells):
        found = [x for each in demands for x in pole_turns(of_cells(each, cells.subset(which)), in_hand=True)]
        turns = np.reshape([x.number for x in found], (len(found), len(which)))  # around 0; nan if undecided
        stable[which] = (turns == 0).all(axis=0)
        unstable[which] = (np.isfinite(turns) & (turns != 0)).any(axis=0)
        boxes += sum(int(x.boxes.sum()) for x in found)
    return stable, unstable, boxes
