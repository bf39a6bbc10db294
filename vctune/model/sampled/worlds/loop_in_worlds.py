"""Evaluate the sampled loop in a hand with every environment of a box (model/README.md, section 18).

An environment Z_e = b + m s_d + k/s_d puts a pole of the loop at the angle theta if -Y = Z_e there, with Y = y Z_c +
Z_seen, s_d = j u and u = (2/T) tan(theta/2). Since b has no upper limit, the box contains no such Z_e if

    Re Y + b_1 > 0,   or   -Im Y > m_2 u - k_1/u,   or   -Im Y < m_1 u - k_2/u.

With the safety factor g, one of these conditions must hold for every y from 1/g to 1. The first condition fails below
some y, the second above some y, and the third below some y. The values of y at which all three fail therefore form an
interval. This interval contains no y from 1/g to 1 in any of four cases: the first condition holds at y = 1/g, the
third holds at y = 1/g, the second holds at y = 1, or the first holds at the y above which the second fails. The last
case is

    Re Z_c (-Im Z_seen - m_2 u + k_1/u) > Im Z_c (R - b_1).

The code multiplies these numbers by s c |F|^2, with s = sin(theta/2) and c = cos(theta/2). The products are regular at
theta = 0 and at theta = pi.

The coupling of an impedance display is a part of the loop that the environment meets. With a share y of the coupling's
admittance, that loop is Z_seen = 1/(y/Z_c + G), and there is no other coupling
(`vctune.model.sampled.hand_loop.seen_by_tool`). The same inequalities then hold with Z_c = 0, for each y separately.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple

from vctune.model.coupling import sampled_reactance, sampled_resistance
from vctune.model.gains import Coupling
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.worlds import Worlds

NOTHING = 1e-30
"""Value that the code adds to a divisor that is a sum of magnitudes, because all the magnitudes may be 0. Any value far
below the magnitudes and above the square root of the least positive double would serve."""


class Seen(NamedTuple):
    """The impedance that the loop in a hand presents to the environment, Z_seen = -lost/size - j swing/(s size).

    For an impedance display, Z_seen is the impedance that the virtual tool meets, or G/s^2 if the coupling is not
    included.

    Attributes
    ----------
    lost, size : R = lost/size, N s/m; the size is |F|^2, or 1 for a servo
    swing : -s size Im Z_seen, which is half of Re(P conj F) without a coupling; it is > 0 for a spring
    """

    lost: Number
    swing: Number
    size: Number


class Offered(NamedTuple):
    """The impedance Z_c of the coupling as the firmware runs it.

    Attributes
    ----------
    resistance : Re Z_c, N s/m
    reactance : c Im Z_c, N s/m, with c = cos(theta/2)
    """

    resistance: Number
    reactance: Number


class Disjuncts(NamedTuple):
    """Margins, each as the terms of its sum.

    If one of the margins is positive, no environment puts a pole at this angle. A field is None if no coupling can make
    its margin positive, or if another margin covers it.

    Attributes
    ----------
    resistive : margin of the real part
    above, below : margins by which the reactance lies above, or below, the reactance of every environment
    turned : margin that is positive if, at each y, the real part suffices or the reactance lies above the reactance of
        every environment
    """

    resistive: tuple[Number, ...]
    above: tuple[Number, ...] | None
    below: tuple[Number, ...] | None
    turned: tuple[Number, ...] | None


UNCOUPLED = Offered(0, 0)
"""No coupling. The proof uses this value for an impedance display, because its loop already contains the coupling."""


def offered_at(coupling: Coupling, sample_time: Number, theta: Number, ops: Arithmetic) -> Offered:
    """Return Z_c at theta = omega T.

    Parameters
    ----------
    coupling : coupling in numbers of the arithmetic
    sample_time : T, s
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments
    """
    return Offered(
        sampled_resistance(coupling, sample_time, theta, ops), sampled_reactance(coupling, sample_time, theta, ops)
    )


def posed(worlds: Worlds, factor: float, *, inverse: bool = False) -> tuple[str, ...]:
    """Return the names of the margins that can be positive in a box of environments.

    Parameters
    ----------
    worlds : the box of environments
    factor : safety factor g, >= 1
    inverse : True for an impedance display, whose margins belong to one share of the coupling; `turned` is then absent
    """
    if worlds.resistive:
        return ("resistive",)
    turned = () if factor == 1 or inverse else ("turned",)
    above = () if _endless(worlds.high.mass) else ("above", *turned)
    return "resistive", *above, *(() if _endless(worlds.high.stiffness) else ("below",))


def disjuncts(
    offered: Offered, worlds: Worlds, sample_time: Number, seen: Seen, factor: Number, theta: Number, ops: Arithmetic
) -> Disjuncts:
    """Return margins, each times a positive number that contains |F|^2; at least one of them must be positive.

    Parameters
    ----------
    offered : impedance Z_c of the coupling; for an impedance display `UNCOUPLED`, or the first part of `met_in_hand`
    worlds : the box of environments, in numbers of the arithmetic; an infinite limit is a plain float
    sample_time : T, s
    seen : impedance of the loop in a hand
    factor : safety factor g, >= 1; 1 for an impedance display, whose loop has a share of the coupling
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments
    """
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
    """Return `disjuncts` divided by rho^2, for K_p = 0, theta near 0 and a hand without stiffness.

    If the least stiffness of the box is 0, `above` is also divided by s. `below` and `turned` are None, because they
    are not positive there.

    Parameters
    ----------
    offered, worlds, sample_time, factor, theta, ops : see `disjuncts`
    seen : the loop divided by rho^2; its swing is also divided by s
    """
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
    """Return the relative distance of a margin from 0: twice the sum of its terms over the sum of their magnitudes.

    Near 0 this is the logarithm of the ratio of positive to negative terms.

    Parameters
    ----------
    terms : terms of the margin
    absolute : function that returns the magnitude of a number
    """
    return 2 * sum_of(terms) / (sum_of(tuple(map(absolute, terms))) + NOTHING)


def sum_of(terms: tuple[Number, ...]) -> Number:
    """Return a margin as the sum of its terms."""
    first, *others = terms
    return sum(others, start=first)


def _endless(limit: Any) -> bool:
    return isinstance(limit, float) and limit == inf
