"""The claims of a certificate for many cells at once, on arrays; what stays open is left to Arb.

See proof/README.md, section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, pi

import numpy as np

from vctune.model.arithmetic import FLOATS, Arithmetic
from vctune.model.keys import KEYS
from vctune.model.quantities import Device
from vctune.proof.array_claims import Claims, Demands, claims_of
from vctune.proof.array_intervals import Flags, Floats
from vctune.proof.box_tests import Curve, Margin, lower_bound_over, misses_zero, positive, turned_angles
from vctune.proof.boxes import Boxes, Cells, Integers, band_of, over_cells, over_each
from vctune.proof.branching import Proofs, Test
from vctune.proof.branching import prove as prove_boxes
from vctune.proof.claims import HALF_TURN, outwards, resistance_apart
from vctune.proof.poles import NEAR, curve_end, final_angle

STEP = 1.4
"""Ratio of the edges of the first intervals. Its square root takes 60 % more boxes, its square 16 % fewer; a cell that
is nearly blurred is proved by the one and not the other."""
HALVINGS = 24
"""How often an interval of frequency is halved for a single design: to 2e-8 of it, where an optimal design touches its
demand. Half and twice as often prove the same designs around those of problems/."""
CELL_HALVINGS = 10
"""The same for a cell, whose own size soon blurs a curve more than the interval does. Half as often leaves cells open,
up to half of those near the edge of what is admissible; twice as often proves no more."""
MAX_BOXES = 4_000
"""Boxes of a cell that are looked at for one claim before it is left open; most take some hundred. Half and twice as
many prove the same cells."""
IN_FREQUENCY = (True, *[False] * len(KEYS))
"""Only intervals of frequency are halved here; cells are their caller's business."""


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

    Parameters
    ----------
    demands : what is to be met
    cells : n of them

    Returns
    -------
    Certified
        A cell that is not proved is open, not refuted.
    """
    proofs = Certified(np.zeros(len(cells), bool), np.zeros((4, len(cells)), np.intp))
    for at in by_integrator(cells):
        part = _proofs(demands, cells.subset(at))
        proofs.proved[at], proofs.boxes[:, at] = part.proved, part.boxes
    return proofs


def by_integrator(cells: Cells) -> list[Integers]:
    """Return the cells with and those without K_p: with K_p = 0 the law has no integrator."""
    parts = np.flatnonzero(cells.high[1] > 0), np.flatnonzero(cells.high[1] == 0)
    return [at for at in parts if len(at)]


def _proofs(demands: Demands, cells: Cells) -> Certified:
    """Prove claim after claim for the cells that are left."""
    claims = claims_of(demands)

    def conditions_hold(cells: Cells) -> tuple[Flags, Integers]:
        low, high = outwards(demands.band)
        beyond = max(1 / demands.device.sample_time, low)
        test = positive(claims.conditions, {}, claims.conditions_near_zero if low == 0 else None)
        finite = beyond if high == inf else high
        found = _over(test, cells, low, finite)
        if resistance_apart(demands.device):
            apart = _over(positive(claims.resistance, {}), cells, low, finite)
            return found.proved & apart.proved, found.boxes + apart.boxes
        if high < inf:
            return found.proved, found.boxes
        above = _over(positive(claims.conditions_near_infinity, {}), cells, 0.0, 1 / beyond)
        return found.proved & above.proved, found.boxes + above.boxes

    def sensitivity_holds(cells: Cells) -> tuple[Flags, Integers]:
        found = _over(positive(claims.sensitivity, {}, claims.sensitivity_any_position), cells, 0.0, HALF_TURN)
        return found.proved, found.boxes

    def poles_stay(cells: Cells) -> tuple[Flags, Integers]:
        turned = encirclements(demands, cells)
        return (turned.number == 0).all(axis=0), turned.boxes

    left, boxes = np.arange(len(cells)), np.zeros((4, len(cells)), np.intp)
    for rows, holds in ((0, conditions_hold), (1, sensitivity_holds), (slice(2, 4), poles_stay)):
        if len(left):
            proved, boxes[rows, left] = holds(cells.subset(left))
            left = left[proved]
    proved = np.zeros(len(cells), bool)
    proved[left] = True
    return Certified(proved, boxes)


def _over(
    test: Test, cells: Cells, low: float, high: float, measure: Callable[[Boxes], Floats] | None = None
) -> Proofs:
    """Test cells over a band."""
    halvings = CELL_HALVINGS if cells.extended else HALVINGS
    boxes = over_cells(cells, band_of(low, high, STEP))
    return prove_boxes(
        test, boxes, len(cells), halved=IN_FREQUENCY, max_halvings=halvings, max_boxes=MAX_BOXES, measure=measure
    )


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
    for at in by_integrator(cells):
        claims, part = claims_of(demands), cells.subset(at)
        lost = negative_at(claims.conditions, part, omega[at])
        lost |= negative_at(claims.resistance, part, omega[at])
        lost |= negative_at(claims.sensitivity, part, theta_S[at])
        left = np.flatnonzero(~lost)
        number = encirclements(demands, part.subset(left)).number
        lost[left] = (np.isfinite(number) & (number != 0)).any(axis=0)
        fails[at] = lost
    return fails


def negative_at(margin: Margin, cells: Cells, omega: Floats) -> Flags:
    """Return where a margin is negative throughout each cell, at one frequency of its own.

    Parameters
    ----------
    margin : of a frequency and of values
    cells : n of them
    omega : for each cell a frequency as the margin has it, rad/s or rad, shape (n,)

    Returns
    -------
    array of bool
        Shape (n,).
    """
    return np.asarray(lower_bound_at(lambda at, values: -margin(at, values), cells, omega) > 0)


def lower_bound_at(margin: Margin, cells: Cells, omega: Floats) -> Floats:
    """Return a lower bound of a margin over each cell, at one frequency of its own, shape (number of cells,).

    Parameters
    ----------
    margin : of a frequency and of values
    cells : n of them
    omega : for each cell a frequency as the margin has it, rad/s or rad, shape (n,)

    Returns
    -------
    array of float
        In the margin's unit; nan where nothing is known of it.
    """
    return lower_bound_over(margin, over_each(cells, omega), {})


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
    """Return how often the curves of each cell go around 0; all of them with K_p > 0, or none.

    Parameters
    ----------
    demands : of which the device counts, with each of its loops
    cells : n of them
    """
    parts = [_encirclements(replace(demands, device=loop), cells) for loop in demands.device.loops]
    number, boxes = (np.stack([getattr(part, name) for part in parts]) for name in Encirclements.__slots__)
    return Encirclements(np.concatenate(number), boxes.sum(axis=0))


def _encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return the numbers of one loop: as often as at a cell's centre, where no pole crosses over within it."""
    claims, device = claims_of(demands), demands.device
    same = no_pole_crosses(claims, device, cells) if cells.extended else np.ones((2, len(cells)), bool)
    number, boxes = np.full((2, len(cells)), np.nan), np.zeros((2, len(cells)), np.intp)
    calm = np.flatnonzero(same.any(axis=0))
    counted, boxes[:, calm] = _turns_at(claims, device, cells.subset(calm).centres())
    number[:, calm] = np.where(same[:, calm], counted, np.nan)
    return Encirclements(number, boxes)


def _turns_at(claims: Claims, device: Device, points: Cells) -> tuple[Floats, Integers]:
    """Return the number of each point, nan where not settled, and the pairs looked at.

    The arguments are those of `vctune.proof.poles`: the model's curve ends within a third of a turn of where it goes;
    the sampled loop's begins at F(1) > 0 and ends on the real axis.
    """
    goal = final_angle(device, integral=bool(points.high[1].any()))
    curves = (
        (claims.model_poles, model_curve_end(device, points), 2 * pi, goal),
        (claims.sampled_poles, HALF_TURN, pi, 0.0),
    )
    numbers, boxes = [], []
    for curve, high, turn, goal in curves:
        found = _over(misses_zero(curve, {}), points, 0.0, high, turned_angles(curve, {}))
        numbers.append(np.where(found.proved, np.round((goal - found.total) / turn), np.nan))
        boxes.append(found.boxes)
    return np.stack(numbers), np.stack(boxes)


def no_pole_crosses(claims: Claims, device: Device, cells: Cells) -> Flags:
    """Return where no pole of the model, and none of the sampled loop, crosses over within a cell: shape (2, n).

    Parameters
    ----------
    claims : about the device
    device : Device
    cells : n of them
    """

    def uncrossed(curve: Curve, sufficient: Margin, high: float) -> Flags:
        return _over(misses_zero(curve, {}, sufficient), cells, 0.0, high).proved

    model = uncrossed(claims.model_poles, claims.model_any_position, model_curve_end(device, cells))
    return np.stack((model, uncrossed(claims.sampled_poles, claims.sampled_any_position, HALF_TURN)))


def model_curve_end(device: Device, cells: Cells, ops: Arithmetic = FLOATS) -> float:
    """Return a frequency beyond which the model's curve turns no more in any cell, rad/s; > 0 without a loop.

    Parameters
    ----------
    device : in numbers of the arithmetic; enclosures for all devices of a box
    cells : their greatest gains count
    ops : arithmetic of the device's numbers
    """
    K_v, K_p = (float(row.max(initial=0.0)) for row in cells.high[:2])
    return (1 + NEAR) * max(curve_end(device, K_v, K_p, ops), NEAR / ops.magnitude(device.sample_time))
