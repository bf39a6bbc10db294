"""Prove that a loop is stable in every hand with every environment of a box, or that it is not in some hand with some
environment: a refutation that no sample of them meets (model/README.md, sections 15 and 18)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import nextafter, pi
from typing import Any

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import Number
from vctune.model.sampled.damped import AtRest
from vctune.model.sampled.hand_loop import loop_in_hand, seen_in_hand, seen_in_limp_hand
from vctune.model.sampled.loop_in_worlds import (
    Disjuncts,
    ZOffered,
    ZSeen,
    disjuncts,
    limp_disjuncts,
    margin_names,
    offered_at,
    real_at_nyquist,
    spanned_impedance,
    sum_of,
)
from vctune.model.sampled.plant_in_hand import ServoInHand
from vctune.model.worlds import PlacesInWorlds, Worlds, WorldsMet
from vctune.proof.box_tests import beside_zero, positive, spans_miss_zero, sufficient
from vctune.proof.boxes import Cells, Values, over_cells, over_hands, with_row
from vctune.proof.claims.cases import COUPLING_SHARE, Case, exact_case, over
from vctune.proof.claims.claim import Claim, Outcomes, Question, Suspect
from vctune.proof.claims.covered import Covered, Place, most
from vctune.proof.claims.damping import OF_CELL, exactly_met, poles_beyond
from vctune.proof.claims.delays import DelayPart
from vctune.proof.claims.hands import band, few, prove_cells
from vctune.proof.claims.in_hands import (
    AT_REST,
    ON_AXES,
    RHO_SHARES,
    Asked,
    Tests,
    devices_of,
    ends_of,
    limp,
    next_to_rest,
    no_pole_crosses,
    tested_with,
)
from vctune.proof.claims.poles import hand_turns
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, between, negative, surely_negative
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import check_time

NEXT_TO_REST = "resistive", "above"  # names of the margins that can be positive next to rest
NARROW, HALVINGS = 1e-10, 10  # relative width of a crossing; halvings of it in which the resistance is seen negative


def margins_in_worlds(case: Case, theta: Number) -> Disjuncts:
    """Return the margins in a hand with a box of environments, each as the terms of its sum. At least one margin must
    be positive (model/README.md, section 18)."""
    met, (offered, seen) = met_of(case), met_by_environment(case, theta)
    return disjuncts(offered, met.worlds, case.design.device.sample_time, seen, met.factor, theta, case.ops)


def limp_margins_in_worlds(case: Case, theta: Number) -> Disjuncts:
    """Return `margins_in_worlds` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    met, T = met_of(case), case.design.device.sample_time
    seen, offered = seen_at_rest(case, theta), offered_to(case, theta)
    return limp_disjuncts(offered, met.worlds, T, seen, met.factor, theta, case.ops)


def met_of(case: Case) -> WorldsMet:
    assert case.met is not None
    return case.met


def met_by_environment(case: Case, theta: Number) -> tuple[ZOffered, ZSeen]:
    """Return the impedances that an environment meets: of the coupling and of the loop."""
    seen = seen_in_hand(loop_in_hand(case.held(), theta, case.ops), case.design.gains)
    return offered_to(case, theta), seen


def offered_to(case: Case, theta: Number) -> ZOffered:
    device = case.design.device
    return offered_at(case.design.series, device.sample_time, device.rule, theta, case.ops)


def seen_at_rest(case: Case, theta: Number) -> ZSeen:
    plant, rest = next_to_rest(case, theta)
    return seen_in_limp_hand(plant, case.design.gains.velocity, theta, rest, case.ops)


def _sums_of(
    margins: Callable[[Case, Number], Disjuncts], names: Sequence[str], case: Case, theta: Number
) -> tuple[Number, ...]:
    found = margins(case, theta)
    return (*(sum_of(getattr(found, name)) for name in names), *found.corners)


def sums(found: Disjuncts) -> tuple[Number, Number, Number]:
    """Return the sums of the resistive margin, and of those above and below; one that cannot be positive is -1."""
    above, below = (-1.0 if terms is None else sum_of(terms) for terms in (found.above, found.below))
    return sum_of(found.resistive), above, below


def crossing(design: Design, demands: Demands, suspect: Suspect) -> float | None:
    """Return an angle next to which a pole is proved on the circle; None if it cannot be proved."""
    assert demands.worlds is not None
    there = exact_case(replace(design, device=suspect.device.undisturbed), replace(demands, factor=1.0), suspect.hand)
    low, high = suspect.angles

    def at(first: Any, last: Any) -> tuple[Number, Number, Number]:
        check_time()
        return sums(margins_in_worlds(there, between(first, last)))

    def is_above(theta: float) -> bool:
        return surely_negative(at(theta, theta)[1])

    def is_below(theta: float) -> bool:
        return surely_negative(at(theta, theta)[2])

    ends = high == pi and real_at_nyquist(design.series, design.device.rule, demands.worlds)
    if ends and surely_negative(sum_of(margins_in_worlds(there, ENCLOSURES.pi).resistive)):
        return pi
    rising = is_above(low) and is_below(high)
    if not rising and not (is_below(low) and is_above(high)):
        return None
    while high - low > NARROW * high:
        middle = 0.5 * (low + high)
        if is_above(middle) and is_below(middle):  # an environment within the box
            low = high = middle
        elif is_above(middle) if rising else is_below(middle):
            low = middle
        elif is_below(middle) if rising else is_above(middle):
            high = middle
        else:
            break
    first, last = np.array([low]), np.array([high])
    for _ in range(HALVINGS):
        left = ~np.broadcast_to(negative(at(first, last)[0]), first.shape)
        if not left.any():
            return 0.5 * (low + high)
        first, last = first[left], last[left]
        middle = 0.5 * (first + last)
        first, last = np.append(first, middle), np.append(middle, last)
    return None


def _prove(question: Question, _known: Outcomes) -> Outcome:
    """Prove that the loop is stable in every hand with every linear environment of a box."""
    design, box, worlds = question.design, question.box, question.demands.worlds
    assert worlds is not None
    demands = replace(question.demands, worlds=worlds.linear)
    question, devices = replace(question, demands=demands), devices_of(question)
    names = margin_names(worlds, demands.factor)
    limp_names = [name for name in names if name in NEXT_TO_REST]
    margin = partial(_sums_of, margins_in_worlds, names)
    at_rest = partial(_sums_of, limp_margins_in_worlds, limp_names) if limp_names else None

    def fails(design: Design, hand: Hand | None, theta: float, share: float) -> bool:
        there, at = exact_case(design, demands, hand, share), Enclosure(theta)
        # a pole may pass z = -1
        if theta == pi and real_at_nyquist(design.series, design.device.rule, worlds):
            return surely_negative(sum_of(margins_in_worlds(there, ENCLOSURES.pi).resistive))
        return all(map(surely_negative, margin(there, at)))

    for device, hand, (low, high) in question.suspects(design, demands, devices):
        theta = crossing(design, demands, Suspect(device, hand, (low, high))) if low < high else None
        if low == high and fails(replace(design, device=device), hand, low, 1.0):
            theta = low
        if theta is not None:
            off = device if len(devices) > 1 else None
            return Outcome(Verdict.REFUTED, 0, theta / device.sample_time, off, hand)

    def tests(part: DelayPart, fixed: Values) -> Tests:
        return [(tested_with(question, part, fixed, margin, at_rest), None)]

    ends = ends_of(demands.hands, box, at_rest=limp(demands, integral=design.gains.position > 0))
    return no_pole_crosses(Asked(question, tests, fails), ends)


def whole_impedance(hands: Hands, worlds: Worlds, case: Case, theta: Number) -> AtRest:
    """Return the whole impedance of a servo with all hands and environments of two boxes."""
    plant = case.held()
    assert isinstance(plant, ServoInHand)
    device, ops = case.design.device, case.ops

    def seen_of(hand: Hand) -> ZSeen:
        return seen_in_hand(loop_in_hand(replace(plant, hand=hand), theta, ops), case.design.gains)

    offered = offered_at(case.design.series.times(case.share), device.sample_time, device.rule, theta, ops)
    return spanned_impedance(offered, seen_of, hands, worlds, device.sample_time, theta, ops)


def _hold_for_servo(cells: Covered) -> Flags:
    """Return the cells of which each design is stable: the whole impedance of a servo is linear in hand and
    environment."""
    demands, exact = cells.demands, exactly_met(cells.demands)
    test = spans_miss_zero(over(partial(whole_impedance, *exact), demands), exact[0].low.by_key)
    proved = hand_turns(cells.centres()).number == 0
    left = np.flatnonzero(proved)
    boxes = over_cells(Cells(cells.low[:, left], cells.high[:, left]), band())
    boxes = with_row(boxes, COUPLING_SHARE, nextafter(1 / demands.factor, 0.0) if demands.factor > 1 else 1.0, 1.0)
    proved[left] = prove_cells(test, boxes, len(left), OF_CELL)
    return proved


def _hold(cells: Covered) -> Flags:
    """Return the cells of which each design is stable in every hand with every environment."""
    worlds, hands = cells.demands.worlds, cells.demands.hands
    assert worlds is not None and hands is not None
    servo = cells.demands.device.servo
    if servo is not None and not servo.radii:
        return _hold_for_servo(cells)
    demands = replace(cells.demands, worlds=worlds.linear)
    names = margin_names(worlds, demands.factor)
    test, at_rest = positive(over(partial(_sums_of, margins_in_worlds, names), demands), {}), False
    if limp(demands, integral=cells.integral):
        limp_names, at_rest = [name for name in names if name in NEXT_TO_REST], True
        near = sufficient(over(partial(_sums_of, limp_margins_in_worlds, limp_names), demands), {})
        test = beside_zero(near, test, AT_REST)
    proved = np.zeros(cells.owners, bool)
    for some in few(np.flatnonzero(hand_turns(cells.centres()).number == 0)):
        boxes = over_hands(Cells(cells.low[:, some], cells.high[:, some]), hands, band())
        if at_rest:
            boxes = with_row(boxes, RHO_SHARES[0], 0.0, 0.0)
            boxes = with_row(boxes, RHO_SHARES[1], 0.0, float(hands.high.stiffness > 0))
        proved[some] = prove_cells(test, boxes, len(some), whole_hands=demands.device.servo is not None)
    return proved


def _lost(cells: Covered, places: Place) -> Flags:
    """Return the cells throughout which the loop is unstable, each at its place: a servo by its poles, another display
    because its loop meets an environment of the box there."""
    if not isinstance(places, PlacesInWorlds):
        return np.zeros(cells.owners, bool)
    worlds = cells.demands.worlds
    assert worlds is not None
    cells = replace(cells, demands=replace(cells.demands, worlds=worlds.linear, damping_ratio=0.0))
    lost, names = np.zeros(cells.owners, bool), margin_names(worlds, cells.demands.factor)

    def one(k: int, case: Case, theta: Number) -> Number:
        return _sums_of(margins_in_worlds, names, case, theta)[k]

    hands = cells.demands.hands
    assert hands is not None
    inside = places.in_hands.hands.mapped(np.clip, hands.low, hands.high)  # an estimate may be next to the box
    for place in replace(places, in_hands=replace(places.in_hands, hands=inside)).each:
        left = np.flatnonzero(~lost & np.isfinite(place.in_hands.at))
        if not left.size:
            continue
        some, at = cells.subset(left), place[left]
        if cells.demands.device.servo is not None:
            share = min(nextafter(1 / cells.demands.factor, 1.0), 1.0)
            lost[left] = np.nan_to_num(poles_beyond(some, at, share), nan=0.0) > 0
        else:
            lost[left] = np.all([most(some, partial(one, k), at.in_hands) < 0 for k in range(len(names))], axis=0)
    return lost


WORLDS = Claim(
    id="worlds",
    sentence="stable in every hand with every environment of the box, also with Z_c / safety_factor",
    quantity="in_hand",
    margin=margins_in_worlds,
    witness="a frequency up to Nyquist and a hand of `[operator]`",
    label="every hand with every environment of the box",
    explain=(
        "The device is stable in each hand of `[operator]` with each environment of `[environment]`. Such an "
        "environment is a mass, a damper and a spring, each within its range, stepped by the trapezoidal "
        "rule. The device remains stable if the coupling is divided by any number from 1 to the "
        "safety factor. The claim is about the exact sampled loop, including aliasing. It does not cover "
        "other hands and environments." + ON_AXES
    ),
    when='for an admittance display or a servo with the criterion "hands" or "both", with `[environment]`',
    asked=lambda demands, _: demands.hands is not None and demands.worlds is not None,
    prove=_prove,
    cells=_hold,
    lost=_lost,
)
