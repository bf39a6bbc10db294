"""Prove a damping ratio: no pole of the loop lies outside the curve z = e^(s T), s = omega (-zeta +
j sqrt(1 - zeta^2)), in any hand of a box, with any environment of another (proof/README.md, section 13)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, replace
from functools import partial
from itertools import product
from math import isfinite
from typing import Any

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.hands import STIFFNESS, Hand, Hands, PlacesInHands
from vctune.model.loop.filters import force_sections, velocity_sections
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.numbers.complexes import Complex, Ray, as_one
from vctune.model.numbers.pair import Pair
from vctune.model.parts import DELAYS
from vctune.model.sampled.damped import AtRest, Spanned, characteristic, ray, without_position
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.plant_in_hand import Delays, ServoInHand
from vctune.model.sections import rows_of_sections
from vctune.model.worlds import WORLD, PlacesInWorlds, World, Worlds
from vctune.proof.box_tests import beside_zero, misses_zero, spans_miss_zero
from vctune.proof.boxes import Cells, Values, over_cells, over_hands
from vctune.proof.claims.cases import COUPLING_SHARE, Case, over
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import Covered, Place, of_design
from vctune.proof.claims.delays import DelayPart, Ends, parts_of, row_of
from vctune.proof.claims.hands import band, prove_cells
from vctune.proof.claims.in_hands import Asked, Tests, decided, devices_of, ends_of, uncertain_in
from vctune.proof.claims.poles import turned_back, turns
from vctune.proof.enclosures.intervals import Flags, Floats, decimal
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import Test
from vctune.running import boxes_at_most

OF_CELL = Effort(max_halvings=80, max_boxes=1_000, few=0)  # of a cell of servos, whose proof takes some hundred boxes
MOST_BOXES = 60_000  # of a proof; an arm takes 600, a wall some 2,000
CLOSE = 1e-6  # Least relative distance of the poles of filters from the curve


def _ray(case: Case) -> Ray:
    ratio = case.demands.damping_ratio
    assert ratio is not None
    return ray(decimal(ratio), case.ops)


def _spanned(of: Callable[..., Any], hands: Hands, worlds: Worlds, case: Case, along: Number) -> Any:
    """Return a function of `damped` for boxes of hands and environments, in the arithmetic of a case."""
    plant, design = case.held(), case.design
    assert isinstance(plant, ServoInHand)
    coupling = design.series.times(case.share)
    return of(plant.plant, coupling, design.device.rule, hands, worlds, along, _ray(case))


def damped_wall(case: Case, along: Number) -> Pair:
    """Return F of the loop in a hand against its coupling as a wall, at an angle of the curve with a real part; its
    zeros as a polynomial in 1/z are the poles."""
    plant, wall, ops = case.held(), case.design.coupling, _ray(case)
    theta = ops.angle(along)
    loop = loop_in_hand(plant, theta, ops)
    assert isinstance(loop, ForceInHand) and isinstance(wall, SpringDamper)
    F = loop.before_wall(wall, 1)
    found = as_one(Pair(F.even, ops.sin(theta / 2) * F.odd)) * as_one(turned_back(plant.poles, theta, ops))
    return Pair(found.re, found.im)


def damped_servo(free: bool, case: Case, along: Number) -> Pair:
    """Return the polynomial in 1/z whose zeros are the poles of a servo's loop in the hand and with the environment of
    a case, without that of a free position."""
    hand, world = case.hand, World.of(case.values)
    of = without_position if free else characteristic
    found = _spanned(of, Hands(hand, hand), Worlds(world, world), case, along)
    total = _sum(found.spanned if free else found)
    return Pair(total.re, total.im)


def is_free(device: Device, hand: Hand, world: World) -> bool:
    """Return whether no spring holds the position of a servo."""
    return bool(hand.stiffness == 0 == world.stiffness) and not (device.servo and device.servo.stiffness)


def _sum(found: Spanned) -> Complex:
    total = found.fixed
    for of, low, _ in found.spans:
        total = total + of * low
    return total


def _met(demands: Demands) -> Worlds:
    """Return the environments of the claim; nothing before a rigid world."""
    nothing = World(0.0, 0.0, 0.0)
    return Worlds(nothing, nothing) if demands.worlds is None else demands.worlds.linear


def exactly_met(demands: Demands) -> tuple[Hands, Worlds]:
    """Return the boxes of hands and environments in enclosures."""
    hands = demands.hands
    assert hands is not None
    return Hands(hands.low.mapped(decimal), hands.high.mapped(decimal)), _met(demands).converted(decimal)


def poles_outside(design: Design, demands: Demands, hand: Hand, world: World) -> tuple[float, int]:
    """Return the number of poles outside the curve in a hand with an environment, nan if it is open, and the number of
    boxes of the count."""
    demands = replace(demands, hands=Hands(hand, hand))
    curve = damped_wall if demands.rigid else partial(damped_servo, is_free(design.device, hand, world))
    there = of_design(design, demands)
    exactly = {key: decimal(number) for key, number in {**hand.by_key, **world.by_key}.items()}
    there = replace(there, fixed={**there.fixed, **exactly})
    found = turns(there, curve, Covered.around_circle, np.pi)
    return float(found.number[0]), int(found.boxes[0])


def poles_beyond(cells: Covered, places: PlacesInWorlds, share: float = 1.0) -> Floats:
    """Return the number of poles outside the curve throughout each cell, in the hand and with the environment of its
    place, with a share of its coupling; nan where it is open."""
    demands, number = cells.demands, np.full(cells.owners, np.nan)
    own = places.in_hands.hands.by_key | ({} if demands.rigid else places.worlds.by_key)
    for box in (demands.hands, _met(demands)):  # an estimate may be next to a box
        assert box is not None
        ends = {key: (low, box.high.by_key[key]) for key, low in box.low.by_key.items()}
        own |= {key: np.clip(own[key], *ends[key]) for key in own if key in ends}
    mass, held = own.get(WORLD[0], np.ones(cells.owners)) > 0, np.ones(cells.owners, bool)
    if not demands.rigid:
        servo = demands.device.servo
        held = (own[STIFFNESS] + own[WORLD[2]] > 0) | bool(servo and servo.stiffness)
    for is_heavy, is_held in product((False, True), (False, True)):
        some = np.flatnonzero((mass == is_heavy) & (held == is_held))
        if not len(some):
            continue
        rows = {key: numbers[some] for key, numbers in own.items() if is_heavy or key != WORLD[0]}
        part, numbers = cells.subset(some), np.array([*rows.values()])
        low, high = np.vstack((part.low, numbers)), np.vstack((part.high, numbers))
        fixed = {COUPLING_SHARE: decimal(share), **({} if is_heavy else {WORLD[0]: decimal(0.0)})}
        part = replace(part, names=(*part.names, *rows), low=low, high=high, fixed=fixed)
        curve = damped_wall if demands.rigid else partial(damped_servo, not is_held)
        number[some] = turns(part, curve, Covered.around_circle, np.pi).number
    return number


def _hold(cells: Covered) -> Flags:
    """Return the cells of which each design has the ratio: no pole is outside at the centre in the middle hand, and
    none crosses the curve."""
    demands, hands, worlds = cells.demands, cells.demands.hands, _met(cells.demands)
    assert hands is not None
    if not _filters_are_inside(demands.device, demands):
        return np.zeros(cells.owners, bool)

    def each(number: float) -> Floats:
        return np.full(cells.owners, number)

    middle = PlacesInHands(each(0.0), hands.middle.mapped(each))
    proved = poles_beyond(cells.centres(), PlacesInWorlds(middle, World(*map(each, astuple(worlds.low))))) == 0
    left = np.flatnonzero(proved)
    each_cell = Cells(cells.low[:, left], cells.high[:, left])
    if demands.rigid:
        test, boxes = misses_zero(over(damped_wall, demands), {}), over_hands(each_cell, hands, band())
    else:
        test, boxes = _spans_miss_zero(demands, (), None, {}), over_cells(each_cell, band())
    proved[left] = prove_cells(test, boxes, len(left), OF_CELL)
    return proved


def _lost(cells: Covered, places: Place) -> Flags:
    """Return the cells throughout which a pole is outside the curve, each in the hand with the environment of its
    place."""
    lost = np.zeros(cells.owners, bool)
    if not isinstance(places, PlacesInWorlds):
        return lost
    for place in places.each:
        left = np.flatnonzero(~lost & np.isfinite(place.in_hands.at))
        lost[left] = np.nan_to_num(poles_beyond(cells.subset(left), place[left]), nan=0.0) > 0
    return lost


def _prove(question: Question, _known: Outcomes) -> Outcome:
    """Prove that no pole is outside the curve: none is in the middle hand, and none crosses it."""
    design, demands, box = question.design, question.demands, question.box
    hands, worlds, uncertain = demands.hands, _met(demands), uncertain_in(box)
    assert hands is not None
    if not _filters_are_inside(design.device, demands):
        return Outcome(Verdict.UNDECIDED, 0)
    ends = worlds.least_damped
    for device, hand, (theta, _) in question.ringing(design, demands, devices_of(question)):
        for world in ends:
            if poles_outside(replace(design, device=device), demands, hand, world)[0] > 0:
                return Outcome(Verdict.REFUTED, 0, theta / device.sample_time, device if uncertain else None, hand)
    middle = hands.middle
    number, boxes = poles_outside(design, demands, middle, worlds.low)
    if number != 0:
        verdict = Verdict.REFUTED if isfinite(number) else Verdict.UNDECIDED
        return Outcome(verdict, boxes, hand=middle)

    def tests(part: DelayPart, fixed: Values) -> Tests:
        if demands.rigid:
            return [(misses_zero(over(damped_wall, demands, uncertain, part.delays), fixed), None)]
        return [(_spans_miss_zero(demands, uncertain, part.delays, fixed), None)]

    asked = Asked(question, tests, lambda *_: False, apart=demands.rigid)
    rows = ends_of(hands if demands.rigid else None, box)
    for device in () if demands.rigid else _of_each_part(design.device, rows, uncertain):
        number, more = poles_outside(replace(design, device=device), demands, middle, worlds.low)
        boxes += more
        if number != 0:
            verdict = Verdict.REFUTED if isfinite(number) else Verdict.UNDECIDED
            return Outcome(verdict, boxes, device=device, hand=middle)
    with boxes_at_most(MOST_BOXES):
        found = decided(asked, rows)
    if found.verdict is not Verdict.PROVED:  # the estimate leaves out what oscillates below 0.1 Hz
        for hand, world in product(hands.corners, ends):
            if poles_outside(design, demands, hand, world)[0] > 0:
                return Outcome(Verdict.REFUTED, found.boxes + boxes, hand=hand)
    return replace(found, boxes=found.boxes + boxes)


def _spans_miss_zero(demands: Demands, uncertain: tuple[str, ...], delays: Delays | None, fixed: Values) -> Test:
    """Return the test that no pole of a servo is on the curve in any hand with any environment."""
    boxed = exactly_met(demands)
    fixed = {**fixed, **boxed[0].low.by_key}  # the boxes have no rows of hands

    def of(spanned: Callable[..., Any]) -> Test:
        return spans_miss_zero(over(partial(spanned, *boxed), demands, uncertain, delays), fixed)

    return beside_zero(of(partial(_spanned, without_position)), of(_away))


def _of_each_part(device: Device, rows: Ends, uncertain: Sequence[str]) -> Iterator[Device]:
    """Yield a device of each part of an uncertain delay: where the sensed force jumps, between two of them, poles do
    not move continuously."""
    if not any(key in uncertain for key in DELAYS):
        return
    for part in parts_of(device, rows):
        middle = dict(zip(part.names, 0.5 * (part.low[:, 0] + part.high[:, 0]), strict=True))
        yield device.with_numbers({key: float(middle[row_of(key)]) for key in uncertain})


def _away(hands: Hands, worlds: Worlds, case: Case, along: Number) -> AtRest:
    return AtRest(_spanned(characteristic, hands, worlds, case, along), ())


def _filters_are_inside(device: Device, demands: Demands) -> bool:
    """Return whether the poles of the firmware's filters, which are poles of the curve, are inside; those of servo and
    sensor have a ratio of at least 0.7."""
    assert demands.damping_ratio is not None
    for _, _, _, a_0, a_1, a_2 in rows_of_sections((*velocity_sections(device, FLOATS), *force_sections(device))):
        z = np.roots([a_0, a_1, a_2]).astype(complex)
        s = np.log(z[z != 0])
        if np.any(-s.real < demands.damping_ratio * (1 + CLOSE) * np.abs(s)):
            return False
    return True


DAMPING = Claim(
    id="damping_ratio",
    sentence="every oscillation in every hand has at least the damping ratio that is demanded",
    quantity="damping_ratio",
    margin=damped_wall,
    witness="a hand of `[operator]` in which a motion has a smaller ratio",
    label="damping ratio",
    explain=(
        "No pole of the exact sampled loop lies outside the curve of the poles with the damping ratio "
        "`stability.damping_ratio`: after a push, every oscillation falls to 4 % in at most a cycle over twice the "
        "ratio. The claim covers each hand of `[operator]` with each mass and spring of `[environment]` beside its "
        "least damping, or the coupling as a wall. The design itself has the ratio; a share of its coupling, as the "
        "safety factor allows, may not. A position that nothing holds is no oscillation."
    ),
    when="with `stability.damping_ratio`",
    asked=lambda demands, _: demands.damping_ratio is not None,
    prove=_prove,
    cells=_hold,
    lost=_lost,
)
