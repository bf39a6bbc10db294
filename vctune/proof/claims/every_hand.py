"""Prove the loop in every hand of a box, with every passive environment or with a box of environments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from math import inf, isnan, nextafter, pi

import numpy as np

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.hands import MASS, STIFFNESS, Hand, Hands, stacked
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import keys_of
from vctune.model.problem import Demands
from vctune.model.sampled.loop_in_worlds import LEADS, Disjuncts, margin_names, real_at_nyquist, sum_of
from vctune.proof.box_tests import Margin, beside_zero, either, misses_zero, positive, sufficient
from vctune.proof.boxes import HALF_TURN, SAMPLES_BEFORE, Boxes, Values, band_of, over_band
from vctune.proof.claims.cases import COUPLING_SHARE, Case, exact_case, over
from vctune.proof.claims.crossing import Suspects, crossing, no_suspects
from vctune.proof.claims.delays import DELAY_ROWS, NEXT_TO, Ends, Part, parts_of, row_of
from vctune.proof.claims.loop_claims import in_rad_per_s, of_design
from vctune.proof.claims.margins_of_claims import (
    AT_REST,
    RHO_SHARES,
    any_hand_before_wall,
    any_hand_margin,
    any_hand_size,
    hand_curve,
    hand_margin,
    limp_hand_margin,
    limp_margins_in_worlds,
    margin_in_spring,
    margins_in_worlds,
)
from vctune.proof.claims.poles import coupling_turns, free_at_rest, hand_turns
from vctune.proof.claims.walls import fails_with_a_wall, limp_walls_margin, walls_margins
from vctune.proof.device_box import (
    MOST_AT_ONCE,
    DeviceBox,
)
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Floats, decimal_or_inf, surely_negative
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


def prove_hands(
    design: Design, demands: Demands, box: DeviceBox | None = None, suspects: Suspects = no_suspects
) -> Outcome:
    """Prove Re Z_c > factor R in every hand, or that the loop is stable in every hand with every environment of a
    box."""
    devices = _devices(design, box)
    for suspect in suspects(design, demands, devices) if demands.worlds and demands.worlds.corner is None else ():
        device, hand, (low, high) = suspect
        theta = crossing(design, demands, suspect) if low < high else None
        if low == high and _fails_at(replace(design, device=device), demands, hand, low):
            theta = low
        if theta is not None:
            off = device if len(devices) > 1 else None
            return Outcome(Verdict.REFUTED, 0, theta / device.sample_time, off, hand)
    asked = Asked(design, demands, box)
    found = no_pole_crosses(asked, asked.ends(), asked.tests)
    return _and_without_reserve(found, prove_hands, design, demands, box)


def _devices(design: Design, box: DeviceBox | None) -> list[Device]:
    """Return the devices of a box that are examined one by one."""
    at_once = box is not None and len(box.modelled.uncertain) <= MOST_AT_ONCE
    return [*box.modelled.devices()] if box is not None and at_once else [design.device]


def no_pole_crosses(asked: Asked, ends: Ends, tests: Callable[[Part, Values], Tests]) -> Outcome:
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
    - without gains and without drag nothing opposes a drift of the coupling's mass: R and Re Z_c are both 0 at rest,
      and no margin tells on which side a pole leaves 1. The claim is left undecided.
    """
    design, demands = asked.design, asked.demands
    if asked.drifts:
        return Outcome(Verdict.UNDECIDED, 0, 0.0)
    stable = prove_stable_in_middle(design, demands)
    if stable.verdict is not Verdict.PROVED:
        return stable
    found = _decided(asked, ends, tests)
    return replace(found, boxes=found.boxes + stable.boxes)


def prove_stable_in_middle(design: Design, demands: Demands) -> Outcome:
    """Prove the loop stable in the hand at the centre of the box, with one of the required environments."""
    assert demands.hands is not None
    found = hand_turns(of_design(design, demands))
    number, boxes, theta = float(found.number[0]), int(found.boxes[0]), float(found.point[0, 0])
    if number == 0:
        return Outcome(Verdict.PROVED, boxes)
    verdict, witness = (Verdict.UNDECIDED, theta) if isnan(number) else (Verdict.REFUTED, None)
    return in_rad_per_s(Outcome(verdict, boxes, witness, hand=demands.hands.middle), design.device)


@dataclass(frozen=True, slots=True)
class Asked:
    """A claim about a design in every hand: the rows of the boxes that cover it, and their tests."""

    design: Design  # design; its floats stand for the decimals that they print as
    demands: Demands  # constraints with hands
    box: DeviceBox | None  # box of devices that the claim covers; None for the design's own device

    @property
    def uncertain(self) -> tuple[str, ...]:
        """The keys of the device's parameters that are rows of the boxes."""
        return self.box.modelled.uncertain if self.box is not None else ()

    @property
    def limp(self) -> bool:
        """Whether the position is free in a hand without stiffness and the margin vanishes near angle 0, as that of an
        impedance display does not."""
        assert self.demands.hands is not None
        free = free_at_rest(self.demands, integral=self.design.gains.position > 0)
        return free and self.design.device.kind.senses_force and self.demands.hands.low.stiffness == 0

    @property
    def drifts(self) -> bool:
        """Whether nothing opposes a drift of the coupling's mass at rest."""
        kind, alone = self.design.device.kind, not self.design.gains.closed and self.demands.worlds is None
        return kind.senses_force and kind.own_loop and alone and self.design.series.drag == 0

    @property
    def shared(self) -> bool:
        """Whether each share of the coupling has margins of its own, so that the share is a row."""
        return self.walls and self.demands.factor > 1

    @property
    def walls(self) -> bool:
        """Whether environments may be walls."""
        return self.demands.worlds is not None and self.demands.worlds.corner is not None

    def ends(self) -> Ends:
        """Return the least and the greatest value of each row except the angle."""
        assert self.demands.hands is not None
        # the requirement of a servo is convex in the hand; with a box of environments it is not
        of_servo = self.design.device.servo is not None and self.demands.worlds is None
        corners = self.demands.hands.corners if of_servo else None
        reserve = self.demands.factor if self.shared else None
        return _ends(self.demands.hands, self.box, self.uncertain, corners, limp=self.limp, reserve=reserve)

    def tests(self, part: Part, fixed: Values) -> Tests:
        """Return the tests that prove the claim on a part of the boxes, after many boxes also for every stiffness."""
        found = [self._test(part, fixed, lead) for lead in (LEADS if self.walls else LEADS[:1])]
        if self.demands.worlds is not None or not self.design.device.kind.own_loop:
            return [(test, None) for test in found]
        every = over(margin_in_spring, self.demands, self.uncertain, part.delays)
        return [(test, either(test, every, fixed)) for test in found]

    def _test(self, part: Part, fixed: Values, lead: float) -> Test:
        def tested(of: Callable[[Case, Number], Number]) -> Margin:
            return over(of, self.demands, self.uncertain, part.delays)

        test, at_rest = positive(tested(margins_of(self.demands, lead)), fixed), limp_margins_of(self.demands, lead)
        if not self.limp or at_rest is None:
            return test
        return beside_zero(sufficient(tested(at_rest), fixed), test, AT_REST)


def margins_of(demands: Demands, lead: float) -> Callable[[Case, Number], Number]:
    """Return the margins in a hand, one of which must be positive at each point."""
    if demands.worlds is None:
        return hand_margin
    if demands.worlds.corner is not None:
        return partial(walls_margins, lead=lead)
    return partial(_sums_of, margins_in_worlds, margin_names(demands.worlds, demands.factor))


def limp_margins_of(demands: Demands, lead: float) -> Callable[[Case, Number], Number] | None:
    """Return `margins_of` divided by rho^2 for theta near 0, a hand without stiffness and K_p = 0, if there are any."""
    if demands.worlds is None:
        return limp_hand_margin
    if demands.worlds.corner is not None:
        return partial(limp_walls_margin, lead=lead) if demands.worlds.high.mass < inf else None
    names = [name for name in margin_names(demands.worlds, demands.factor) if name in ("resistive", "above")]
    return partial(_sums_of, limp_margins_in_worlds, names) if names else None


def _sums_of(
    margins: Callable[[Case, Number], Disjuncts], names: Sequence[str], case: Case, theta: Number
) -> tuple[Number, ...]:
    found = margins(case, theta)
    return (*(sum_of(getattr(found, name)) for name in names), *found.corners)


def prove_any_hand(design: Design, demands: Demands, box: DeviceBox | None = None) -> Outcome:
    """Prove Re 1/Z_c > factor R of an impedance display in any passive hand (model/README.md, section 15)."""
    uncertain = box.modelled.uncertain if box is not None else ()
    if (undamped := _undamped(design, demands)) is not None:
        return undamped

    def tests(part: Part, fixed: Values) -> Tests:
        asked = [any_hand_margin, any_hand_size] if design.gains.velocity > 0 else [any_hand_margin]
        return [(positive(over(each, demands, uncertain, part.delays), fixed), None) for each in asked]

    found = _decided(Asked(design, demands, box), _ends(None, box, uncertain), tests)
    return _and_without_reserve(found, prove_any_hand, design, demands, box)


def _undamped(design: Design, demands: Demands) -> Outcome | None:
    """Return the outcome for a motor without damping, whose responses in all passive hands have no bound: at no
    frequency if the device is rigid, else at rest; None for a motor with damping."""
    device = design.device
    if device.structure is None and device.least_damping == 0:
        return Outcome(Verdict.REFUTED, 0, pi / device.sample_time)
    if device.structure is None or device.damping > 0:
        return None
    near = (pi * off for off in NEAR_ENDS)
    theta = next((each for each in near if _fails_at(design, demands, None, each)), None)
    verdict = Verdict.UNDECIDED if theta is None else Verdict.REFUTED
    return in_rad_per_s(Outcome(verdict, 0, theta or pi * NEAR_ENDS[-1]), device)


def prove_wall_in_any_hand(design: Design, demands: Demands, box: DeviceBox | None = None) -> Outcome:
    """Prove the coupling as a wall in any passive hand (model/README.md, section 15)."""
    uncertain = box.modelled.uncertain if box is not None else ()
    if (undamped := _undamped(design, demands)) is not None:
        return undamped
    ends = _ends(None, box, uncertain)
    if design.device.structure is not None:  # else a weaker wall is stable if this one is: the margin is concave
        ends[COUPLING_SHARE] = np.zeros(1), np.ones(1)

    def tests(part: Part, fixed: Values) -> Tests:
        return [(positive(over(any_hand_before_wall, demands, uncertain, part.delays), fixed), None)]

    return _decided(Asked(design, demands, box), ends, tests)


def prove_wall_in_hands(
    design: Design, demands: Demands, box: DeviceBox | None = None, suspects: Suspects = no_suspects
) -> Outcome:
    """Prove the coupling as a wall in every hand of a box: no pole reaches the unit circle from within."""
    uncertain = box.modelled.uncertain if box is not None else ()
    for device, hand, (theta, _) in suspects(design, demands, _devices(design, box)):
        if _unstable_before_wall(replace(design, device=device), demands, hand):
            return Outcome(Verdict.REFUTED, 0, theta / device.sample_time, device if uncertain else None, hand)
    ends = _ends(demands.hands, box, uncertain, reserve=demands.factor if demands.factor > 1 else None)

    def tests(part: Part, fixed: Values) -> Tests:
        return [(misses_zero(over(hand_curve, demands, uncertain, part.delays), fixed), None)]

    return no_pole_crosses(Asked(design, demands, box), ends, tests)


def _unstable_before_wall(design: Design, demands: Demands, hand: Hand, share: float = 1.0) -> bool:
    """Return whether the loop certainly has a pole outside the unit circle, in a hand with a share of the wall."""
    demands = replace(demands, hands=Hands(hand, hand), factor=demands.factor * share)
    number = float(hand_turns(of_design(design, demands)).number[0])
    return not isnan(number) and number != 0


def _and_without_reserve(
    found: Outcome,
    proof: Callable[[Design, Demands, DeviceBox | None], Outcome],
    design: Design,
    demands: Demands,
    box: DeviceBox | None,
) -> Outcome:
    """Return an outcome that is proved only if the claim also holds with the factor 1, and 1/Z_c is stable."""
    if found.verdict is Verdict.PROVED and demands.factor > 1 and design.device.coupling_may_drive:
        again = proof(design, replace(demands, factor=1.0), box)
        return replace(again, boxes=found.boxes + again.boxes)
    if found.verdict is not Verdict.PROVED or not design.device.coupling_may_turn:
        return found
    counted = coupling_turns(of_design(design, demands, box))
    number, boxes = float(counted.number[0]), found.boxes + int(counted.boxes[0])
    if number == 0:
        return replace(found, boxes=boxes)
    if number > 0:
        return Outcome(Verdict.REFUTED, boxes)
    return in_rad_per_s(Outcome(Verdict.UNDECIDED, boxes, float(counted.point[0, 0])), design.device)


def _decided(
    asked: Asked,
    ends: Ends,
    tests: Callable[[Part, Values], Tests],
) -> Outcome:
    """Prove margins positive over all values of theta, the hand's parameters and the device's uncertain parameters."""
    boxes, fixed = 0, fixed_of(asked.design)
    apart = MASS in ends and asked.demands.worlds is None
    for part in parts_of(asked.design.device, ends, apart=apart):
        first = boxes_over(part)
        for test, later in tests(part, fixed):
            found = prove(part.within(test), first, 1, EFFORT, later=later and part.within(later))
            boxes += int(found.boxes[0])
            if not found.proved[0]:
                point = found.open[:, 0] if np.isnan(found.failing[0, 0]) else found.failing[:, 0]
                return _in_doubt(asked.design, asked.demands, asked.uncertain, part, point, boxes)
    return Outcome(Verdict.PROVED, boxes)


def fixed_of(design: Design) -> Values:
    """Return the parameters of a design by name, for proofs in which they are not rows of the boxes."""
    numbers = (*astuple(design.gains), *astuple(design.coupling))
    return dict(zip(keys_of(len(numbers)), map(decimal_or_inf, numbers), strict=True))


def boxes_over(part: Part) -> Boxes:
    """Return the first boxes over the angle and all rows of a part, with one owner."""
    boxes = over_band(part.names, part.low, part.high, band_of(0.0, HALF_TURN, STEP))
    boxes = replace(boxes, owner=np.zeros_like(boxes.owner))
    if row_of("mass") not in part.names:
        return boxes
    if MASS in part.names:  # the reciprocal of the sum of both masses has no bound over a wide range of both
        boxes = boxes.divided(MASS, SUM_STEP, boxes.low[boxes.names.index(row_of("mass"))].min())
    return boxes.divided(row_of("mass"), STEP)


def _in_doubt(
    design: Design,
    demands: Demands,
    uncertain: tuple[str, ...],
    part: Part,
    point: Floats,
    boxes: int,
) -> Outcome:
    """Decide at a point where boxes did not prove the claim."""
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
        return _fails_at(replace(design, device=device), demands, hand, theta, share)

    refuted = fails(theta)
    if refuted and theta in (0.0, pi):  # no motion grows at an end of the angles; close to an end, a motion may grow
        theta = next((beside for off in NEAR_ENDS if fails(beside := abs(theta - pi * off))), theta)
    outcome = Outcome(
        Verdict.REFUTED if refuted else Verdict.UNDECIDED, boxes, theta, device if uncertain else None, hand
    )
    return in_rad_per_s(outcome, device)


def _fails_at(design: Design, demands: Demands, hand: Hand | None, theta: float, share: float = 1.0) -> bool:
    """Return whether every margin in a hand, or in any hand, is certainly negative at one angle."""
    if hand is not None and demands.rigid:
        return _unstable_before_wall(design, demands, hand, share)
    if hand is not None and demands.walls_met is not None:
        return 0 < theta < pi and fails_with_a_wall(design, demands, hand, theta, share)
    there, at = exact_case(design, demands, hand, share), Enclosure(theta)
    if hand is None:
        return surely_negative(any_hand_before_wall(there, at) if demands.rigid else any_hand_margin(there, at))
    if demands.worlds is None:
        return surely_negative(hand_margin(there, at))
    real = real_at_nyquist(design.series, design.device.rule, demands.worlds)
    ends = theta == pi and real  # and a pole may pass z = -1
    found = margins_in_worlds(there, ENCLOSURES.pi if ends else at)
    names = ("resistive",) if ends else margin_names(demands.worlds, demands.factor)
    corners = () if ends else found.corners
    return all(surely_negative(each) for each in (*(sum_of(getattr(found, name)) for name in names), *corners))


def _ends(
    hands: Hands | None,
    box: DeviceBox | None,
    uncertain: tuple[str, ...],
    corners: Sequence[Hand] | None = None,
    *,
    limp: bool = False,
    reserve: float | None = None,
) -> Ends:
    """Return the ends of the rows of the boxes."""
    low, high = ([], []) if hands is None else ([hands.low], [hands.high])
    if corners is not None:
        low = high = list(corners)
    least, most = (stacked(each).by_key if each else {} for each in (low, high))
    ends = {key: (least[key], most[key]) for key in least}
    if limp:
        spring = np.sign([hands.high.stiffness]) if hands is not None else np.ones(1)
        ends |= {
            RHO_SHARES[0]: (np.zeros(1), np.zeros(1)),
            RHO_SHARES[1]: (np.zeros(1), spring),
        }  # without an integrator
    if reserve is not None:
        ends[COUPLING_SHARE] = np.array([nextafter(1 / reserve, 0.0)]), np.ones(1)
    if box is not None:
        of = ((key, box.low.number(key), box.high.number(key)) for key in uncertain)
        ends |= {row_of(key): (np.full(max(len(low), 1), a), np.full(max(len(low), 1), b)) for key, a, b in of}
    return ends
