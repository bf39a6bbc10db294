"""The sampled loop in a hand with every wall of a box of environments (model/README.md, section 19).

A wall is a force phi(x_e), phi fixed and monotone with slopes from k_1 to k_2, beside a mass and a damping of the box.
With Y = y Z_c + Z_seen, s_d = j u, u = h s/c, h = 2/T, s = sin(theta/2), c = cos(theta/2) and kappa = k_2 - k_1,

    p = k_1 - m u^2 - u Im Y,   r = Re Y + b,   E = p + w_c r + (p^2 + u^2 r^2)/kappa

must be positive for all masses and dampings of the box: the multiplier (1 - z^-1)/(1 - a z^-1) of Zames and Falb, whose
corner is w_c = h (1 - a)/(1 + a). E is f(p) + g(r), both convex. So it is at least the sum of two tangents

    f >= tau/c^2 p - kappa/4 (tau/c^2 - 1)^2,   g >= (w_c + 2 u^2 r_0/kappa) r - u^2 r_0^2/kappa,

which are least at the greatest mass if tau > 0, at the least mass if tau < 0, and at the least damping if the slope in
r is not negative. Tangents at the least values of f and g give E itself, any others a lower bound.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.sampled.loop_in_worlds import NOTHING, Disjuncts, Offered, Seen, sum_of
from vctune.model.worlds import Worlds


class Strip(NamedTuple):
    """Where p and r are with the masses and dampings of a box, each as the terms that it is the sum of.

    Attributes
    ----------
    low, high : c^2 |F|^2 p with the greatest and with the least mass; low is None without a greatest mass
    excess : |F|^2 r with the least damping
    size : |F|^2
    """

    low: tuple[Number, ...] | None
    high: tuple[Number, ...]
    excess: tuple[Number, ...]
    size: Number


class Tangent(NamedTuple):
    """Where f and g are bounded from; any numbers, subject to their signs, give a lower bound.

    Attributes
    ----------
    rising, falling : tau if it is positive and if it is negative, else 0
    excess : r_0, with w_c c^2 kappa + 2 h^2 s^2 r_0 >= 0
    """

    rising: Number
    falling: Number
    excess: Number


class Shares(NamedTuple):
    """A lower bound of E times c^2 |F|^2 as f + g.

    Attributes
    ----------
    flat : c^2 times that of f
    rest : that of g
    """

    flat: Number
    rest: Number


def strip_in_walls(
    offered: Offered, worlds: Worlds, sample_time: Number, seen: Seen, share: Number, theta: Number, ops: Arithmetic
) -> Strip:
    """Return where p and r are.

    Parameters
    ----------
    offered : by the coupling
    worlds : the box, in numbers of the arithmetic; a limit that is infinite is a plain float
    sample_time : T, s
    seen : of the loop in a hand
    share : y of the coupling, from 1/safety_factor to 1
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
    """
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


def disjuncts_in_walls(strip: Strip, worlds: Worlds, sample_time: Number, theta: Number, ops: Arithmetic) -> Disjuncts:
    """Return margins as the terms that they are sums of: E is positive if and only if one of them is.

    r suffices with p as it is; or p is above, or below, all that r as it is forbids.

    Parameters
    ----------
    strip : of masses and dampings
    worlds : the box, with the corner
    sample_time : T, s
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these, in which numbers have a sign
    """
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    h, square, width, corner = 2 / sample_time, cos * cos, width_of(worlds), corner_of(worlds)
    u2 = h * h * (sin * sin) / square
    scale, excess = square * strip.size, sum_of(strip.excess) / strip.size
    off = _positive(-sum_of(strip.high) / scale - width / 2, ops)
    if strip.low is not None:
        off = off + _positive(sum_of(strip.low) / scale + width / 2, ops)
    missing = width * width / 4 - off * off
    least = missing / (corner * width / 2 + _root(width * width / 4 * (u2 + corner * corner) - u2 * (off * off), ops))
    vertex = corner * width / 2
    rest = ops.where_positive(
        u2 * excess + vertex,
        lambda: excess * (corner * width + u2 * excess),
        lambda: -(vertex * vertex / (u2 + NOTHING)),
    )
    needed = _root(width * width / 4 - rest, ops)
    return Disjuncts(
        resistive=(*strip.excess, -(least * strip.size)),
        above=None if strip.low is None else (*strip.low, (width / 2 - needed) * scale),
        below=(*(-term for term in strip.high), -((width / 2 + needed) * scale)),
        turned=None,
    )


def shares_of(
    strip: Strip, tangent: Tangent, worlds: Worlds, sample_time: Number, theta: Number, ops: Arithmetic
) -> Shares:
    """Return a lower bound of E by tangents.

    Parameters
    ----------
    strip : of masses and dampings
    tangent : where f and g are bounded from
    worlds : the box, with the corner
    sample_time : T, s
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
    """
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    h, square, width = 2 / sample_time, cos * cos, width_of(worlds)
    inertia, off = h * h * (sin * sin), tangent.rising + tangent.falling - square
    flat = tangent.falling * sum_of(strip.high) - strip.size * (width * 0.25) * (off * off)
    if strip.low is not None:
        flat = flat + tangent.rising * sum_of(strip.low)
    slope = corner_of(worlds) * square + inertia * (2 / width) * tangent.excess
    rest = slope * sum_of(strip.excess) - inertia * (tangent.excess * tangent.excess / width) * strip.size
    return Shares(flat, rest)


def tangent_at(strip: Strip, worlds: Worlds, sample_time: Number, theta: Number, ops: Arithmetic) -> Tangent:
    """Return the tangents at the least values of f and g, with which the bound is E.

    Parameters
    ----------
    strip, worlds, sample_time, theta, ops : as of `shares_of`, in numbers that have a sign
    """
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    h, square, width = 2 / sample_time, cos * cos, width_of(worlds)
    inertia, least = h * h * (sin * sin), corner_of(worlds) * width * square
    falling = -_positive(-(square + 2 / width * (sum_of(strip.high) / strip.size)), ops)
    rising = 0 * falling
    if strip.low is not None:
        rising = _positive(square + 2 / width * (sum_of(strip.low) / strip.size), ops)
    excess = sum_of(strip.excess) / strip.size
    bounded = ops.where_positive(
        2 * inertia * excess + least, lambda: excess, lambda: -(least / (2 * inertia + NOTHING))
    )
    return Tangent(rising, falling, bounded)


def width_of(worlds: Worlds) -> Any:
    """Return k_2 - k_1, N/m."""
    return worlds.high.stiffness - worlds.low.stiffness


def corner_of(worlds: Worlds) -> Any:
    """Return w_c of the multiplier, rad/s."""
    assert worlds.corner is not None
    return worlds.corner


def _positive(x: Number, ops: Arithmetic) -> Number:
    return ops.where_positive(x, lambda: x, lambda: 0 * x)


def _root(x: Number, ops: Arithmetic) -> Number:
    """Return the root of x, and about 0 of what is negative."""
    return ops.sqrt(_positive(x, ops) + NOTHING)
