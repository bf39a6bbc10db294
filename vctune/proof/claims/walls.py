"""Prove the condition of walls over boxes, with separate tangents for each box (model/README.md, section 19)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vctune.model.design import Design
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.problem import Demands
from vctune.model.sampled.loop_in_worlds import (
    LEADS,
    Strip,
    Tangent,
    flattest,
    shares_of,
    sum_of,
    tangent_at,
    tangent_at_rest,
    tangent_of_one,
    width_of,
)
from vctune.model.worlds import Worlds
from vctune.proof.claims.cases import Case, exact_case
from vctune.proof.claims.margins_of_claims import limp_strip_of_walls, strip_of_walls
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Floats, decimal, surely_negative
from vctune.proof.enclosures.taylor import Taylor

INWARDS = 1 - 1e-9  # Factor that keeps rounding from making the slope of a tangent negative


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


def fails_with_a_wall(design: Design, demands: Demands, hand: Hand, theta: float, share: float) -> bool:
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
