"""Prove the claim in hands for every stiffness at once (proof/README.md, section 10)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vctune.model.device import Device
from vctune.model.hands import HAND, MASS, STIFFNESS
from vctune.proof.boxes import Boxes, Values
from vctune.proof.claims.array_claims import LEAST_DAMPING
from vctune.proof.claims.delays import Part, row_of
from vctune.proof.enclosures.box_minimum import least_over_boxes
from vctune.proof.enclosures.elementary import UNIT
from vctune.proof.enclosures.intervals import Enclosure, Flags
from vctune.proof.enclosures.taylor import variables
from vctune.proof.prover import Decided, Margin, Test, by_polynomial, left_open
from vctune.running import check_time

TOP = 3.1  # Greatest angle, rad, of a box that the search tries
SLOWEST = 1e-5  # Angle, rad, below which a box that begins at 0 is left to the other tests
REACH = 0.9  # Share of the resonant stiffness below which the stiffest hand of a box is too soft for a resonance
MOST_BOXES = 20_000  # Number of boxes after which the search ends
GROWTH = 8  # Ratio of the present number of open boxes to the initial number, above which the search ends


def left_by_any_spring(
    margins: Margin, device: Device, part: Part, fixed: Values, boxes: Boxes, max_boxes: int
) -> tuple[Boxes, int]:
    """Return the boxes that remain to be proved, and the number of evaluated boxes."""
    test = part.within(_test(margins, device, part, fixed))
    return left_open(test, boxes, max_boxes=min(MOST_BOXES, max_boxes), growth=GROWTH)


def _test(margins: Margin, device: Device, part: Part, fixed: Values) -> Test:
    damping = 1 + part.names.index(HAND[1])

    def tested(boxes: Boxes) -> Decided:
        check_time()
        varied, least = boxes.varied(), boxes.low[damping]
        rows = variables(boxes.rows(), varied)
        values = {**boxes.named(rows, fixed), LEAST_DAMPING: Enclosure(least, 4 * UNIT * np.abs(least))}
        first, *others = margins(rows[0], values)
        found = by_polynomial(first, boxes, least_over_boxes(first), alone=False)
        positive = np.all([least_over_boxes(other).bound > 0 for other in others], axis=0)
        from_zero = boxes.low[0] == 0
        proved = found.proved & positive & ~from_zero & (boxes.high[0] <= TOP)
        lost = (from_zero & (boxes.high[0] < SLOWEST)) | (boxes.high[0] > TOP) | _too_soft(boxes, device)
        cost = found.cost.copy()
        cost[0, from_zero] = np.inf
        room = np.where(proved, np.inf, np.where(lost, -np.inf, found.room))
        return replace(found, proved=proved, cost=cost, room=room)

    return tested


def _too_soft(boxes: Boxes, device: Device) -> Flags:
    """Return the boxes in which no hand is stiff enough for a resonance. No verdict depends on the result."""
    row = {name: 1 + place for place, name in enumerate(boxes.names[1:])}
    own = row_of("mass")
    mass = boxes.low[row[MASS]] + (boxes.low[row[own]] if own in row else device.mass)
    resonant = mass * (2 * np.sin(np.minimum(boxes.low[0], np.pi) / 2) / device.sample_time) ** 2
    return np.asarray(boxes.high[row[STIFFNESS]] < REACH * resonant)
