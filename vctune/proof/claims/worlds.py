"""Prove that a loop is stable in every hand with every environment of a box, or that it is not in some hand with some
environment: a refutation that no sample of them meets (model/README.md, sections 15 and 18)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import pi
from typing import Any

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Number
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
    sum_of,
)
from vctune.model.worlds import WorldsMet
from vctune.proof.boxes import Values
from vctune.proof.claims.cases import Case, exact_case
from vctune.proof.claims.claim import Claim, Outcomes, Question, Suspect
from vctune.proof.claims.delays import DelayPart
from vctune.proof.claims.in_hands import (
    ON_AXES,
    Asked,
    Tests,
    devices_of,
    ends_of,
    limp,
    next_to_rest,
    no_pole_crosses,
    tested_with,
)
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, between, negative, surely_negative
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import check_time

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
    limp_names = [name for name in names if name in ("resistive", "above")]
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

    ends = ends_of(demands.hands, box, at_rest=limp(design, demands))
    return no_pole_crosses(Asked(question, tests, fails), ends)


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
)
