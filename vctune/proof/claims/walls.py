"""Prove the condition of walls over boxes, with separate tangents for each box (model/README.md, section 19)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import inf, pi
from typing import Any

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.sampled.loop_in_worlds import (
    LEADS,
    Strip,
    Tangent,
    ZSeen,
    flattest,
    shares_of,
    strip_in_walls,
    sum_of,
    tangent_at,
    tangent_at_rest,
    tangent_of_one,
    width_of,
)
from vctune.model.worlds import Worlds
from vctune.proof.boxes import Values
from vctune.proof.claims.cases import Case, exact_case
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.delays import DelayPart
from vctune.proof.claims.in_hands import Asked, Tests, ends_of, limp, no_pole_crosses, tested_with
from vctune.proof.claims.worlds import WORLDS, met_by_environment, met_of, offered_to, seen_at_rest
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Floats, decimal, surely_negative
from vctune.proof.enclosures.taylor import Taylor
from vctune.proof.outcome import Outcome, Verdict

# Greatest product of the multiplier's corner, rad/s, and T; above 2 the multiplier's coefficient a is negative
HIGHEST_CORNER = 2 * (1 - 1e-9)
INWARDS = 1 - 1e-9  # Factor that keeps rounding from making the slope of a tangent negative


def strip_of_walls(case: Case, theta: Number) -> Strip:
    """Return the ranges over which the condition of walls must hold in a hand, for one share of the coupling."""
    offered, seen = met_by_environment(case, theta)
    return strip_in_walls(
        offered, met_of(case).worlds, case.design.device.sample_time, seen, case.share, theta, case.ops
    )


def limp_strip_of_walls(case: Case, theta: Number) -> Strip:
    """Return `strip_of_walls` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    seen, T, ops = seen_at_rest(case, theta), case.design.device.sample_time, case.ops
    whole = ZSeen(seen.lost, ops.sin(theta / 2) * seen.swing, seen.size)
    offered = offered_to(case, theta)
    return strip_in_walls(offered, met_of(case).worlds, T, whole, case.share, theta, ops)


def walls_margins(case: Case, theta: Number, lead: float) -> tuple[Number, ...]:
    """Return margins over boxes. One of them must be positive at each point."""
    strip, sample_time, ops = strip_of_walls(case, theta), case.design.device.sample_time, case.ops
    assert case.met is not None and case.demands.worlds is not None and ops.arrays is not None
    met, plain, T, here = case.met, case.demands.worlds, _middle(sample_time), _middle(theta)
    low = None if strip.low is None else tuple(map(_middle, strip.low))
    in_middle = Strip(low, tuple(map(_middle, strip.high)), tuple(map(_middle, strip.excess)), _middle(strip.size))
    with np.errstate(all="ignore"):
        best = Tangent(*(np.nan_to_num(each) for each in tangent_at(in_middle, plain, lead, T, here, FLOATS)))
    sin, cos = (_ends(each) for each in (ops.sin(theta / 2), ops.cos(theta / 2)))
    assert plain.corner is not None
    least = -plain.corner * width_of(plain) * np.maximum(cos[0], 0.0) ** 2 * T**2 / (8 * sin[1] ** 2) * INWARDS
    chosen = Tangent(*map(Enclosure, (best.rising, best.falling, np.maximum(best.excess, least))))
    found = shares_of(strip, chosen, met.worlds, lead, sample_time, theta, ops)
    square = ops.cos(theta / 2) * ops.cos(theta / 2)
    return flattest(strip, found.rest, met.worlds, lead, sample_time, theta, ops), found.flat + square * found.rest


def limp_walls_margin(case: Case, theta: Number, lead: float) -> Number:
    """Return a margin for K_p = 0, theta near 0 and a hand without stiffness, with the tangents at p = r = 0."""
    strip, sample_time, ops = limp_strip_of_walls(case, theta), case.design.device.sample_time, case.ops
    assert case.met is not None
    tangent = tangent_at_rest(case.met.worlds, lead, sample_time, theta, ops)
    found = shares_of(strip, tangent, case.met.worlds, lead, sample_time, theta, ops)
    return found.flat + ops.cos(theta / 2) * ops.cos(theta / 2) * found.rest


def _fails_with_a_wall(design: Design, demands: Demands, hand: Hand, theta: float, share: float) -> bool:
    """Return whether E is negative at the mass and damping of the box where E is about least."""
    plain, at = demands.worlds, Enclosure(theta)
    assert plain is not None

    def of(worlds: Worlds) -> tuple[Worlds, Strip]:
        there = exact_case(design, replace(demands, worlds=worlds), hand, share)
        assert there.met is not None
        return there.met.worlds, strip_of_walls(there, at)

    def fails(lead: float) -> bool:
        one = _worst_member(plain, lead, of(plain)[1], design.device.sample_time, theta)
        worlds, strip = of(one)
        T = decimal(design.device.sample_time)
        tangent = tangent_of_one(strip, worlds, lead, T, at, ENCLOSURES)
        found = shares_of(strip, tangent, worlds, lead, T, at, ENCLOSURES)
        return surely_negative(found.flat + ENCLOSURES.cos(at / 2) * ENCLOSURES.cos(at / 2) * found.rest)

    return any(map(fails, LEADS))


def _worst_member(worlds: Worlds, lead: float, strip: Strip, sample_time: float, theta: float) -> Worlds:
    """Return the box reduced to the mass and the damping at which E is approximately least."""
    assert worlds.corner is not None
    low, high, h, width = worlds.low, worlds.high, 2 / sample_time, width_of(worlds)
    t2 = float(np.tan(theta / 2)) ** 2
    p, r = (float(_middle(x) / _middle(strip.size)) for x in (sum_of(strip.high), sum_of(strip.excess)))
    p *= 1 + t2
    least = -width / 2 * (1 - lead * worlds.corner / h)
    slope = worlds.corner + lead * h * t2 * (1 + 2 * low.stiffness / width)
    mass = float(np.clip(low.mass + (p - least) / (h * h * t2), low.mass, high.mass))
    damping = low.damping + max(-slope * width / (2 * h * h * t2) - r, 0.0)
    return replace(worlds, low=replace(low, mass=mass, damping=damping), high=replace(high, mass=mass, damping=damping))


def _middle(x: Number) -> Any:
    """Return the approximate middle of each box."""
    if isinstance(x, Taylor):
        return x.coefficients[0]
    return x.mid if isinstance(x, Enclosure) else x


def _ends(x: Number) -> tuple[Floats, Floats]:
    """Return the approximate least and greatest value over each box."""
    over = x.enclosed() if isinstance(x, Taylor) else x
    return np.asarray(over.mid - over.rad), np.asarray(over.mid + over.rad)


def _prove(question: Question, known: Outcomes) -> Outcome:
    """Prove the condition of walls. It implies stability of a loop that is stable with the linear environments."""
    design, demands, worlds = question.design, question.demands, question.demands.worlds
    assert worlds is not None
    usable = worlds.corner is not None and worlds.corner * design.device.sample_time < HIGHEST_CORNER
    if not usable or known[WORLDS.id].verdict is not Verdict.PROVED:
        return Outcome(Verdict.UNDECIDED, 0)

    def tests(part: DelayPart, fixed: Values) -> Tests:
        found = Tests()
        for lead in LEADS:
            at_rest = partial(limp_walls_margin, lead=lead) if worlds.high.mass < inf else None
            found.append((tested_with(question, part, fixed, partial(walls_margins, lead=lead), at_rest), None))
        return found

    def fails(design: Design, hand: Hand | None, theta: float, share: float) -> bool:
        return hand is not None and 0 < theta < pi and _fails_with_a_wall(design, demands, hand, theta, share)

    # each share of the coupling has margins of its own
    reserve = demands.factor if demands.factor > 1 else None
    ends = ends_of(
        demands.hands, question.box, at_rest=limp(demands, integral=design.gains.position > 0), reserve=reserve
    )
    return no_pole_crosses(Asked(question, tests, fails), ends)


WALLS = Claim(
    id="walls",
    sentence=(
        "stable in every hand with every fixed wall, one-sided or piecewise linear, of slopes k_1 to k_2: "
        "Re M (1/P + 1/(k_2 - k_1)) > 0 up to Nyquist; not with walls that move or one-sided dampers"
    ),
    quantity="in_hand",
    margin=walls_margins,
    witness="a frequency up to Nyquist and a hand of `[operator]`",
    label="every hand with every wall of the box",
    explain=(
        "The device is stable in each hand of `[operator]` with each wall, to which a mass and a damper of "
        "`[environment]` are added. The force of a wall depends only on the position, and its slope is "
        "everywhere within the range `environment.stiffness`. A wall is one-sided or piecewise linear, at any "
        "position. It steps by the trapezoidal rule or by backward Euler. The claim does not cover walls that "
        "move or one-sided dampers. The proof uses the multiplier of Zames and Falb. If its condition fails, "
        "the device can still be stable with every wall."
    ),
    when="as `worlds`, with `environment.walls = true`",
    asked=lambda demands, _: demands.hands is not None and demands.worlds is not None and demands.worlds.walls,
    prove=_prove,
)
