"""Prove for many boxes of designs at once that all of their loops, or none of them, are stable."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vctune.design.bound.design_boxes import K_P, DesignBoxes
from vctune.design.prepared import Posed
from vctune.model.problem import Demands
from vctune.proof.boxes import Cells
from vctune.proof.claims.cells import by_integrator, pole_turns
from vctune.proof.claims.loop_claims import of_cells
from vctune.proof.enclosures.intervals import Flags, Floats


@dataclass(frozen=True, slots=True)
class Stability:
    """Proved stability and instability of the loops in each of n boxes of designs."""

    stable: Flags  # whether all loops of the box are stable, shape (n,)
    unstable: Flags  # whether no loop of the box is stable; both are False if nothing is proved
    boxes: int  # number of boxes of frequency and gains in the proofs


def proved_stability(posed: Posed, boxes: DesignBoxes) -> Stability:
    """Return the boxes whose designs all have stable loops, and those whose designs all have an unstable loop."""
    gains = np.concatenate((boxes.low[: K_P + 1], boxes.high[: K_P + 1]))
    rectangles, rectangle_of = np.unique(gains, axis=1, return_inverse=True)  # many boxes have the same gains
    low, high = rectangles[:2], rectangles[2:]
    found = _of_rectangles(posed, low, high)
    face, count = (low[K_P] == 0) & (high[K_P] > 0), found.boxes
    if face.any():
        # rows 0 and 1 are K_v and K_p: K_v keeps its upper edge, K_p becomes 0
        without_position = high[:, face] * np.array([[1.0], [0.0]])
        at_face = _of_rectangles(posed, low[:, face], without_position)
        found.stable[face] &= at_face.stable
        found.unstable[face] &= at_face.unstable
        count += at_face.boxes
    rectangle_of = rectangle_of.ravel()
    return Stability(found.stable[rectangle_of], found.unstable[rectangle_of], count)


def _of_rectangles(posed: Posed, low: Floats, high: Floats) -> Stability:
    """Return the stability of rectangles of K_v and K_p, whose edges have shape (2, n)."""
    count, boxes = low.shape[1], 0
    cells = Cells(*(np.concatenate((end, np.ones((3, count)))) for end in (low, high)))  # the coupling does not matter
    stable, unstable = np.zeros(count, bool), np.zeros(count, bool)
    for which in by_integrator(cells):
        part = cells.subset(which)
        devices = dict.fromkeys(case.device.modelled for case in posed.cases)
        turns = [_turns(replace(posed.demands, device=device), part) for device in devices]
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
