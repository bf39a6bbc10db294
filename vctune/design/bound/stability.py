"""Which boxes of designs have only stable loops, and which have none: proved, many at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vctune.design.bound.boxes import K_P, DesignBoxes
from vctune.design.prepared import Posed
from vctune.proof.array_claims import Demands
from vctune.proof.array_intervals import Flags, Floats
from vctune.proof.boxes import Cells
from vctune.proof.encirclements import by_integrator, encirclements, encirclements_in_hand


def proved_stability(posed: Posed, boxes: DesignBoxes) -> tuple[Flags, Flags]:
    """Return the boxes all of whose loops are proved stable, and those none of whose loops is.

    A box whose K_p starts at 0 contains K_p = 0, which takes the position out of the loop, and is looked at twice.

    Parameters
    ----------
    posed : the problem, whose devices' sampled loops, let go and in a hand, and frequency models are looked at as far
        as they count
    boxes : n boxes; only their gains matter

    Returns
    -------
    tuple of Flags
        Two arrays of shape (n,); neither holds where nothing is proved.
    """
    gains = np.concatenate((boxes.low[: K_P + 1], boxes.high[: K_P + 1]))
    rectangles, rectangle_of = np.unique(gains, axis=1, return_inverse=True)  # boxes often share their gains
    low, high = rectangles[:2], rectangles[2:]
    stable, unstable = _of_rectangles(posed, low, high)
    face = (low[K_P] == 0) & (high[K_P] > 0)
    if face.any():
        without_position = high[:, face] * np.array([[1.0], [0.0]])
        face_stable, face_unstable = _of_rectangles(posed, low[:, face], without_position)
        stable[face] &= face_stable
        unstable[face] &= face_unstable
    rectangle_of = rectangle_of.ravel()
    return stable[rectangle_of], unstable[rectangle_of]


def _of_rectangles(posed: Posed, low: Floats, high: Floats) -> tuple[Flags, Flags]:
    """Return the same of rectangles of K_v and K_p, arrays of shape (2, n)."""
    count = low.shape[1]
    cells = Cells(*(np.concatenate((end, np.ones((3, count)))) for end in (low, high)))  # any coupling will do
    stable, unstable = np.zeros(count, bool), np.zeros(count, bool)
    for which in by_integrator(cells):
        part = cells.subset(which)
        devices = dict.fromkeys(case.device.modelled for case in posed.cases)
        demands = [replace(posed.demands, device=device) for device in devices]
        number = np.concatenate([_turns(each, part) for each in demands])
        stable[which] = (number == 0).all(axis=0)
        unstable[which] = (np.isfinite(number) & (number != 0)).any(axis=0)
    return stable, unstable


def _turns(demands: Demands, cells: Cells) -> Floats:
    """Return how often each curve that counts goes around 0, nan where not settled, shape (curves, n)."""
    number = encirclements(demands, cells).number
    return number if demands.hands is None else np.vstack((number, encirclements_in_hand(demands, cells)))
