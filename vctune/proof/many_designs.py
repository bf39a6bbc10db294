"""The claims of a certificate for many cells at once, on arrays; what stays open is left to Arb.

See proof/README.md, section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from math import inf, pi

import numpy as np

from vctune.model.arithmetic import FLOATS, Arithmetic
from vctune.model.quantities import HAND, Device, Gains, Hand, Hands
from vctune.proof.array_claims import Claims, Demands, claims_of
from vctune.proof.array_intervals import Flags, Floats, decimal
from vctune.proof.box_tests import Curve, Margin, lower_bound_over, misses_zero, positive, turned_angles
from vctune.proof.boxes import Boxes, Cells, Integers, Values, band_of, over_cells, over_each, over_hands
from vctune.proof.branching import Proofs, Test
from vctune.proof.branching import prove as prove_boxes
from vctune.proof.claims import HALF_TURN, outwards, resistance_apart
from vctune.proof.envelope import envelope
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
HALVINGS_IN_HANDS, BOXES_IN_HANDS, TOGETHER_IN_HANDS = 4 * CELL_HALVINGS, 8_000, 128
"""The same for boxes of angle and hand, and how many cells are proved together: what is known of them fits into memory.
"""


@dataclass(frozen=True, slots=True)
class Certified:
    """What is proved of many cells.

    Attributes
    ----------
    proved : the cells all of whose designs meet all demands
    boxes : what it took to prove Llewellyn's conditions, |S|, the model's and the sampled poles, 0 for what is not
        demanded; shape (4, n)
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

    steps = ((0, conditions_hold), (1, sensitivity_holds), (slice(2, 4), poles_stay))
    left, boxes = np.arange(len(cells)), np.zeros((4, len(cells)), np.intp)
    for rows, holds in steps if demands.passive else steps[1:]:
        if len(left):
            proved, boxes[rows, left] = holds(cells.subset(left))
            left = left[proved]
    if demands.any_hand and len(left):
        left = left[_holds_in_any_hand(demands, claims, cells.subset(left))]
    if demands.hands is not None and len(left):
        left = left[_holds_in_hands(demands, claims, cells.subset(left))]
    if demands.factor > 1 and demands.device.coupling_may_drive and len(left):
        left = left[_proofs(replace(demands, factor=1.0), cells.subset(left)).proved]
    proved = np.zeros(len(cells), bool)
    proved[left] = True
    return Certified(proved, boxes)


def _holds_in_any_hand(demands: Demands, claims: Claims, cells: Cells) -> Flags:
    """Prove the demand in any passive hand on an impedance display."""
    if demands.device.least_damping == 0:
        return np.zeros(len(cells), bool)
    margin, size = (positive(each, {}) for each in claims.any_hand)
    if _have_the_same_gains(cells):  # and so the same size
        one = cells.subset(np.zeros(1, np.intp))
        return _over(size, one, 0.0, HALF_TURN).proved & _above_envelope(demands, None, claims, cells)
    return _over(size, cells, 0.0, HALF_TURN).proved & _over(margin, cells, 0.0, HALF_TURN).proved


def _holds_in_hands(demands: Demands, claims: Claims, cells: Cells) -> Flags:
    """Prove the demand in every hand.

    Where the margin is positive no pole of any design of the cell is on the unit circle in any hand: those of one
    design in one hand decide about all.
    """
    hands, proved = demands.hands, np.zeros(len(cells), bool)
    assert hands is not None
    # next to K_p = 0 F and P of an admittance display both vanish at theta = 0 in a hand without stiffness
    regular = demands.device.renders_force or hands.low.stiffness > 0
    hopeful = np.flatnonzero((cells.low[1] > 0) | regular)
    points = cells.subset(hopeful).centres()
    turns, _ = _turns_at(claims.poles_in_hand, points, HALF_TURN, pi, fixed=_in_hand(hands.middle))
    left = hopeful[turns == 0]
    if _have_the_same_gains(cells):
        proved[left] = _above_envelope(demands, hands, claims, cells.subset(left))
        return proved
    for some in np.split(left, range(TOGETHER_IN_HANDS, len(left), TOGETHER_IN_HANDS)):
        part = cells.subset(some)
        found = prove_boxes(
            positive(claims.in_hand, {}),
            over_hands(part, hands, band_of(0.0, HALF_TURN, STEP)),
            len(part),
            halved=_halved(cells, 1 + len(HAND)),
            max_halvings=HALVINGS_IN_HANDS,
            max_boxes=BOXES_IN_HANDS,
            at_ends=True,
            only_whole=True,
        )
        proved[some] = found.proved
    return proved


def _have_the_same_gains(cells: Cells) -> bool:
    """Return whether these are several couplings that meet the same gains."""
    return cells.extended and not np.ptp((cells.low[:2], cells.high[:2]), axis=(0, 2)).any()


def _above_envelope(demands: Demands, hands: Hands | None, claims: Claims, cells: Cells) -> Flags:
    """Prove the demand in every hand of a box, or in any, for couplings that meet the same gains.

    Cells are divided too, as the angle alone is besides; their callers divide those that are left.
    """
    if not len(cells):
        return np.zeros(0, bool)
    required = envelope(demands.device, hands, Gains(*map(float, cells.low[:2, 0])))
    found = prove_boxes(
        positive(claims.above_bound, {}),
        required.over(cells),
        len(cells),
        halved=(True, False, False, *[True] * len(cells.keys)),
        max_halvings=CELL_HALVINGS,
        max_boxes=MAX_BOXES,
        only_whole=True,
    )
    return found.proved


def _over(
    test: Test, cells: Cells, low: float, high: float, measure: Callable[[Boxes], Floats] | None = None
) -> Proofs:
    """Test cells over a band."""
    halvings = CELL_HALVINGS if cells.extended else HALVINGS
    boxes = over_cells(cells, band_of(low, high, STEP))
    return prove_boxes(
        test, boxes, len(cells), halved=_halved(cells, 1), max_halvings=halvings, max_boxes=MAX_BOXES, measure=measure
    )


def _halved(cells: Cells, rows: int) -> tuple[bool, ...]:
    """Return which rows are halved: intervals of frequency, and hands; cells are their caller's business."""
    return (*[True] * rows, *[False] * len(cells.keys))


@dataclass(frozen=True, slots=True)
class Places:
    """For each of n cells, where a demand may fail throughout; None where nothing is demanded.

    Attributes
    ----------
    theta_S : rad, angle omega T of |S|, shape (n,)
    omega : rad/s, frequencies of the band of Llewellyn's conditions, the hardest first, shape (any number, n)
    theta : rad, angles of any passive hand on an impedance display likewise
    in_hands : angles and hands likewise, shape (4, any number, n)
    """

    theta_S: Floats
    omega: Floats | None = None
    theta: Floats | None = None
    in_hands: Floats | None = None

    def subset(self, at: Integers) -> Places:
        """Return those of some of the cells."""
        some = (None if of is None else of[..., at] for of in (self.omega, self.theta, self.in_hands))
        return Places(self.theta_S[at], *some)


def refuted(demands: Demands, cells: Cells, places: Places) -> Flags:
    """Return the cells none of whose designs meets all demands.

    Parameters
    ----------
    demands : what is to be met
    cells : as for `prove`
    places : where to look
    """
    fails = np.zeros(len(cells), bool)
    for at in by_integrator(cells):
        claims, part = claims_of(demands), cells.subset(at)
        lost = negative_at(claims.sensitivity, part, places.theta_S[at])
        if places.omega is not None:
            lost |= negative_at(claims.conditions, part, places.omega[0, at])
            lost |= negative_at(claims.resistance, part, places.omega[0, at])
        if places.theta is not None:
            lost |= negative_at(claims.any_hand[0], part, places.theta[0, at])
        if places.in_hands is not None:
            lost |= negative_at(claims.in_hand, part, places.in_hands[:, 0, at])
        left = np.flatnonzero(~lost)
        number = encirclements(demands, part.subset(left)).number
        lost[left] = (np.isfinite(number) & (number != 0)).any(axis=0)
        if demands.hands is not None:
            left = np.flatnonzero(~lost)
            number = encirclements_in_hand(demands, part.subset(left))
            lost[left] = np.isfinite(number) & (number != 0)
        fails[at] = lost
    return fails


def negative_at(margin: Margin, cells: Cells, at: Floats) -> Flags:
    """Return where a margin is negative throughout each cell, at one place of its own.

    Parameters
    ----------
    margin : of a frequency and of values
    cells : n of them
    at : for each cell a frequency as the margin has it, or a frequency and a hand, as `over_each` takes them

    Returns
    -------
    array of bool
        Shape (n,).
    """
    return np.asarray(lower_bound_at(lambda omega, values: -margin(omega, values), cells, at) > 0)


def lower_bound_at(margin: Margin, cells: Cells, at: Floats) -> Floats:
    """Return a lower bound of a margin over each cell, at one place of its own, shape (number of cells,).

    Parameters
    ----------
    margin : of a frequency and of values
    cells : n of them
    at : for each cell a frequency as the margin has it, or a frequency and a hand, as `over_each` takes them

    Returns
    -------
    array of float
        In the margin's unit; nan where nothing is known of it.
    """
    return lower_bound_over(margin, over_each(cells, at), {})


@dataclass(frozen=True, slots=True)
class Encirclements:
    """How often the curves of every design of a cell go around 0.

    Attributes
    ----------
    number : of the model's curve, if it counts, and the sampled loop's, for each of the device's loops: 0 where
        stable, nan where not settled or not the same throughout the cell; one row each, shape (rows, n)
    boxes : pairs looked at, at the centres, for the model and for the sampled loop, shape (2, n)
    """

    number: Floats
    boxes: Integers


def encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return how often the curves of each cell go around 0; all of them with K_p > 0, or none.

    Parameters
    ----------
    demands : of which the device counts, with each of its loops, and whether its model does
    cells : n of them
    """
    parts = [_encirclements(replace(demands, device=loop), cells) for loop in demands.device.loops]
    number, boxes = (np.stack([getattr(part, name) for part in parts]) for name in Encirclements.__slots__)
    return Encirclements(np.concatenate(number), boxes.sum(axis=0))


def _encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return the numbers of one loop: as often as at a cell's centre, where no pole crosses over within it."""
    claims, device = claims_of(demands), demands.device
    same = _no_pole_crosses(demands, claims, cells) if cells.extended else np.ones((2, len(cells)), bool)
    number, boxes = np.full((2, len(cells)), np.nan), np.zeros((2, len(cells)), np.intp)
    calm = np.flatnonzero(same.any(axis=0))
    points = cells.subset(calm).centres()
    # the arguments are those of `vctune.proof.poles`: the model's curve ends within a third of a turn of where it goes;
    # the sampled loop's begins at F(1) > 0 and ends on the real axis
    if demands.passive:
        goal, end = final_angle(device, integral=bool(points.high[1].any())), model_curve_end(device, points)
        number[0, calm], boxes[0, calm] = _turns_at(claims.model_poles, points, end, 2 * pi, goal)
    number[1, calm], boxes[1, calm] = _turns_at(claims.sampled_poles, points, HALF_TURN, pi)
    number = np.where(same, number, np.nan)
    return Encirclements(number if demands.passive else number[1:], boxes)


def _turns_at(
    curve: Curve, points: Cells, end: float, turn: float, goal: float = 0.0, fixed: Values | None = None
) -> tuple[Floats, Integers]:
    """Return how often a curve goes around 0 at each point, nan where not settled, and the pairs looked at."""
    test, angles = misses_zero(curve, fixed or {}), turned_angles(curve, fixed or {})
    found = _over(test, points, 0.0, end, angles)
    return np.where(found.proved, np.round((goal - found.total) / turn), np.nan), found.boxes


def _no_pole_crosses(demands: Demands, claims: Claims, cells: Cells) -> Flags:
    """Return where no pole of the model, if it counts, and none of the sampled loop crosses over within a cell."""

    def uncrossed(curve: Curve, sufficient: Margin, high: float) -> Flags:
        return _over(misses_zero(curve, {}, sufficient), cells, 0.0, high).proved

    model = np.ones(len(cells), bool)
    if demands.passive:
        end = model_curve_end(demands.device, cells)
        model = uncrossed(claims.model_poles, claims.model_any_position, end)
    return np.stack((model, uncrossed(claims.sampled_poles, claims.sampled_any_position, HALF_TURN)))


def encirclements_in_hand(demands: Demands, cells: Cells) -> Floats:
    """Return how often the curve of the loop in one hand of the box goes around 0, nan where not settled: shape (n,).

    Parameters
    ----------
    demands : with the hands
    cells : n of them, all of them with K_p > 0, or none
    """
    assert demands.hands is not None
    claims, number = claims_of(demands), np.full(len(cells), np.nan)
    fixed = _in_hand(demands.hands.middle)
    same = _over(misses_zero(claims.poles_in_hand, fixed), cells, 0.0, HALF_TURN).proved
    calm = np.flatnonzero(same)
    if len(calm):
        number[calm], _ = _turns_at(claims.poles_in_hand, cells.subset(calm).centres(), HALF_TURN, pi, fixed=fixed)
    return number


def _in_hand(hand: Hand) -> Values:
    return dict(zip(HAND, map(decimal, astuple(hand)), strict=True))


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
