"""The claims of a certificate for many cells at once, on arrays (DESIGN 1.10); what stays open is left to Arb."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, pi

import numpy as np

from vctune.model.quantities import Device
from vctune.proof.cells import Cells, Integers, Margin, Values, all_pairs, image_at, sift
from vctune.proof.claims import (
    HALF_TURN,
    outwards,
)
from vctune.proof.enclosed import Claims, Demands, claims_of
from vctune.proof.enclosures import Enclosure, Flags, Floats
from vctune.proof.exclusion import Curve, exclude, missing_zero, turns

STEP = 1.4
"""Ratio of the edges of the first intervals."""
ROUNDS = 24
"""How often an interval of frequency is halved for a single design."""
CELL_ROUNDS = 10
"""The same for a cell, whose own size soon blurs a curve more than the interval does."""
NEAR = 1e-6
"""Allowance for the rounding of an angle that is a whole number of quarter turns in the end."""


@dataclass(frozen=True, slots=True)
class Proofs:
    """What is proved of many cells.

    Attributes
    ----------
    proved : the cells all of whose designs meet all demands
    boxes : what it took to prove Llewellyn's conditions, |S|, the model's and the sampled poles; shape (4, n)
    """

    proved: Flags
    boxes: Integers


def prove(demands: Demands, cells: Cells) -> Proofs:
    """Prove all demands throughout each cell.

    A cell whose K_p starts at 0 does not contain K_p = 0 itself, which takes the position out of the loop; a cell
    whose K_p is 0 throughout does.
    """
    proofs = Proofs(np.zeros(len(cells), bool), np.zeros((4, len(cells)), np.intp))
    for integrator, at in by_integrator(cells):
        part = _proofs(demands, cells.taken(at), integrator)
        proofs.proved[at], proofs.boxes[:, at] = part.proved, part.boxes
    return proofs


def by_integrator(cells: Cells) -> list[tuple[bool, Integers]]:
    """Return which cells have an integrator and which have not."""
    parts = [(integrator, np.flatnonzero((cells.high[1] > 0) == integrator)) for integrator in (True, False)]
    return [(integrator, at) for integrator, at in parts if len(at)]


def _proofs(demands: Demands, cells: Cells, integrator: bool) -> Proofs:
    """Prove claim after claim for the cells that are left."""
    claims, device = claims_of(demands, integrator=integrator), demands.device
    rounds = CELL_ROUNDS if any(cells.moving()) else ROUNDS

    def conditions_hold(cells: Cells) -> tuple[Flags, Integers]:
        low, high = outwards(demands.band)
        beyond = max(1 / device.sample_time, low)
        pairs = all_pairs(len(cells), low, beyond if high == inf else high, STEP)
        sifted = sift(claims.conditions, cells, pairs, rounds, claims.low if low == 0 else None)
        proved, boxes = sifted.open.count(len(cells)) == 0, sifted.boxes
        if high == inf:
            sifted = sift(claims.high, cells, all_pairs(len(cells), 0.0, 1 / beyond, STEP), rounds)
            proved, boxes = proved & (sifted.open.count(len(cells)) == 0), boxes + sifted.boxes
        return proved, boxes

    def sensitivity_holds(cells: Cells) -> tuple[Flags, Integers]:
        pairs = all_pairs(len(cells), 0.0, HALF_TURN, STEP)
        sifted = sift(claims.sensitivity, cells, pairs, rounds, claims.floor)
        return sifted.open.count(len(cells)) == 0, sifted.boxes

    def poles_stay(cells: Cells) -> tuple[Flags, Integers]:
        turned = encirclements(demands, cells, integrator=integrator)
        return (turned.number == 0).all(axis=0), turned.boxes

    left, boxes = np.arange(len(cells)), np.zeros((4, len(cells)), np.intp)
    for rows, holds in ((0, conditions_hold), (1, sensitivity_holds), (slice(2, 4), poles_stay)):
        if len(left):
            proved, boxes[rows, left] = holds(cells.taken(left))
            left = left[proved]
    proved = np.zeros(len(cells), bool)
    proved[left] = True
    return Proofs(proved, boxes)


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
    for integrator, at in by_integrator(cells):
        claims, part = claims_of(demands, integrator=integrator), cells.taken(at)
        lost = image_at(claims.conditions, part, omega[at]).negative()
        lost |= image_at(claims.damped, part, omega[at]).negative()
        lost |= image_at(claims.sensitivity, part, theta_S[at]).negative()
        left = np.flatnonzero(~lost)
        number = encirclements(demands, part.taken(left), integrator=integrator).number
        lost[left] = (np.isfinite(number) & (number != 0)).any(axis=0)
        fails[at] = lost
    return fails


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


def encirclements(demands: Demands, cells: Cells, *, integrator: bool) -> Encirclements:
    """Return how often the curves of each cell go around 0."""
    parts = [_encirclements(replace(demands, device=loop), cells, integrator) for loop in demands.device.loops]
    number, boxes = (np.stack([getattr(part, name) for part in parts]) for name in Encirclements.__slots__)
    return Encirclements(np.concatenate(number), boxes.sum(axis=0))


def _encirclements(demands: Demands, cells: Cells, integrator: bool) -> Encirclements:
    """Return the numbers of one loop: as often as at a cell's centre, where no pole crosses over within it."""
    claims, device = claims_of(demands, integrator=integrator), demands.device
    same = steady(claims, device, cells) if any(cells.moving()) else np.ones((2, len(cells)), bool)
    number, boxes = np.full((2, len(cells)), np.nan), np.zeros((2, len(cells)), np.intp)
    calm = np.flatnonzero(same.any(axis=0))
    counted, boxes[:, calm] = _turns_at(claims, device, cells.taken(calm).centres(), integrator=integrator)
    number[:, calm] = np.where(same[:, calm], counted, np.nan)
    return Encirclements(number, boxes)


def _turns_at(claims: Claims, device: Device, points: Cells, *, integrator: bool) -> tuple[Floats, Integers]:
    """Return the number of each point, nan where not settled, and the pairs looked at.

    The arguments are those of `vctune.proof.poles`: the model's curve ends within a quarter turn of where it goes; the
    sampled loop's begins at F(1) > 0 and ends on the real axis.
    """
    curves = (
        (claims.model_poles, stiffest(device, points), 2 * pi, pi if integrator else pi / 2),
        (claims.sampled_poles, HALF_TURN, pi, 0.0),
    )
    numbers, boxes = [], []
    for curve, high, turn, goal in curves:
        pairs = all_pairs(len(points), 0.0, high, STEP)
        found = exclude(missing_zero(curve), points, pairs, ROUNDS)
        whole = found.open.count(len(points)) == 0
        numbers.append(np.where(whole, np.round((goal - turns(curve, points, found.closed)) / turn), np.nan))
        boxes.append(found.boxes)
    return np.stack(numbers), np.stack(boxes)


def steady(claims: Claims, device: Device, cells: Cells) -> Flags:
    """Return where no pole of the model, and none of the sampled loop, crosses over within a cell: shape (2, n)."""

    def uncrossed(curve: Curve, floor: Margin, high: float) -> Flags:
        def misses(x: Enclosure, values: Values) -> Flags:
            return missing_zero(curve)(x, values) | floor(x, values).positive()

        pairs = all_pairs(len(cells), 0.0, high, STEP)
        return exclude(misses, cells, pairs, CELL_ROUNDS).open.count(len(cells)) == 0

    model = uncrossed(claims.model_poles, claims.model_floor, stiffest(device, cells))
    return np.stack((model, uncrossed(claims.sampled_poles, claims.sampled_floor, HALF_TURN)))


def stiffest(device: Device, cells: Cells) -> float:
    """Return a frequency beyond which |C| < |m omega|/2 in every cell, because |H| <= 1, rad/s; > 0 without a loop."""
    K_v, K_p = cells.high[:2]
    least = NEAR / device.sample_time
    return 4 * (1 + NEAR) * float(np.maximum(K_v / device.mass, np.sqrt(K_p / device.mass)).max(initial=least))
