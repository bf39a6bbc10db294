"""Evaluate the sampled loop in a hand with every environment of a box (model/README.md, section 18), also behind walls
(section 19)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

from vctune.model.gains import Coupling, Rule, sampled_reactance, sampled_resistance
from vctune.model.hands import NAMES, Hand, Hands
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.complexes import Complex
from vctune.model.sampled.damped import AtRest, Span, Spanned
from vctune.model.worlds import Worlds

# Value that the code adds to a divisor that is a sum of magnitudes, because all the magnitudes may be 0; other divisors
# and roots that may be 0 get this share of a quantity of the same unit
ALMOST_ZERO, SPECK = 1e-300, 1e-30


class ZSeen(NamedTuple):
    """The impedance that the loop in a hand presents to the environment, Z_seen = -lost/size - j swing/(s size)."""

    lost: Number  # R = lost/size, N s/m; the size is |F|^2, or 1 for a servo
    swing: Number  # -s size Im Z_seen, which is half of Re(P conj F) without a coupling; it is > 0 for a spring
    size: Number
    blur: Number = 0  # radius of the disc around Z_seen of a servo whose response is not known, N s/m; 0 without one


class ZOffered(NamedTuple):
    """The impedance Z_c of the coupling as the firmware runs it."""

    resistance: Number  # Re Z_c, N s/m
    reactance: Number  # c Im Z_c, N s/m, with c = cos(theta/2)


class Disjuncts(NamedTuple):
    """Margins, each as the terms of its sum."""

    resistive: tuple[Number, ...]  # margin of the real part
    above: tuple[Number, ...] | None
    below: tuple[Number, ...] | None
    turned: tuple[Number, ...] | None
    corners: tuple[Number, ...] = ()  # margins of their own next to the corners of the box, with a disc around Z_seen


def offered_at(coupling: Coupling, sample_time: Number, rule: Rule, theta: Number, ops: Arithmetic) -> ZOffered:
    """Return Z_c at theta = omega T."""
    there = coupling, sample_time, rule, theta, ops
    return ZOffered(sampled_resistance(*there), sampled_reactance(*there))


def margin_names(worlds: Worlds, factor: float) -> tuple[str, ...]:
    """Return the names of the margins that can be positive in a box of environments."""
    turned = () if factor == 1 else ("turned",)
    above = () if _endless(worlds.high.mass) else ("above", *turned)
    return "resistive", *above, *(() if _endless(worlds.high.stiffness) else ("below",))


def real_at_nyquist(coupling: Coupling, rule: Rule, worlds: Worlds) -> bool:
    """Return whether coupling and an environment of the box have no reactance at theta = pi, whatever the stiffness: a
    mass by the trapezoidal rule is rigid there."""
    return (not coupling.rigid or rule == "euler") and bool(worlds.low.mass == 0)


def disjuncts(
    offered: ZOffered,
    worlds: Worlds,
    sample_time: Number,
    seen: ZSeen,
    factor: Number,
    theta: Number,
    ops: Arithmetic,
) -> Disjuncts:
    """Return margins, each times a positive number that contains |F|^2; at least one of them must be positive."""
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    inertia, compliance = sin * sin * (2 / sample_time), cos * cos * (sample_time / 2)
    low, high, x, w = worlds.low, worlds.high, offered.resistance, sin * offered.reactance
    lost, swing, size = seen.lost, seen.swing * cos, seen.size
    kept = () if ops.is_zero(low.damping) else (factor * low.damping * size,)
    resistive: tuple[Number, ...] = (x * size, -(factor * lost), *kept)
    above = below = turned = None
    if not _endless(high.mass):
        stiff, heavy = low.stiffness * compliance, high.mass * inertia
        above = (swing, stiff * size, -(w * size), -(heavy * size))
        turned = (x * swing, x * (stiff * size), -(x * (heavy * size)), -(w * lost), w * (low.damping * size))
    if not _endless(high.stiffness):
        light, soft = low.mass * inertia, high.stiffness * compliance
        below = (factor * (light * size), w * size, -(factor * (soft * size)), -(factor * swing))
    found = Disjuncts(resistive, above, below, turned)
    return found if isinstance(seen.blur, int) else _blurred(found, offered, seen, factor, sin, cos, ops)


def _blurred(
    found: Disjuncts, offered: ZOffered, seen: ZSeen, factor: Number, sin: Number, cos: Number, ops: Arithmetic
) -> Disjuncts:
    """Return the margins of a disc around Z_seen: each is the distance of y Z_c + Z_seen, for all y, from the box's
    impedances in one direction, less the radius. The directions from a corner of the box are margins of their own."""
    scale, w = sin * cos, sin * offered.reactance
    radius, corners, x = scale * seen.blur, list[Number](), offered.resistance
    first = scale * (sum_of(found.resistive) / factor)  # the real part for y = 1/factor, and for y = 1
    last = first + scale * (x - x / factor)
    above, below, turned = found.above, found.below, found.turned
    if above is not None and turned is not None:
        least = sum_of(above)
        one, other = (first, least + (w - w / factor)), (last, least)
        corners += [_from_corner(one, other, radius, ops), _from_corner(other, one, radius, ops)]
        above, turned = (*above, -radius), (*turned, -(seen.blur * ops.modulus(w, scale * x)))
    if below is not None:
        end = first, sum_of(below) / factor
        corners.append(_from_corner(end, end, radius, ops))
        below = (*below, -(factor * radius))
    return Disjuncts((*found.resistive, -(factor * seen.blur)), above, below, turned, tuple(corners))


def _from_corner(near: tuple[Number, Number], far: tuple[Number, Number], radius: Number, ops: Arithmetic) -> Number:
    """Return the distance of a line between two points from a corner at 0, in the direction of the near point, less a
    radius. The margin holds for any direction between those of the corner's sides; what is below 0 of the near point
    is left out of it."""
    p, q = (_positive(part, ops) for part in near)
    here, there = (p * along + q * across for along, across in (near, far))
    gap, mean = there - here, 0.5 * (here + there)
    # `where_positive` takes the first where it surely may, and the second elsewhere: both must be bounds
    least = ops.where_positive(gap, lambda: here, lambda: mean - 0.5 * ops.modulus(gap, 0 * gap))
    return least / (ops.modulus(p, q) + SPECK * radius) - radius


def limp_disjuncts(
    offered: ZOffered,
    worlds: Worlds,
    sample_time: Number,
    seen: ZSeen,
    factor: Number,
    theta: Number,
    ops: Arithmetic,
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


def spanned_impedance(
    offered: ZOffered,
    seen_of: Callable[[Hand], ZSeen],
    hands: Hands,
    worlds: Worlds,
    sample_time: Number,
    theta: Number,
    ops: Arithmetic,
) -> AtRest:
    """Return the whole impedance of a servo, with its imaginary part times sin(theta/2) cos(theta/2): regular numbers
    spanned by hand and environment, of which a damper behind the coupling is a ray."""
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    alone = seen_of(Hand(0, 0, 0))
    spans = []
    for name in NAMES:
        unit = seen_of(Hand(**{each: int(each == name) for each in NAMES}))
        share = Complex(alone.lost - unit.lost, cos * (alone.swing - unit.swing))
        spans.append(Span(share, getattr(hands.low, name), getattr(hands.high, name)))
    inertia, compliance = sin * sin * (2 / sample_time), cos * cos * (sample_time / 2)
    spans.append(Span(Complex(0 * theta, inertia), worlds.low.mass, worlds.high.mass))
    spans.append(Span(Complex(0 * theta, -compliance), worlds.low.stiffness, worlds.high.stiffness))
    real = offered.resistance - alone.lost + worlds.low.damping
    fixed = Complex(real, sin * offered.reactance - cos * alone.swing)
    return AtRest(Spanned(fixed, tuple(spans)), (Complex(1 + 0 * theta, 0 * theta),))


def room_of(terms: tuple[Number, ...], absolute: Callable[[Number], Number]) -> Number:
    """Return the relative distance of a margin from 0: twice the sum of its terms over the sum of their magnitudes."""
    return 2 * sum_of(terms) / (sum_of(tuple(map(absolute, terms))) + ALMOST_ZERO)


def sum_of(terms: tuple[Number, ...]) -> Number:
    """Return a margin as the sum of its terms."""
    first, *others = terms
    return sum(others, start=first)


def _endless(limit: Any) -> bool:
    return isinstance(limit, float) and limit == inf


LEADS = (0.0, 1.0)  # l of the trapezoidal rule and l of backward Euler


class Strip(NamedTuple):
    """The ranges of p and r over the masses and dampings of a box, for one share y. Ends are terms of sums."""

    low: tuple[Number, ...] | None  # c^2 |F|^2 p with the greatest and with the least mass
    high: tuple[Number, ...]
    excess: tuple[Number, ...]  # |F|^2 r with the least damping
    size: Number  # |F|^2


class Tangent(NamedTuple):
    """The points at which f and g have their tangents. Any numbers with the right signs give a lower bound."""

    rising: Number  # the positive part of tau, and the negative part of tau (tau if tau < 0, else 0)
    falling: Number
    excess: Number  # r_0, with w c^2 kappa + 2 h^2 s^2 r_0 >= 0


class Shares(NamedTuple):
    """The two terms of a lower bound of E times c^2 |F|^2."""

    flat: Number  # c^2 times the bound of f
    rest: Number  # the bound of g


def strip_in_walls(
    offered: ZOffered,
    worlds: Worlds,
    sample_time: Number,
    seen: ZSeen,
    share: Number,
    theta: Number,
    ops: Arithmetic,
) -> Strip:
    """Return the ranges of p and r over the box."""
    sin, cos, low, high = ops.sin(theta / 2), ops.cos(theta / 2), worlds.low, worlds.high
    h, size = 2 / sample_time, seen.size
    inertia = h * h * (sin * sin)
    rest = (low.stiffness * (cos * cos) * size, h * cos * seen.swing, -(h * share * (sin * offered.reactance) * size))
    kept = () if ops.is_zero(low.damping) else (low.damping * size,)
    endless = isinstance(high.mass, float) and high.mass == inf
    return Strip(
        low=None if endless else (*rest, -(high.mass * inertia * size)),
        high=(*rest, -(low.mass * inertia * size)),
        excess=(share * offered.resistance * size, -seen.lost, *kept),
        size=size,
    )


@dataclass(frozen=True, slots=True)
class _Condition:
    """The numbers in c^2 f and c^2 g at one angle, which are regular at theta = pi."""

    width: Number  # kappa
    inertia: Number  # h^2 s^2
    square: Number  # c^2
    flat: Number  # n
    corner: Number  # c^2 w
    kept: Number  # c^2 C
    speck: Number  # next to nothing, in the unit of the inertia


def _condition(worlds: Worlds, lead: Number, sample_time: Number, theta: Number, ops: Arithmetic) -> _Condition:
    assert worlds.corner is not None
    sin, cos, h = ops.sin(theta / 2), ops.cos(theta / 2), 2 / sample_time
    square, width, least = cos * cos, width_of(worlds), worlds.low.stiffness
    if ops.is_zero(lead):
        return _Condition(width, h * h * (sin * sin), square, 1.0, worlds.corner * square, 0.0, SPECK * h * h)
    share = worlds.corner * (sample_time * 0.5) * lead
    return _Condition(
        width=width,
        inertia=h * h * (sin * sin),
        square=square,
        flat=1 - share,
        corner=worlds.corner * square + lead * h * (sin * sin) * (1 + 2 * (least / width)),
        kept=least * (share * square + lead * (sin * sin) * (1 + least / width)),
        speck=SPECK * h * h,
    )


def disjuncts_in_walls(
    strip: Strip, worlds: Worlds, lead: Number, sample_time: Number, theta: Number, ops: Arithmetic
) -> Disjuncts:
    """Return margins as the terms of their sums. E is positive if and only if one of the margins is positive."""
    at = _condition(worlds, lead, sample_time, theta, ops)
    u2, corner, half = at.inertia / at.square, at.corner / at.square * at.width / 2, at.flat * at.width / 2
    scale, excess = at.square * strip.size, sum_of(strip.excess) / strip.size
    off = _positive(-sum_of(strip.high) / scale - half, ops)
    if strip.low is not None:
        off = off + _positive(sum_of(strip.low) / scale + half, ops)
    worst = half * half - at.width * (at.kept / at.square)
    missing = worst - off * off
    least = missing / (corner + _root(corner * corner + u2 * missing, corner * corner, ops))
    rest = ops.where_positive(
        u2 * excess + corner,
        lambda: excess * (2 * corner + u2 * excess),
        lambda: -(corner * corner / (u2 + at.speck)),
    )
    needed = _root(worst - rest, at.width * at.width, ops)
    return Disjuncts(
        resistive=(*strip.excess, -(least * strip.size)),
        above=None if strip.low is None else (*strip.low, (half - needed) * scale),
        below=(*(-term for term in strip.high), -((half + needed) * scale)),
        turned=None,
    )


def shares_of(
    strip: Strip,
    tangent: Tangent,
    worlds: Worlds,
    lead: Number,
    sample_time: Number,
    theta: Number,
    ops: Arithmetic,
) -> Shares:
    """Return a lower bound of E from tangents of f and g."""
    at = _condition(worlds, lead, sample_time, theta, ops)
    off = tangent.rising + tangent.falling - at.flat * at.square
    flat = tangent.falling * sum_of(strip.high) - strip.size * (at.width * 0.25) * (off * off)
    if strip.low is not None:
        flat = flat + tangent.rising * sum_of(strip.low)
    slope = at.corner + at.inertia * (2 / at.width) * tangent.excess
    rest = slope * sum_of(strip.excess) - at.inertia * (tangent.excess * tangent.excess / at.width) * strip.size
    return Shares(flat + at.square * at.kept * strip.size, rest)


def flattest(
    strip: Strip, rest: Number, worlds: Worlds, lead: Number, sample_time: Number, theta: Number, ops: Arithmetic
) -> Number:
    """Return the lower bound of E times c^2 |F|^2 with f at its minimum. The bound is regular at theta = pi."""
    at = _condition(worlds, lead, sample_time, theta, ops)
    return rest + strip.size * (at.kept - at.width * 0.25 * (at.flat * at.flat) * at.square)


def tangent_at(
    strip: Strip, worlds: Worlds, lead: Number, sample_time: Number, theta: Number, ops: Arithmetic
) -> Tangent:
    """Return the tangents at the minima of f and g over the box, for which the lower bound is E itself."""
    at = _condition(worlds, lead, sample_time, theta, ops)
    level, least = at.flat * at.square, at.corner * at.width
    falling = -_positive(-(level + 2 / at.width * (sum_of(strip.high) / strip.size)), ops)
    rising = 0 * falling
    if strip.low is not None:
        rising = _positive(level + 2 / at.width * (sum_of(strip.low) / strip.size), ops)
    excess = sum_of(strip.excess) / strip.size
    bounded = ops.where_positive(
        2 * at.inertia * excess + least, lambda: excess, lambda: -(least / (2 * at.inertia + at.speck))
    )
    return Tangent(rising, falling, bounded)


def tangent_of_one(
    strip: Strip, worlds: Worlds, lead: Number, sample_time: Number, theta: Number, ops: Arithmetic
) -> Tangent:
    """Return the tangents for a single mass and damping, for which the lower bound is E itself."""
    at = _condition(worlds, lead, sample_time, theta, ops)
    slope = at.flat * at.square + 2 / at.width * (sum_of(strip.high) / strip.size)
    return Tangent(0 * slope, slope, sum_of(strip.excess) / strip.size)


def tangent_at_rest(worlds: Worlds, lead: Number, sample_time: Number, theta: Number, ops: Arithmetic) -> Tangent:
    """Return the tangents at p = r = 0."""
    at = _condition(worlds, lead, sample_time, theta, ops)
    return Tangent(at.flat * at.square, 0, 0)


def width_of(worlds: Worlds) -> Any:
    """Return kappa = k_2 - k_1, N/m."""
    return worlds.high.stiffness - worlds.low.stiffness


def _positive(x: Number, ops: Arithmetic) -> Number:
    return ops.where_positive(x, lambda: x, lambda: 0 * x)


def _root(x: Number, unit: Number, ops: Arithmetic) -> Number:
    """Return the square root of a number; about 0, relative to a number of its unit, if the number is negative."""
    return ops.sqrt(_positive(x, ops) + SPECK * unit)
