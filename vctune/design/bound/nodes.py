"""The open nodes of the branch and bound, which are boxes that may contain a better design: how they are halved, and
proofs that all of their loops, or none of them, are stable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np

from vctune.design.bound.quadratics import K_P
from vctune.design.bound.relaxation import Relaxation, lower_bounds, without_integrator
from vctune.design.prepared import Posed
from vctune.design.search.shapes import SLACK
from vctune.design.variables import coordinates
from vctune.model.problem import Demands, Problem
from vctune.proof.boxes import Cells, Integers
from vctune.proof.claims.cells import by_integrator, pole_turns
from vctune.proof.claims.loop_claims import of_cells
from vctune.proof.enclosures.intervals import Flags, Floats

BETTER_HALF = 0.1  # Weight of the greater bound of two halves relative to the smaller one
LENGTH = 1e-2  # Weight, in the score, of the share of an axis that a box spans
DIGITS = 9  # Number of decimals to which the code rounds scores before it compares them


@dataclass(frozen=True, slots=True)
class Axis:
    """A variable, with the coordinate log(scale + x) in which the search halves it."""

    low: float  # range of the variable
    high: float
    scale: float  # 0

    def middle(self, low: Floats, high: Floats) -> Floats:
        """Return the points at which the search halves intervals: their midpoints in the coordinate."""
        if self.scale == 0:
            return np.clip(np.sqrt(low) * np.sqrt(high), low, high)
        z = 0.5 * (np.log1p(low / self.scale) + np.log1p(high / self.scale))
        return np.clip(self.scale * np.expm1(z), low, high)

    def share(self, low: Floats, high: Floats) -> Floats:
        """Return the share of the axis that each interval covers."""
        if self.low == self.high:
            return np.zeros_like(low)
        whole = np.log((self.scale + self.high) / (self.scale + self.low))
        return np.log((self.scale + high) / (self.scale + low)) / whole


def axes_of(problem: Problem) -> tuple[Axis, Axis, Axis, Axis]:
    """Return the axes K_v, K_p, tau_c and b_0 of a problem in SI units."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    units = {"velocity": impedance, "position": impedance / time, "drag": impedance}
    scaled = coordinates(problem.in_units(impedance, time), integrator=True)
    scale = {c.name: c.scale * units[c.name] for c in scaled if c.name in units}
    bounds = problem.bounds
    above, below = (bounds.damping, bounds.stiffness) if problem.device.kind.inverse else (bounds.mass, bounds.damping)
    low, high = above.min / below.max, above.max / below.min
    K_v, K_p, b_0 = (
        Axis(each.min, each.max, scale.get(name, 0.0))
        for name, each in (("velocity", bounds.velocity), ("position", bounds.position), ("drag", bounds.drag))
    )
    return K_v, K_p, Axis(low, high, SLACK * time if low == 0 < high else 0.0), b_0


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


def root(axes: Sequence[Axis]) -> OpenNodes:
    """Return the single node whose box contains all designs."""
    boxes = Cells(np.array([[axis.low] for axis in axes]), np.array([[axis.high] for axis in axes]))
    return OpenNodes(boxes, np.zeros(1), np.zeros(1, bool))


def joined(parts: Sequence[OpenNodes]) -> OpenNodes:
    """Return several sets of nodes as one set."""
    boxes = Cells(*(np.hstack([getattr(part.boxes, edge) for part in parts]) for edge in ("low", "high")))
    return OpenNodes(boxes, *(np.concatenate([getattr(part, of) for part in parts]) for of in ("bound", "stable")))


def halved(
    relaxed: Relaxation, axes: Sequence[Axis], parents: OpenNodes, incumbent: float
) -> tuple[OpenNodes, Flags, int]:
    """Return nodes halved along the axis that raises their bounds most, whether that is a gain's, and the number of
    computed bounds. The worse half counts most, because it becomes the bound of the box."""
    n, rows = len(parents), [row for row, axis in enumerate(axes) if axis.low < axis.high]
    if not rows:
        bound = np.maximum(lower_bounds(relaxed, parents.boxes), parents.bound)
        return replace(parents, bound=bound), np.zeros(n, bool), n
    tried = [_halves(relaxed, axes[row], row, parents) for row in rows]
    bounds = np.array([each.bound.reshape(2, n) for each in tried])
    most = 2 * incumbent if incumbent < inf else max(1e-300, 2 * bounds.max(initial=0.0, where=np.isfinite(bounds)))
    share = [axes[row].share(parents.boxes.low[row], parents.boxes.high[row]) for row in rows]
    worth = np.minimum(bounds / most, 1.0)  # a half far above the incumbent is pruned, however far
    score = worth.min(axis=1) + BETTER_HALF * worth.max(axis=1) + LENGTH * np.array(share)
    best = np.tile(np.argmax(np.round(score, DIGITS), axis=0), 2)
    chosen = joined([each.subset(best == k) for k, each in enumerate(tried)])
    along_gains = np.repeat(np.array(rows) <= K_P, np.bincount(best, minlength=len(rows)))
    return chosen, along_gains, 2 * n * len(rows)


def _halves(relaxed: Relaxation, axis: Axis, row: int, parents: OpenNodes) -> OpenNodes:
    """Return the lower and then the upper halves of nodes along an axis. A half that contains K_p = 0, but no feasible
    design with K_p > 0, shrinks to K_p = 0."""
    given = parents.boxes
    low, high = np.tile(given.low, 2), np.tile(given.high, 2)
    low[row, len(parents) :] = high[row, : len(parents)] = axis.middle(given.low[row], given.high[row])
    high[K_P, (low[K_P] == 0) & without_integrator(relaxed.problem, Cells(low, high))] = 0.0
    halves = Cells(low, high)
    bound = np.maximum(lower_bounds(relaxed, halves), np.tile(parents.bound, 2))
    return OpenNodes(halves, bound, np.tile(parents.stable, 2))


class Stability(NamedTuple):
    """Proved stability and instability of the loops in each of n boxes of designs."""

    stable: Flags  # whether all loops of the box are stable, shape (n,)
    unstable: Flags  # whether no loop of the box is stable; both are False if nothing is proved
    boxes: int  # number of boxes of frequency and gains in the proofs


def proved_stability(posed: Posed, boxes: Cells) -> Stability:
    """Return the boxes whose designs all have stable loops, and those whose designs all have an unstable loop."""
    gains = np.concatenate((boxes.low[: K_P + 1], boxes.high[: K_P + 1]))
    rectangles, rectangle_of = np.unique(gains, axis=1, return_inverse=True)  # many boxes have the same gains
    face = np.flatnonzero((rectangles[K_P] == 0) & (rectangles[2 + K_P] > 0))
    faces = rectangles[:, face].copy()
    faces[2 + K_P] = 0.0  # without an integrator the loop has another order
    stable, unstable, count = _of_rectangles(posed, np.hstack((rectangles, faces)))
    kept, number = rectangle_of.ravel(), rectangles.shape[1]
    for flags in (stable, unstable):
        flags[face] &= flags[number:]
    return Stability(stable[kept], unstable[kept], count)


def _of_rectangles(posed: Posed, edges: Floats) -> Stability:
    """Return the stability of rectangles, given as the low and then the high K_v and K_p."""
    count, boxes = edges.shape[1], 0
    cells = Cells(*(np.concatenate((end, np.ones((3, count)))) for end in (edges[:2], edges[2:])))  # any coupling
    stable, unstable = np.zeros(count, bool), np.zeros(count, bool)
    devices = dict.fromkeys(case.device.modelled for case in posed.cases)
    for which in by_integrator(cells):
        turns = [_turns(replace(posed.demands, device=device), cells.subset(which)) for device in devices]
        number = np.concatenate([of_device for of_device, _ in turns])
        boxes += sum(taken for _, taken in turns)
        stable[which] = (number == 0).all(axis=0)
        unstable[which] = (np.isfinite(number) & (number != 0)).any(axis=0)
    return Stability(stable, unstable, boxes)


def _turns(demands: Demands, cells: Cells) -> tuple[Floats, int]:
    """Return the winding number around 0 of the curve of each loop (nan if undecided), and the number of boxes."""
    found = pole_turns(of_cells(demands, cells), in_hand=True)
    numbers = np.reshape([each.number for each in found], (len(found), len(cells)))
    return numbers, sum(int(each.boxes.sum()) for each in found)
