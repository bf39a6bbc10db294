"""The claims of a certificate for many cells at once, on arrays; what stays open is left to Arb.

See proof/README.md, section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, pi

import numpy as np

from vctune.model.quantities import Device
from vctune.proof.box_tests import Curve, Margin, least_over, missing, positive, turn_of
from vctune.proof.boxes import DESIGN, Boxes, Cells, Integers, band_of, over_cells, over_each
from vctune.proof.branching import Proofs, Test
from vctune.proof.branching import prove as prove_boxes
from vctune.proof.claims import (
    HALF_TURN,
    outwards,
)
from vctune.proof.enclosed import Claims, Demands, claims_of
from vctune.proof.enclosures import Flags, Floats

STEP = 1.4
"""Ratio of the edges of the first intervals."""
ROUNDS = 24
"""How often an interval of frequency is halved for a single design."""
CELL_ROUNDS = 10
"""The same for a cell, whose own size soon blurs a curve more than the interval does."""
MOST = 4_000
"""Boxes of a cell that are looked at for one claim before it is left open; most take some hundred."""
IN_FREQUENCY = (True, *[False] * len(DESIGN))
"""Only intervals of frequency are halved here; cells are their caller's business."""
NEAR = 1e-6
"""Allowance for the rounding of an angle that is a whole number of quarter turns in the end."""


@dataclass(frozen=True, slots=True)
class Certified:
    """What is proved of many cells.

    Attributes
    ----------
    proved : the cells all of whose designs meet all demands
    boxes : what it took to prove Llewellyn's conditions, |S|, the model's and the sampled poles; shape (4, n)
    """

    proved: Flags
    boxes: Integers


def prove(demands: Demands, cells: Cells) -> Certified:
    """Prove all demands throughout each cell.

    A cell whose K_p starts at 0 does not contain K_p = 0 itself, which takes the position out of the loop; a cell
    whose K_p is 0 throughout does.
    """
    proofs = Certified(np.zeros(len(cells), bool), np.zeros((4, len(cells)), np.intp))
    for at in by_law(cells):
        part = _proofs(demands, cells.taken(at))
        proofs.proved[at], proofs.boxes[:, at] = part.proved, part.boxes
    return proofs


def by_law(cells: Cells) -> list[Integers]:
    """Return the cells with and those without K_p: with K_p = 0 the law has no integrator."""
    parts = np.flatnonzero(cells.high[1] > 0), np.flatnonzero(cells.high[1] == 0)
    return [at for at in parts if len(at)]


def _proofs(demands: Demands, cells: Cells) -> Certified:
    """Prove claim after claim for the cells that are left."""
    claims = claims_of(demands)

    def conditions_hold(cells: Cells) -> tuple[Flags, Integers]:
        low, high = outwards(demands.band)
        beyond = max(1 / demands.device.sample_time, low)
        test = positive(claims.conditions, {}, claims.low if low == 0 else None)
        found = _over(test, cells, low, beyond if high == inf else high)
        if high < inf:
            return found.proved, found.boxes
        above = _over(positive(claims.high, {}), cells, 0.0, 1 / beyond)
        return found.proved & above.proved, found.boxes + above.boxes

    def sensitivity_holds(cells: Cells) -> tuple[Flags, Integers]:
        found = _over(positive(claims.sensitivity, {}, claims.floor), cells, 0.0, HALF_TURN)
        return found.proved, found.boxes

    def poles_stay(cells: Cells) -> tuple[Flags, Integers]:
        turned = encirclements(demands, cells)
        return (turned.number == 0).all(axis=0), turned.boxes

    left, boxes = np.arange(len(cells)), np.zeros((4, len(cells)), np.intp)
    for rows, holds in ((0, conditions_hold), (1, sensitivity_holds), (slice(2, 4), poles_stay)):
        if len(left):
            proved, boxes[rows, left] = holds(cells.taken(left))
            left = left[proved]
    proved = np.zeros(len(cells), bool)
    proved[left] = True
    return Certified(proved, boxes)


def _over(
    test: Test, cells: Cells, low: float, high: float, measure: Callable[[Boxes], Floats] | None = None
) -> Proofs:
    """Test cells over a band."""
    rounds = CELL_ROUNDS if cells.extended else ROUNDS
    boxes = over_cells(cells, band_of(low, high, STEP))
    return prove_boxes(test, boxes, len(cells), halved=IN_FREQUENCY, generations=rounds, most=MOST, measure=measure)


def refuted(demands: Demands, cells: Cells, omega: Floats, theta_S: Floats) -> Flags:
    """Return the cells none of whose designs meets all demands.

    Parameters
    ----------
    demands : what is to be met
    cells : as for `prove`
    omega : rad/s, for each cell a frequency of the band at which Llewellyn's conditions may fail throughout
    theta_S : rad, for each cell an angle omega T at which |S| may be too great throughout
    """
    fails = np.zeros(len(cells), bool)
    for at in by_law(cells):
        claims, part = claims_of(demands), cells.taken(at)
        lost = negative_at(claims.conditions, part, omega[at])
        lost |= negative_at(claims.damped, part, omega[at])
        lost |= negative_at(claims.sensitivity, part, theta_S[at])
        left = np.flatnonzero(~lost)
        number = encirclements(demands, part.taken(left)).number
        lost[left] = (np.isfinite(number) & (number != 0)).any(axis=0)
        fails[at] = lost
    return fails


def negative_at(margin: Margin, cells: Cells, omega: Floats) -> Flags:
    """Return where a margin is negative throughout each cell, at one frequency of its own."""
    return np.asarray(least_at(lambda at, values: -margin(at, values), cells, omega) > 0)


def least_at(margin: Margin, cells: Cells, omega: Floats) -> Floats:
    """Return a lower bound of a margin over each cell, at one frequency of its own, shape (number of cells,)."""
    return least_over(margin, over_each(cells, omega), {})


@dataclass(frozen=True, slots=True)
class Encirclements:
    """How often the curves of every design of a cell go around 0.

    Attributes
    ----------
    number : of the model's curve and the sampled loop's, for each of the device's loops, shape (2 or 4, n): 0 where
        stable, nan where not settled or not the same throughout the cell
    boxes : pairs looked at, at the centres, for the model and for the sampled loop, shape (2, n)
    """

    number: Floats
    boxes: Integers


def encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return how often the curves of each cell go around 0; all of them with K_p > 0, or none."""
    parts = [_encirclements(replace(demands, device=loop), cells) for loop in demands.device.loops]
    number, boxes = (np.stack([getattr(part, name) for part in parts]) for name in Encirclements.__slots__)
    return Encirclements(np.concatenate(number), boxes.sum(axis=0))


def _encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return the numbers of one loop: as often as at a cell's centre, where no pole crosses over within it."""
    claims, device = claims_of(demands), demands.device
    same = steady(claims, device, cells) if cells.extended else np.ones((2, len(cells)), bool)
    number, boxes = np.full((2, len(cells)), np.nan), np.zeros((2, len(cells)), np.intp)
    calm = np.flatnonzero(same.any(axis=0))
    counted, boxes[:, calm] = _turns_at(claims, device, cells.taken(calm).centres())
    number[:, calm] = np.where(same[:, calm], counted, np.nan)
    return Encirclements(number, boxes)


def _turns_at(claims: Claims, device: Device, points: Cells) -> tuple[Floats, Integers]:
    """Return the number of each point, nan where not settled, and the pairs looked at.

    The arguments are those of `vctune.proof.poles`: the model's curve ends within a quarter turn of where it goes; the
    sampled loop's begins at F(1) > 0 and ends on the real axis.
    """
    curves = (
        (claims.model_poles, stiffest(device, points), 2 * pi, pi if points.high[1].any() else pi / 2),
        (claims.sampled_poles, HALF_TURN, pi, 0.0),
    )
    numbers, boxes = [], []
    for curve, high, turn, goal in curves:
        found = _over(missing(curve, {}), points, 0.0, high, turn_of(curve, {}))
        numbers.append(np.where(found.proved, np.round((goal - found.total) / turn), np.nan))
        boxes.append(found.boxes)
    return np.stack(numbers), np.stack(boxes)


def steady(claims: Claims, device: Device, cells: Cells) -> Flags:
    """Return where no pole of the model, and none of the sampled loop, crosses over within a cell: shape (2, n)."""

    def uncrossed(curve: Curve, floor: Margin, high: float) -> Flags:
        return _over(missing(curve, {}, floor), cells, 0.0, high).proved

    model = uncrossed(claims.model_poles, claims.model_floor, stiffest(device, cells))
    return np.stack((model, uncrossed(claims.sampled_poles, claims.sampled_floor, HALF_TURN)))


def stiffest(device: Device, cells: Cells) -> float:
    """Return a frequency beyond which |C| < |m omega|/2 in every cell, because |H| <= 1, rad/s; > 0 without a loop."""
    K_v, K_p = cells.high[:2]
    least = NEAR / device.sample_time
    return 4 * (1 + NEAR) * float(np.maximum(K_v / device.mass, np.sqrt(K_p / device.mass)).max(initial=least))
