"""The demand in every hand of a box for many cells of gains, next to rest divided by the factors that vanish.

See proof/README.md, section 10.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vctune.model.hands import HAND
from vctune.model.numbers.keys import KEYS
from vctune.model.problem import Demands
from vctune.model.sampled.plant_in_hand import delays_of
from vctune.proof.claims.array_claims import SHARES, claims_of, limp_hands_margins
from vctune.proof.claims.margins_of_claims import HALF_TURN
from vctune.proof.enclosures.array_intervals import Enclosure, Flags, Floats
from vctune.proof.engine.bands import CELL_HALVINGS, STEP
from vctune.proof.engine.box_tests import Margin, alone, positive
from vctune.proof.engine.boxes import Boxes, Cells, Integers, band_of, joined, over_hands
from vctune.proof.engine.branching import Test, prove

MAX_HALVINGS, MAX_BOXES, TOGETHER = 4 * CELL_HALVINGS, 30_000, 128
"""What `CELL_HALVINGS` and `MAX_BOXES` are for boxes of angle and hand, and how many cells are proved together: what is
known of them fits into memory. Cells with room take up to 30,000 boxes, most some thousand;
with 12,000 some of those next to K_p = 0 are left to smaller ones."""
AT_REST = 0.1
"""Greatest K_p T^2/m, as a share of the first interval of angles, of cells that are proved next to rest apart."""

MASS = "coupling.mass"
FEW = 1024
"""Boxes that take about as long as one, arrays of many cells being as long. An eighth takes a fifth longer."""


def hold_in_hands(demands: Demands, cells: Cells) -> Flags:
    """Return the cells all of whose designs meet the demand in every hand, where none has a pole on the unit circle.

    Parameters
    ----------
    demands : with the hands
    cells : n of them, all of them with K_p > 0, or none
    """
    limp = _next_to_rest(demands, cells)
    proved = np.zeros(len(cells), bool)
    for some in _few(np.flatnonzero(~limp)):
        proved[some] = _proved_everywhere(demands, cells.subset(some))
    for some in _few(np.flatnonzero(limp)):
        proved[some] = _proved_apart(demands, cells.subset(some))
    return proved


def _senses_force_in_a_loop(demands: Demands) -> bool:
    return demands.device.kind.senses_force and demands.device.kind.own_loop


def _few(at: Integers) -> Iterator[Integers]:
    return (at[i : i + TOGETHER] for i in range(0, len(at), TOGETHER))


def _next_to_rest(demands: Demands, cells: Cells) -> Flags:
    """Return the cells with so little K_p that in a hand without stiffness the margin nearly vanishes at theta = 0."""
    assert demands.hands is not None
    if not _senses_force_in_a_loop(demands) or demands.hands.low.stiffness > 0:
        return np.zeros(len(cells), bool)
    return np.asarray(cells.low[1] <= AT_REST * _stiffness_of(demands, _band()[1][0]))


def _stiffness_of(demands: Demands, theta: float) -> float:
    """Return the stiffness that adds as much as an angle to what the margin vanishes with, N/m."""
    return theta * demands.device.mass / demands.device.sample_time**2


def _band() -> tuple[Floats, Floats]:
    return band_of(0.0, HALF_TURN, STEP)


def _proved_everywhere(demands: Demands, cells: Cells) -> Flags:
    assert demands.hands is not None
    return _prove(_in_hand(demands), over_hands(cells, demands.hands, _band()), len(cells))


def _in_hand(demands: Demands) -> Test:
    """Return the test that the margin in a hand is positive, from theta = 0 by the drag: all that is offered there.

    A heavy coupling changes within a millionth of the angles there, and nothing else does.
    """
    margin = alone(claims_of(demands).in_hand)
    return positive(margin, {}, None if demands.device.kind.inverse else _by_drag(margin))


def _by_drag(margin: Margin) -> Margin:
    """Return the margin of the coupling's drag alone, which is less."""
    return lambda theta, v: margin(theta, {**v, MASS: Enclosure(0.0)})


def _proved_apart(demands: Demands, cells: Cells) -> Flags:
    """Prove the demand next to rest whatever the margin vanishes with, and elsewhere as it is."""
    hands, (first, others) = demands.hands, _parted(_band())
    assert hands is not None
    stiffness = min(hands.high.stiffness, _stiffness_of(demands, first[1][0]))
    softer = replace(hands, high=replace(hands.high, stiffness=stiffness))
    proved = _prove(
        positive(_by_drag(*limp_hands_margins(demands, (), delays_of(demands.device))), {}),
        _with_shares(over_hands(cells, softer, first)),
        len(cells),
    )
    left = np.flatnonzero(proved)
    part = cells.subset(left)
    boxes = over_hands(part, hands, others)
    if stiffness < hands.high.stiffness:
        stiffer = replace(hands, low=replace(hands.low, stiffness=stiffness))
        boxes = joined(boxes, over_hands(part, stiffer, first))
    proved[left] = _prove(_in_hand(demands), boxes, len(part))
    return proved


def _parted(band: tuple[Floats, Floats]) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return the first interval of a band and the others."""
    low, high = band
    return (low[:1], high[:1]), (low[1:], high[1:])


def _with_shares(boxes: Boxes) -> Boxes:
    """Return boxes of hands and cells with the rows of `SHARES`: of what there is, any."""
    there = [boxes.high[boxes.names.index(key)].max(initial=0.0) > 0 for key in (KEYS[1], HAND[2])]
    rows = np.repeat(np.array(there, float)[:, None], len(boxes), axis=1)
    return replace(
        boxes,
        names=(*boxes.names, *SHARES),
        low=np.vstack((boxes.low, np.zeros_like(rows))),
        high=np.vstack((boxes.high, rows)),
    )


def _prove(test: Test, boxes: Boxes, owners: int) -> Flags:
    return prove(
        test,
        boxes,
        owners,
        halved=[True] * len(boxes.names),
        max_halvings=MAX_HALVINGS,
        max_boxes=MAX_BOXES,
        at_ends=True,
        only_whole=True,
        few=FEW,
    ).proved
