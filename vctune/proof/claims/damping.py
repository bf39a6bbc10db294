"""Prove a damping ratio: no pole of the loop lies outside the curve z = e^(s T), s = omega (-zeta +
j sqrt(1 - zeta^2)), in any hand of a box, with any environment of another (proof/README.md, section 13)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from math import isfinite
from typing import Any

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.hands import Hand, Hands
from vctune.model.loop.filters import force_sections, velocity_sections
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.numbers.complexes import Complex, Ray, as_one
from vctune.model.numbers.pair import Pair
from vctune.model.parts import DELAYS
from vctune.model.sampled.damped import AtRest, Spanned, characteristic, ray, without_position
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.plant_in_hand import ServoInHand
from vctune.model.sections import rows_of_sections
from vctune.model.worlds import World, Worlds
from vctune.proof.box_tests import beside_zero, misses_zero, spans_miss_zero
from vctune.proof.boxes import Values
from vctune.proof.claims.cases import Case, over
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import Covered, of_design
from vctune.proof.claims.delays import DelayPart, Ends, parts_of, row_of
from vctune.proof.claims.in_hands import Asked, Tests, decided, devices_of, ends_of, uncertain_in
from vctune.proof.claims.poles import turned_back, turns
from vctune.proof.enclosures.intervals import decimal
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import boxes_at_most

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
    return of(plant.plant, design.series, design.device.rule, hands, worlds, along, _ray(case))


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


def damped_servo(hand: Hand, world: World, case: Case, along: Number) -> Pair:
    """Return the polynomial in 1/z whose zeros are the poles of a servo's loop in a hand with an environment, without
    that of a free position."""
    hands, worlds = Hands(hand.mapped(decimal), hand.mapped(decimal)), Worlds(world, world).converted(decimal)
    free = _is_free(hand, world, case)
    found = _spanned(without_position if free else characteristic, hands, worlds, case, along)
    total = _sum(found.spanned if free else found)
    return Pair(total.re, total.im)


def _is_free(hand: Hand, world: World, case: Case) -> bool:
    servo = case.demands.device.servo
    return hand.stiffness == 0 == world.stiffness and not (servo and servo.stiffness)


def _sum(found: Spanned) -> Complex:
    total = found.fixed
    for of, low, _ in found.spans:
        total = total + of * low
    return total


def _met(demands: Demands) -> Worlds:
    """Return the environments of the claim; nothing before a rigid world."""
    nothing = World(0.0, 0.0, 0.0)
    return Worlds(nothing, nothing) if demands.worlds is None else demands.worlds.linear


def poles_outside(design: Design, demands: Demands, hand: Hand, world: World) -> tuple[float, int]:
    """Return the number of poles outside the curve in a hand with an environment, nan if it is open, and the number of
    boxes of the count."""
    demands = replace(demands, hands=Hands(hand, hand))
    curve = damped_wall if demands.rigid else partial(damped_servo, hand, world)
    there = of_design(design, demands)
    there = replace(there, fixed={**there.fixed, **hand.mapped(decimal).by_key})
    found = turns(there, curve, Covered.around_circle, np.pi)
    return float(found.number[0]), int(found.boxes[0])


def _prove(question: Question, _known: Outcomes) -> Outcome:
    """Prove that no pole is outside the curve: none is in the middle hand, and none crosses it."""
    design, demands, box = question.design, question.demands, question.box
    hands, worlds, uncertain = demands.hands, _met(demands), uncertain_in(box)
    assert hands is not None
    if not _filters_are_inside(design, demands):
        return Outcome(Verdict.UNDECIDED, 0)
    ends = [World(m, worlds.low.damping, k) for m, k in product(*_ends(worlds))]
    for device, hand, (theta, _) in question.ringing(design, demands, devices_of(question)):
        for world in ends:
            if poles_outside(replace(design, device=device), demands, hand, world)[0] > 0:
                return Outcome(Verdict.REFUTED, 0, theta / device.sample_time, device if uncertain else None, hand)
    middle = hands.middle
    number, boxes = poles_outside(design, demands, middle, worlds.low)
    if number != 0:
        verdict = Verdict.REFUTED if isfinite(number) else Verdict.UNDECIDED
        return Outcome(verdict, boxes, hand=middle)
    exact = hands.low.mapped(decimal), hands.high.mapped(decimal)

    def tests(part: DelayPart, fixed: Values) -> Tests:
        def of(margin: Callable[[Case, Number], Any]) -> Callable[[Number, Values], Any]:
            return over(margin, demands, uncertain, part.delays)

        if demands.rigid:
            return [(misses_zero(of(damped_wall), fixed), None)]
        boxed, fixed = (Hands(*exact), worlds.converted(decimal)), {**fixed, **exact[0].by_key}  # of rows it has none
        away = spans_miss_zero(of(partial(_away, *boxed)), fixed)
        return [(beside_zero(spans_miss_zero(of(partial(_spanned, without_position, *boxed)), fixed), away), None)]

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


def _ends(worlds: Worlds) -> tuple[list[float], list[float]]:
    """Return the ends of mass and stiffness of a box of environments."""
    low, high = worlds.low, worlds.high
    return list(dict.fromkeys((low.mass, high.mass))), list(dict.fromkeys((low.stiffness, high.stiffness)))


def _filters_are_inside(design: Design, demands: Demands) -> bool:
    """Return whether the poles of the firmware's filters, which are poles of the curve, are inside; those of servo and
    sensor have a ratio of at least 0.7."""
    assert demands.damping_ratio is not None
    device = design.device
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
)
