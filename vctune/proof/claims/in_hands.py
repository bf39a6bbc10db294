"""Prove that a loop is stable in every hand of a box: boxes over the angle, the hand and the device, and the count of
poles in one hand (proof/README.md, section 7)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from math import isnan, nextafter, pi
from typing import Any

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.hands import MASS, STIFFNESS, Hand, Hands, hands_as_one
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import keys_of
from vctune.model.sampled.hand_loop import NextToRest
from vctune.model.sampled.plant_in_hand import PlantInHand
from vctune.proof.box_tests import beside_zero, positive, sufficient
from vctune.proof.boxes import FREQUENCY, HALF_TURN, SAMPLES_BEFORE, Boxes, Values, band_of, over_band
from vctune.proof.claims.cases import COUPLING_SHARE, Case, exact_case, over
from vctune.proof.claims.claim import Question
from vctune.proof.claims.covered import Covered, in_rad_per_s, of_design
from vctune.proof.claims.delays import DELAY_ROWS, NEXT_TO, DelayPart, Ends, parts_of, row_of
from vctune.proof.claims.poles import coupling_turns, free_at_rest, hand_turns
from vctune.proof.device_box import MOST_AT_ONCE, DeviceBox
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats, decimal_or_inf, surely_negative
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import Test, prove

STEP = 1.4  # Ratio of the edges of the first intervals of the angle and of an uncertain mass
SUM_STEP = 8.0  # Ratio of the edges of the first intervals of an uncertain mass together with the hand's
# twenty halvings in each of six rows; after 1,000 boxes the prover also tries every stiffness at once
EFFORT = Effort(max_halvings=120, max_boxes=250_000, easy=1_000)
Tests = list[tuple[Test, Test | None]]  # tests that all must hold, each with the later test of `prove`
# Distances from the ends of the angles, as shares of pi, at which the code looks for a witness
NEAR_ENDS = tuple(10.0**-k for k in range(1, 9))
# The names of the rows for the shares of rho (model/README.md, section 14)
RHO_SHARES = "share of the integrator", "share of the hand's stiffness in the rest"
# The names of the two rows that both begin at 0 in a box of hands next to rest: the angle and the stiffness
AT_REST = (FREQUENCY, STIFFNESS)
# Words of the claims in hands about a servo that moves several axes (model/README.md, section 17)
ON_AXES = (
    " On several axes of one servo with the same law it covers hands at every angle to them: symmetric matrices of "
    "mass, damping and stiffness whose eigenvalues lie in these ranges."
)


# Whether a claim certainly fails: for a design, in a hand or in any, at an angle, with a share of the coupling
Fails = Callable[[Design, Hand | None, float, float], bool]


@dataclass(frozen=True, slots=True)
class Asked:
    """A claim about a design in every hand, on every device of a box."""

    question: Question
    tests: Callable[[DelayPart, Values], Tests]  # the tests that prove the claim on a part of the boxes
    fails: Fails
    # whether the whole samples of an uncertain delay are a row of the boxes, where this needs fewer of them than a part
    # for each number of samples
    apart: bool = False


def certainly(question: Question, margin: Callable[[Case, Number], Any]) -> Fails:
    """Return the function that tells whether a margin is certainly negative."""

    def fails(design: Design, hand: Hand | None, theta: float, share: float) -> bool:
        return surely_negative(margin(exact_case(design, question.demands, hand, share), Enclosure(theta)))

    return fails


def uncertain_in(box: DeviceBox | None) -> tuple[str, ...]:
    """Return the keys of a box's parameters that are rows of the boxes of a proof in hands."""
    return box.modelled.uncertain if box is not None else ()


def limp(demands: Demands, *, integral: bool) -> bool:
    """Return whether the margin of a coupling vanishes near angle 0: the position is free in a hand without stiffness,
    before a device that senses a force. F itself vanishes wherever the position is free (`free_at_rest`)."""
    assert demands.hands is not None
    free = free_at_rest(demands, integral=integral)
    return free and demands.device.kind.senses_force and demands.hands.low.stiffness == 0


def tested_with(
    question: Question,
    part: DelayPart,
    fixed: Values,
    margin: Callable[[Case, Number], Any],
    at_rest: Callable[[Case, Number], Any] | None,
) -> Test:
    """Return the test that one of some margins of a coupling is positive, near angle 0 in a limp hand those divided by
    rho^2."""
    demands, uncertain = question.demands, uncertain_in(question.box)
    test = positive(over(margin, demands, uncertain, part.delays), fixed)
    if at_rest is None or not limp(demands, integral=question.design.gains.position > 0):
        return test
    return beside_zero(sufficient(over(at_rest, demands, uncertain, part.delays), fixed), test, AT_REST)


def no_pole_crosses(asked: Asked, ends: Ends) -> Outcome:
    """Prove that no pole of the loop is outside the unit circle in any hand and on any device of the boxes.

    The poles are the zeros of F, a polynomial in z whose first coefficient is 1, so they move continuously with the
    numbers of hand and device; a delay that gains a sample adds a pole at 0. In the hand in the middle of the box none
    is outside the circle, which is counted. One that is outside in another hand has crossed the circle between the two,
    where F is 0. So it suffices that F is not 0 for any hand at any angle, which a positive margin implies, or a curve
    that misses 0. At rest, z = 1, there are three cases:

    - a spring holds the position, of the firmware or of every hand: the margin is regular there and positive;
    - the position is free in a hand without stiffness, which has a pole at z = 1 that the count divides out. The margin
      vanishes there with rho^2; divided by rho^2 it is positive, so that no other pole is at 1, and the one that leaves
      1 as the hand gains stiffness moves into the circle (model/README.md, section 14);
    - without gains and without drag nothing opposes a drift of the coupling's mass, and the claim is left undecided
      before it comes here.
    """
    stable = prove_stable_in_middle(asked.question)
    if stable.verdict is not Verdict.PROVED:
        return stable
    found = decided(asked, ends)
    return replace(found, boxes=found.boxes + stable.boxes)


def prove_stable_in_middle(question: Question) -> Outcome:
    """Prove the loop stable in the hand at the centre of the box, with one of the required environments."""
    design, demands = question.design, question.demands
    assert demands.hands is not None
    found = hand_turns(of_design(design, demands))
    number, boxes, theta = float(found.number[0]), int(found.boxes[0]), float(found.point[0, 0])
    if number == 0:
        return Outcome(Verdict.PROVED, boxes)
    verdict, witness = (Verdict.UNDECIDED, theta) if isnan(number) else (Verdict.REFUTED, None)
    return in_rad_per_s(Outcome(verdict, boxes, witness, hand=demands.hands.middle), design.device)


def and_without_reserve(found: Outcome, proof: Callable[[Question], Outcome], question: Question) -> Outcome:
    """Return an outcome that is proved only if the claim also holds with the factor 1, and 1/Z_c is stable."""
    design, demands = question.design, question.demands
    if found.verdict is Verdict.PROVED and demands.factor > 1 and design.device.coupling_may_drive:
        again = proof(replace(question, demands=replace(demands, factor=1.0)))
        return replace(again, boxes=found.boxes + again.boxes)
    if found.verdict is not Verdict.PROVED or not design.device.coupling_may_turn:
        return found
    counted = coupling_turns(of_design(design, demands, question.box))
    number, boxes = float(counted.number[0]), found.boxes + int(counted.boxes[0])
    if number == 0:
        return replace(found, boxes=boxes)
    if number > 0:
        return Outcome(Verdict.REFUTED, boxes)
    return in_rad_per_s(Outcome(Verdict.UNDECIDED, boxes, float(counted.point[0, 0])), design.device)


def and_without_reserve_in_cells(holds: Callable[[Covered], Flags], cells: Covered) -> Flags:
    """Return the cells in which a constraint holds, as `and_without_reserve` asks for."""
    demands, proved = cells.demands, holds(cells)
    if demands.device.coupling_may_turn:
        proved &= coupling_turns(cells).number == 0
    if demands.factor > 1 and demands.device.coupling_may_drive:
        left = np.flatnonzero(proved)
        proved[left] = holds(replace(cells.subset(left), demands=replace(demands, factor=1.0)))
    return proved


def decided(asked: Asked, ends: Ends) -> Outcome:
    """Prove margins positive over all values of theta, the hand's parameters and the device's uncertain parameters."""
    boxes, design = 0, asked.question.design
    fixed = fixed_of(design)
    for part in parts_of(design.device, ends, apart=asked.apart):
        first = boxes_over(part)
        for test, later in asked.tests(part, fixed):
            found = prove(part.within(test), first, 1, EFFORT, later=later and part.within(later))
            boxes += int(found.boxes[0])
            if not found.proved[0]:
                point = found.open[:, 0] if np.isnan(found.failing[0, 0]) else found.failing[:, 0]
                return _in_doubt(asked, part, point, boxes)
    return Outcome(Verdict.PROVED, boxes)


def fixed_of(design: Design) -> Values:
    """Return the parameters of a design by name, for proofs in which they are not rows of the boxes."""
    numbers = (*astuple(design.gains), *astuple(design.coupling))
    return dict(zip(keys_of(len(numbers)), map(decimal_or_inf, numbers), strict=True))


def boxes_over(part: DelayPart) -> Boxes:
    """Return the first boxes over the angle and all rows of a part, with one owner."""
    boxes = over_band(part.names, part.low, part.high, band_of(0.0, HALF_TURN, STEP))
    boxes = replace(boxes, owner=np.zeros_like(boxes.owner))
    if row_of("mass") not in part.names:
        return boxes
    if MASS in part.names:  # the reciprocal of the sum of both masses has no bound over a wide range of both
        boxes = boxes.divided(MASS, SUM_STEP, boxes.low[boxes.names.index(row_of("mass"))].min())
    return boxes.divided(row_of("mass"), STEP)


def _in_doubt(asked: Asked, part: DelayPart, point: Floats, boxes: int) -> Outcome:
    """Decide at a point where boxes did not prove the claim."""
    design, uncertain = asked.question.design, uncertain_in(asked.question.box)
    for row, name in enumerate(part.names):
        if name in DELAY_ROWS:  # at the ends of this row the number of whole samples changes
            inwards = np.minimum(NEXT_TO * design.device.sample_time, (part.high[row] - part.low[row]) / 2)
            part.low[row], part.high[row] = part.low[row] + inwards, part.high[row] - inwards
    within = np.clip(point[1:], part.low.min(axis=1), part.high.max(axis=1)).tolist()
    values, theta = dict(zip(part.names, within, strict=True)), min(float(point[0]), pi)
    if part.range is not None:
        own = row_of(design.device.delay_key)
        delay = round(values.pop(SAMPLES_BEFORE)) * part.sample_time + values[own]
        values[own] = min(max(delay, part.range[0]), part.range[1])
    device = design.device.with_numbers({key: values[row_of(key)] for key in uncertain})
    hand = Hand.of(values) if STIFFNESS in values else None
    share = values.get(COUPLING_SHARE, 1.0)

    def fails(theta: float) -> bool:
        return asked.fails(replace(design, device=device), hand, theta, share)

    refuted = fails(theta)
    if refuted and theta in (0.0, pi):  # no motion grows at an end of the angles; close to an end, a motion may grow
        theta = next((beside for off in NEAR_ENDS if fails(beside := abs(theta - pi * off))), theta)
    outcome = Outcome(
        Verdict.REFUTED if refuted else Verdict.UNDECIDED, boxes, theta, device if uncertain else None, hand
    )
    return in_rad_per_s(outcome, device)


def ends_of(
    hands: Hands | None,
    box: DeviceBox | None,
    corners: Sequence[Hand] | None = None,
    *,
    at_rest: bool = False,
    reserve: float | None = None,
) -> Ends:
    """Return the ends of the rows of the boxes."""
    low, high = ([], []) if hands is None else ([hands.low], [hands.high])
    if corners is not None:
        low = high = list(corners)
    least, most = (hands_as_one(each).by_key if each else {} for each in (low, high))
    ends = {key: (least[key], most[key]) for key in least}
    if at_rest:
        spring = np.sign([hands.high.stiffness]) if hands is not None else np.ones(1)
        ends |= {
            RHO_SHARES[0]: (np.zeros(1), np.zeros(1)),
            RHO_SHARES[1]: (np.zeros(1), spring),
        }  # without an integrator
    if reserve is not None:
        ends[COUPLING_SHARE] = np.array([nextafter(1 / reserve, 0.0)]), np.ones(1)
    if box is not None:
        of = ((key, box.low.number(key), box.high.number(key)) for key in uncertain_in(box))
        ends |= {row_of(key): (np.full(max(len(low), 1), a), np.full(max(len(low), 1), b)) for key, a, b in of}
    return ends


def devices_of(question: Question) -> list[Device]:
    """Return the devices of a box that are examined one by one."""
    box = question.box
    at_once = box is not None and len(box.modelled.uncertain) <= MOST_AT_ONCE
    return [*box.modelled.devices()] if box is not None and at_once else [question.design.device]


def next_to_rest(case: Case, theta: Number) -> tuple[PlantInHand, NextToRest]:
    """Return the plant, and the sum rho with its shares, which are rows of the boxes (model/README.md, section 14)."""
    plant, v = case.held(), case.values
    assert isinstance(plant, PlantInHand)  # only a velocity loop has K_p
    integrator, others = v[RHO_SHARES[0]], 1 - v[RHO_SHARES[0]]
    stiffness = case.hand.stiffness + case.design.gains.position
    stiffness = stiffness * (plant.sample_time * plant.sample_time / plant.mass)
    turned, spring = others * (1 - v[RHO_SHARES[1]]), others * v[RHO_SHARES[1]]
    return plant, NextToRest(2 * case.ops.sin(theta / 2) + stiffness, turned, spring, integrator)
