"""Evaluate the sampled loop in a hand with every environment of a box (model/README.md, section 18)."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple

from vctune.model.gains import Coupling, sampled_reactance, sampled_resistance
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.worlds import Worlds

# Value that the code adds to a divisor that is a sum of magnitudes, because all the magnitudes may be 0
NOTHING = 1e-30


class Seen(NamedTuple):
    """The impedance that the loop in a hand presents to the environment, Z_seen = -lost/size - j swing/(s size)."""

    lost: Number  # R = lost/size, N s/m; the size is |F|^2, or 1 for a servo
    swing: Number  # -s size Im Z_seen, which is half of Re(P conj F) without a coupling; it is > 0 for a spring
    size: Number


class Offered(NamedTuple):
    """The impedance Z_c of the coupling as the firmware runs it."""

    resistance: Number  # Re Z_c, N s/m
    reactance: Number  # c Im Z_c, N s/m, with c = cos(theta/2)


class Disjuncts(NamedTuple):
    """Margins, each as the terms of its sum."""

    resistive: tuple[Number, ...]  # margin of the real part
    above: tuple[Number, ...] | None
    below: tuple[Number, ...] | None
    turned: tuple[Number, ...] | None


def offered_at(coupling: Coupling, sample_time: Number, theta: Number, ops: Arithmetic) -> Offered:
    """Return Z_c at theta = omega T."""
    return Offered(
        sampled_resistance(coupling, sample_time, theta, ops), sampled_reactance(coupling, sample_time, theta, ops)
    )


def posed(worlds: Worlds, factor: float) -> tuple[str, ...]:
    """Return the names of the margins that can be positive in a box of environments."""
    turned = () if factor == 1 else ("turned",)
    above = () if _endless(worlds.high.mass) else ("above", *turned)
    return "resistive", *above, *(() if _endless(worlds.high.stiffness) else ("below",))


def disjuncts(
    offered: Offered, worlds: Worlds, sample_time: Number, seen: Seen, factor: Number, theta: Number, ops: Arithmetic
) -> Disjuncts:
    """Return margins, each times a positive number that contains |F|^2; at least one of them must be positive."""
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    inertia, compliance = sin * sin * (2 / sample_time), cos * cos * (sample_time / 2)
    low, high, x, w = worlds.low, worlds.high, offered.resistance, sin * offered.reactance
    lost, swing, size = seen.lost, seen.swing * cos, seen.size
    kept = () if ops.is_zero(low.damping) else (factor * low.damping * size,)
    above = below = turned = None
    if not _endless(high.mass):
        stiff, heavy = low.stiffness * compliance, high.mass * inertia
        above = (swing, stiff * size, -(w * size), -(heavy * size))
        turned = (x * swing, x * (stiff * size), -(x * (heavy * size)), -(w * lost), w * (low.damping * size))
    if not _endless(high.stiffness):
        light, soft = low.mass * inertia, high.stiffness * compliance
        below = (factor * (light * size), w * size, -(factor * (soft * size)), -(factor * swing))
    return Disjuncts((x * size, -(factor * lost), *kept), above, below, turned)


def limp_disjuncts(
    offered: Offered, worlds: Worlds, sample_time: Number, seen: Seen, factor: Number, theta: Number, ops: Arithmetic
) -> Disjuncts:
    """Return `disjuncts` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness."""
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    low, high, size = worlds.low, worlds.high, seen.size
    kept = () if ops.is_zero(low.damping) else (factor * low.damping * size,)
    above = None
    if not _endless(high.mass):
        above = (seen.swing * cos, -(offered.reactance * size), -(high.mass * (sin * (2 / sample_time)) * size))
        if not ops.is_zero(low.stiffness):
            above = (*(sin * term for term in above), low.stiffness * (cos * cos * (sample_time / 2)) * size)
    return Disjuncts((offered.resistance * size, -(factor * seen.lost), *kept), above, None, None)


def room_of(terms: tuple[Number, ...], absolute: Callable[[Number], Number]) -> Number:
    """Return the relative distance of a margin from 0: twice the sum of its terms over the sum of their magnitudes."""
    return 2 * sum_of(terms) / (sum_of(tuple(map(absolute, terms))) + NOTHING)


def sum_of(terms: tuple[Number, ...]) -> Number:
    """Return a margin as the sum of its terms."""
    first, *others = terms
    return sum(others, start=first)


def _endless(limit: Any) -> bool:
    return isinstance(limit, float) and limit == inf
