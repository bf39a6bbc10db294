"""Prove the loop in every hand of a box, with every passive environment or with a box of environments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from math import nextafter, pi

import numpy as np
from flint import arb

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hand_arrays import stacked
from vctune.model.hands import MASS, STIFFNESS, Hand, Hands
from vctune.model.numbers.keys import keys_of
from vctune.model.problem import Demands
from vctune.model.sampled.eliminated_spring import moves_as_two_states
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.worlds.loop_in_walls import LEADS
from vctune.model.sampled.worlds.loop_in_worlds import posed, sum_of
from vctune.model.worlds import WorldsMet
from vctune.proof.claims.array_claims import (
    AT_REST,
    SHARES,
    any_hand_margins,
    any_spring_margins,
    hands_margins,
    limp_hands_margins,
    whenever_margins,
)
from vctune.proof.claims.delay_parts import DELAY_ROWS, Ends, Part, parts_of, row_of
from vctune.proof.claims.in_hands.any_spring import left_by_any_spring
from vctune.proof.claims.in_hands.crossing import refuted_by_one
from vctune.proof.claims.in_hands.resonant_hands import AROUND, RATIO, Resonance, resonance
from vctune.proof.claims.margins_of_claims import (
    HALF_TURN,
    Design,
    LoopDelay,
    any_hand_margin,
    hand_curve,
    hand_margin,
    margins_in_worlds,
)
from vctune.proof.claims.sampled_poles import in_rad_per_s
from vctune.proof.claims.whole_samples import NEXT_TO
from vctune.proof.claims.worlds.walls import COUPLING_SHARE, fails_with_a_wall
from vctune.proof.device_box import (
    MOST_AT_ONCE,
    DeviceBox,
    felt_with_hand,
    in_both_delays,
    in_longer_hands,
    in_one_delay,
    late_as_one,
    moved_as_one,
)
from vctune.proof.enclosures.arb_balls import BALLS, ball, design_ball, device_ball, gains_ball
from vctune.proof.enclosures.array_intervals import Flags, Floats, decimal_or_inf
from vctune.proof.enclosures.jets import ENCLOSURES
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.engine.box_tests import alone, next_to_zero, positive
from vctune.proof.engine.boxes import SAMPLES_BEFORE, Boxes, Values, band_of, over_band
from vctune.proof.engine.branching import Decided, Test, prove
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.engine.polynomial_tests import FEW, any_positive, positive_by_polynomials
from vctune.proof.engine.winding import turned_angle

# Least relative distance between a box's share and the shares of its angles and hands at which the test omits the box
WITHIN = 1e-9


def with_own_share(test: Test, device: Device, names: tuple[str, ...]) -> Test:
    """Return a test that reports a box as proved if its share of the stiffness belongs to none of its angles and
    hands."""
    share, stiffness = (1 + names.index(name) for name in (SHARES[1], STIFFNESS))
    heavy = 1 + names.index(row_of("mass")) if row_of("mass") in names else None

    def of(frequency: Floats, stiffness: Floats, mass: Floats | float) -> Floats:
        spring = stiffness * (device.sample_time**2 / mass)
        return np.asarray(spring / (2 * np.sin(np.minimum(frequency, np.pi) / 2) + spring))

    def tested(boxes: Boxes) -> Decided:
        decided, low, high = test(boxes), boxes.low, boxes.high
        lightest, heaviest = (device.mass,) * 2 if heavy is None else (low[heavy], high[heavy])
        with np.errstate(invalid="ignore"):  # at rest the share may have any value
            least, most = of(high[0], low[stiffness], heaviest), of(low[0], high[stiffness], lightest)
            beside = (low[share] > most * (1 + WITHIN)) | (high[share] < least * (1 - WITHIN))
        return replace(decided, proved=decided.proved | beside)

    return tested


STEP = 1.4  # Ratio of the edges of the first intervals of the angle and of an uncertain mass
MAX_BOXES = 400_000  # Number of boxes after which the prover leaves the claim open
EASY_BOXES = 3_000  # Number of boxes after which hands near a sharp resonance get separate boxes
EASY_AFTER = 5  # Factor of `EASY_BOXES` for a claim that is proved for every stiffness first
# Number of boxes after which the prover looks for boxes that it can prove for every stiffness of the hand, and uses
# only the sides of the rectangles of uncertain masses and dampings of device and hand
EASY_WHOLE = 3_000
# Least number of parts of a box of delays for which the prover first tries the test for all numbers of whole samples in
# a servo's delay
MANY_PARTS = 3
EASY_PARTS = 4_000  # Number of boxes after which the prover treats an interval of angles for each part separately
# Distances from the ends of the angles, as shares of pi, at which the code looks for a witness
NEAR_ENDS = tuple(10.0**-k for k in range(1, 9))
MAX_HALVINGS = 120  # Greatest number of halvings of a box: twenty in each of six rows


def prove_hands(design: Design, demands: Demands, box: DeviceBox | None = None) -> Outcome:
    """Prove Re Z_c > factor R in every hand, or that the loop is stable in every hand with every environment of a
    box."""
    assert demands.hands is not None
    at_once = box is not None and len(box.modelled.uncertain) <= MOST_AT_ONCE
    refuted = refuted_by_one(design, demands, box.modelled.devices() if box and at_once else [design.device])
    if refuted is not None:
        return refuted
    if box is not None and (parts := moved_as_one(box)):
        return _moved_as_one(design, demands, demands.hands, box, parts)
    if box is not None and late_as_one(box):
        return _late_as_one(design, demands, box)
    kind = design.device.kind
    if kind.senses_force and kind.own_loop and not design.gains.closed:
        return Outcome(Verdict.PROVED, 0)  # without gains nothing drives the device
    stable = prove_stable_in_middle(design, demands)
    if stable.verdict is not Verdict.PROVED:
        return stable
    asked = Asked(design, demands, box)
    near = resonance(design, demands.hands, box) if design.device.kind.own_loop and not asked.walls else None
    easy = EASY_BOXES * (EASY_AFTER if asked.for_every_spring else 1)
    found = _decided(asked, asked.ends(), asked.tests, easy if near else MAX_BOXES, whenever=asked.whenever)
    if near and found.verdict is Verdict.UNDECIDED:
        left_to_it = partial(asked.tests, near=near)
        found, tried = _decided(asked, asked.ends(), left_to_it, MAX_BOXES), found.boxes
        if found.verdict is Verdict.PROVED:
            tried += found.boxes
            found = _proved_next_to(near, asked)
        found = replace(found, boxes=found.boxes + tried)
    found = replace(found, boxes=found.boxes + stable.boxes)
    return _and_without_reserve(found, prove_hands, design, demands, box)


def prove_stable_in_middle(design: Design, demands: Demands) -> Outcome:
    """Prove the loop stable in the hand at the centre of the box, with one of the required environments."""
    assert demands.hands is not None
    middle = demands.hands.middle
    stable = prove_poles_in(design.device, middle, design.gains)
    return stable if stable.verdict is Verdict.PROVED else replace(stable, hand=middle)


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
        """Whether the position is free near angle 0 in a hand without stiffness."""
        assert self.demands.hands is not None
        kind, free = self.design.device.kind, self.design.gains.position == 0
        return kind.senses_force and kind.own_loop and free and self.demands.hands.low.stiffness == 0

    @property
    def shared(self) -> bool:
        """Whether each share of the coupling has margins of its own, so that the share is a row."""
        return self.walls and self.demands.factor > 1

    @property
    def walls(self) -> bool:
        """Whether environments may be walls."""
        return self.demands.worlds is not None and self.demands.worlds.corner is not None

    @property
    def whenever(self) -> Callable[[Part, Values], Test] | None:
        """A test that implies the claim for parts with any number of whole samples; None if there is no such test."""
        servo = self.design.device.servo
        if servo is None or servo.stiffness is not None or self.demands.worlds is not None:
            return None

        def test(part: Part, fixed: Values) -> Test:
            of = partial(whenever_margins, self.demands, self.uncertain, part.delays)
            return positive_by_polynomials(of(TAYLOR), fixed, part.spans, positive(of(ENCLOSURES), fixed))

        return test

    def ends(self) -> Ends:
        """Return the least and the greatest value of each row except the angle."""
        assert self.demands.hands is not None
        # the requirement of a servo is convex in the hand; with a box of environments it is not
        of_servo = self.design.device.servo is not None and self.demands.worlds is None
        corners = self.demands.hands.corners if of_servo else None
        reserve = self.demands.factor if self.shared else None
        return _ends(self.demands.hands, self.box, self.uncertain, corners, limp=self.limp, reserve=reserve)

    @property
    def affine(self) -> tuple[tuple[str, str], ...]:
        """Pairs of rows, one of the device and one of the hand. If the sum of a pair is given, the margin is affine in
        the device's row."""
        if self.box is None or self.demands.worlds is not None or self.demands.hands is None:
            return ()
        return tuple((row_of(key), f"operator.{key}") for key in felt_with_hand(self.box))

    @property
    def for_every_spring(self) -> bool:
        """Whether the stiffness of the hand can be eliminated in closed form."""
        passive = self.demands.worlds is None and self.demands.hands is not None
        return passive and moves_as_two_states(self.design.device)

    def left_by_any_spring(self, part: Part, fixed: Values, boxes: Boxes, max_boxes: int) -> tuple[Boxes, int]:
        """Return the boxes in which the claim is not proved for every stiffness, and the number of evaluated boxes."""
        margins = any_spring_margins(self.demands, self.uncertain, part.delays, TAYLOR)
        return left_by_any_spring(margins, self.design.device, part, fixed, boxes, max_boxes)

    def tests(self, part: Part, fixed: Values, near: Resonance | None = None) -> list[Test]:
        """Return the tests that prove the claim on a part of the boxes."""
        return [self._test(part, fixed, near, lead) for lead in (LEADS if self.walls else LEADS[:1])]

    def _test(self, part: Part, fixed: Values, near: Resonance | None, lead: float) -> Test:
        test = _of_margins(self.demands, self.uncertain, part, fixed, lead=lead)
        at_rest = limp_hands_margins(self.demands, self.uncertain, part.delays, lead) if self.limp else ()
        if at_rest:
            test = with_own_share(next_to_zero(AT_REST, at_rest, fixed, test), self.design.device, self.names)
        return near.left_to_it(test, self.names) if near else test

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all rows except the angle."""
        return tuple(self.ends())


def _of_margins(
    demands: Demands,
    uncertain: tuple[str, ...],
    part: Part,
    fixed: Values,
    near: Resonance | None = None,
    lead: float = 0.0,
) -> Test:
    """Return the test that one of the margins is positive, for hands near a resonance or for all hands."""
    both = [hands_margins(demands, uncertain, part.delays, ops, lead) for ops in (ENCLOSURES, TAYLOR)]
    slopes, polynomials = (near.margins(each) for each in both) if near else both
    spans = part.spans
    if demands.worlds is not None:
        return any_positive(polynomials, slopes if demands.worlds.corner is None else None, fixed, spans)
    sloping, curved = (alone(each) for each in (slopes, polynomials))
    by_slopes = positive(sloping, fixed)
    return positive_by_polynomials(curved, fixed, spans, by_slopes)


def _proved_next_to(near: Resonance, asked: Asked) -> Outcome:
    """Prove the claim for hands near a resonance, with their stiffness relative to the resonant stiffness."""
    least, most = (np.array([share]) for share in AROUND)
    ends = _ends(asked.demands.hands, asked.box, asked.uncertain)
    beside = {RATIO if name == STIFFNESS else name: pair for name, pair in ends.items()} | {RATIO: (least, most)}

    def tests(part: Part, fixed: Values) -> list[Test]:
        test = _of_margins(asked.demands, asked.uncertain, part, fixed, near)
        return [near.in_range(test, tuple(beside))]

    return _decided(asked, beside, tests, MAX_BOXES, near)


def _moved_as_one(design: Design, demands: Demands, hands: Hands, box: DeviceBox, parts: tuple[str, ...]) -> Outcome:
    """Prove the claim for the device with the least mass and damping. The hands then include the ranges of both."""
    least = {key: box.low.number(key) for key in parts}
    one = replace(design, device=design.device.with_numbers(least))
    rest, longer = in_longer_hands(box, hands, parts)
    found = prove_hands(one, replace(demands, device=demands.device.with_numbers(least), hands=longer), rest)
    if found.hand is None or found.verdict is Verdict.PROVED:
        return found
    # the hand takes as much of each sum as its box permits, the device takes the rest
    own = {key: min(getattr(found.hand, key), getattr(hands.high, key)) for key in parts}
    beyond = {
        key: min(value + (getattr(found.hand, key) - own[key]), box.high.number(key)) for key, value in least.items()
    }
    hand, device = replace(found.hand, **own), (found.device or one.device).with_numbers(beyond)
    return _judged_again(found, replace(design, device=device), demands, hand)


def _late_as_one(design: Design, demands: Demands, box: DeviceBox) -> Outcome:
    """Prove the claim for servos in which a single delay, the servo's, has the range of the sum of both delays."""
    one = in_one_delay(box)
    found = prove_hands(replace(design, device=one.nominal), replace(demands, device=one.nominal), one)
    if found.hand is None or found.device is None or found.verdict is Verdict.PROVED:
        return found
    device = in_both_delays(box, found.device)
    return _judged_again(found, replace(design, device=device), demands, found.hand)


def _judged_again(found: Outcome, design: Design, demands: Demands, hand: Hand) -> Outcome:
    """Judge an unproved claim again, for a single device in a single hand. A refuted claim stays refuted only if it
    fails for them."""
    theta = None if found.witness is None else min(found.witness * design.device.sample_time, pi)
    each = [(factor, share) for factor in {demands.factor, 1.0} for share in {1.0, 1 / factor}]
    fails = theta is not None and any(
        _fails_at(design, replace(demands, factor=factor), hand, theta, share) for factor, share in each
    )
    refuted = found.verdict is Verdict.REFUTED and fails
    verdict = Verdict.REFUTED if refuted else Verdict.UNDECIDED
    return replace(found, verdict=verdict, hand=hand, device=design.device)


def prove_any_hand(design: Design, demands: Demands, box: DeviceBox | None = None) -> Outcome:
    """Prove Re 1/Z_c > factor R of an impedance display in any passive hand (model/README.md, section 15)."""
    uncertain = box.modelled.uncertain if box is not None else ()
    if design.device.least_damping == 0:
        return Outcome(Verdict.REFUTED, 0, pi / design.device.sample_time)  # R is infinite

    def tests(part: Part, fixed: Values) -> list[Test]:
        margin, size = any_hand_margins(demands, uncertain, part.delays)
        return [positive(each, fixed) for each in ([margin, size] if design.gains.velocity > 0 else [margin])]

    found = _decided(Asked(design, demands, box), _ends(None, box, uncertain), tests, MAX_BOXES)
    return _and_without_reserve(found, prove_any_hand, design, demands, box)


def _and_without_reserve(
    found: Outcome,
    proof: Callable[[Design, Demands, DeviceBox | None], Outcome],
    design: Design,
    demands: Demands,
    box: DeviceBox | None,
) -> Outcome:
    """Return an outcome that is proved only if the claim also holds with the factor 1."""
    if found.verdict is not Verdict.PROVED or demands.factor == 1 or not design.device.coupling_may_drive:
        return found
    again = proof(design, replace(demands, factor=1.0), box)
    return replace(again, boxes=found.boxes + again.boxes)


def _decided(
    asked: Asked,
    ends: Ends,
    tests: Callable[[Part, Values], list[Test]],
    max_boxes: int,
    near: Resonance | None = None,
    whenever: Callable[[Part, Values], Test] | None = None,
) -> Outcome:
    """Prove margins positive over all values of theta, the hand's parameters and the device's uncertain parameters."""
    sides, tried = sides_of_rectangles(ends, asked.affine), 0
    springs = near is None and asked.for_every_spring
    # with hands that have no stiffness, two shares are rows too, and few first attempts succeed
    if not asked.limp if springs else len(sides) > 1:
        found = _decided_over([ends], asked, tests, min(EASY_WHOLE, max_boxes), near, whenever)
        if found.verdict is not Verdict.UNDECIDED:
            return found
        tried = found.boxes
    found = _decided_over(sides, asked, tests, max_boxes, near, whenever, springs=springs)
    return replace(found, boxes=found.boxes + tried)


def _decided_over(
    sides: Sequence[Ends],
    asked: Asked,
    tests: Callable[[Part, Values], list[Test]],
    max_boxes: int,
    near: Resonance | None,
    whenever: Callable[[Part, Values], Test] | None,
    *,
    springs: bool = False,
) -> Outcome:
    """Prove the margins of `_decided` over several sides, each with the ends of its own rows."""
    boxes, fixed = 0, fixed_of(asked.design)
    apart = MASS in sides[0] and asked.demands.worlds is None
    parts = [part for ends in sides for part in parts_of(asked.design.device, ends, apart=apart)]
    left: slice | Flags = slice(None)
    if whenever is not None and len(parts) >= MANY_PARTS:
        left, boxes = _left_of_parts(whenever(parts[1], fixed), boxes_over(parts[1], near))
    for part in parts:
        first = boxes_over(part, near).subset(left)
        if springs and max_boxes > 0:
            first, count = asked.left_by_any_spring(part, fixed, first, max_boxes)
            boxes += count
        for test in tests(part, fixed):
            found = prove(
                part.within(test),
                first,
                1,
                halved=[True] * (1 + len(part.names)),
                max_halvings=MAX_HALVINGS,
                max_boxes=max_boxes,
                at_ends=True,
                few=FEW,
            )
            boxes += int(found.boxes[0])
            if not found.proved[0]:
                point = found.open[:, 0] if np.isnan(found.failing[0, 0]) else found.failing[:, 0]
                return _in_doubt(asked.design, asked.demands, asked.uncertain, part, point, boxes, near)
    return Outcome(Verdict.PROVED, boxes)


def sides_of_rectangles(ends: Ends, pairs: Sequence[tuple[str, str]]) -> list[Ends]:
    """Return the sides of rectangles, each of two rows, on which a margin is least."""
    found = [ends]
    for pair in pairs:
        if all((ends[name][0] < ends[name][1]).all() for name in pair):
            found = [_at_both_ends(each, name) for each in found for name in pair]
    return found


def _at_both_ends(ends: Ends, name: str) -> Ends:
    """Return two columns for each column: one with the given row at its least number, one with it at its greatest."""
    twice = {key: (np.tile(low, 2), np.tile(high, 2)) for key, (low, high) in ends.items()}
    at = np.concatenate(ends[name])
    return {**twice, name: (at, at)}


def fixed_of(design: Design) -> Values:
    """Return the parameters of a design by name, for proofs in which they are not rows of the boxes."""
    numbers = (*astuple(design.gains), *astuple(design.coupling))
    return dict(zip(keys_of(len(numbers)), map(decimal_or_inf, numbers), strict=True))


def boxes_over(part: Part, near: Resonance | None = None) -> Boxes:
    """Return the first boxes over the angle and all rows of a part, with one owner."""
    boxes = over_band(part.names, part.low, part.high, band_of(near.first if near else 0.0, HALF_TURN, STEP))
    boxes = replace(boxes, owner=np.zeros_like(boxes.owner))
    return boxes.divided(row_of("mass"), STEP) if row_of("mass") in part.names else boxes


def _left_of_parts(test: Test, boxes: Boxes) -> tuple[Flags, int]:
    """Return which boxes of each part remain to be proved, and the number of evaluated boxes."""
    own, left = np.arange(len(boxes)), np.ones(len(boxes), bool)
    beyond = np.flatnonzero(boxes.low[0] > 0)
    apart = replace(boxes.subset(beyond), owner=own[: len(beyond)])
    found = prove(
        test,
        apart,
        len(beyond),
        halved=[True] * len(boxes.names),
        max_halvings=MAX_HALVINGS,
        max_boxes=EASY_PARTS,
        at_ends=True,
        few=FEW,
        only_whole=True,
    )
    left[beyond] = ~found.proved
    return left, int(found.boxes.sum())


def _in_doubt(
    design: Design,
    demands: Demands,
    uncertain: tuple[str, ...],
    part: Part,
    point: Floats,
    boxes: int,
    near: Resonance | None,
) -> Outcome:
    """Decide in ball arithmetic at a point where array arithmetic did not prove the claim."""
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
    hand = near.hand(theta, values) if near else Hand.of(values) if STIFFNESS in values else None
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


def prove_poles_in(device: Device, hand: Hand, gains: Gains) -> Outcome:
    """Prove that the sampled loop is stable in one hand while the environment is at rest."""
    plant = plant_in_hand(device_ball(device), hand.mapped(ball), delays_of(device), BALLS)
    law = gains_ball(gains)
    outcome, angle = turned_angle(lambda theta: hand_curve(plant, law, theta, BALLS), 0.0, HALF_TURN)
    if outcome.verdict is not Verdict.PROVED:
        return in_rad_per_s(outcome, device)
    return Outcome(Verdict.PROVED if abs(angle) < pi / 2 else Verdict.REFUTED, outcome.boxes)


def _fails_at(design: Design, demands: Demands, hand: Hand | None, theta: float, share: float = 1.0) -> bool:
    """Return whether every margin in a hand, or in any hand, is negative at one angle, in ball arithmetic."""
    if hand is not None and demands.walls_met is not None:
        return 0 < theta < pi and fails_with_a_wall(design, demands, hand, theta, share)
    exact, delays, at, factor = design_ball(design), delays_of(design.device), arb(theta), ball(demands.factor)
    if hand is None:
        delay = LoopDelay(delays.loop, delays.loop_fractional)
        return bool(any_hand_margin(exact, delay, at, factor, BALLS)[0] < 0)
    plant = plant_in_hand(exact.device, hand.mapped(ball), delays, BALLS)
    if demands.worlds is None:
        return bool(hand_margin(plant, exact, at, factor, BALLS) < 0)
    found = margins_in_worlds(plant, exact, at, WorldsMet(demands.worlds.converted(ball), factor), BALLS)
    return all(bool(sum_of(getattr(found, name)) < 0) for name in posed(demands.worlds, demands.factor))


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
        ends |= {SHARES[0]: (np.zeros(1), np.zeros(1)), SHARES[1]: (np.zeros(1), np.ones(1))}  # without an integrator
    if reserve is not None:
        ends[COUPLING_SHARE] = np.array([nextafter(1 / reserve, 0.0)]), np.ones(1)
    if box is not None:
        of = ((key, box.low.number(key), box.high.number(key)) for key in uncertain)
        ends |= {row_of(key): (np.full(max(len(low), 1), a), np.full(max(len(low), 1), b)) for key, a, b in of}
    return ends
