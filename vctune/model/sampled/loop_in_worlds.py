"""The sampled loop in a hand with every environment of a box (model/README.md, section 18).

An environment Z_e = b + m s_d + k/s_d of the box holds a pole of the loop at the angle theta if -Y = Z_e there, with Y
= y Z_c + Z_seen, s_d = j u and u = (2/T) tan(theta/2). As b has no upper limit, there is no such environment if

    Re Y + b_1 > 0,   or   -Im Y > m_2 u - k_1/u,   or   -Im Y < m_1 u - k_2/u.

The safety factor g requires this with every y from 1/g to 1. The values of y at which all three fail form an interval:
the first fails below a y, the second above one, the third below one. So the interval is outside if the first or the
third holds at y = 1/g, the second at y = 1, or the first from where the second fails. The last is

    Re Z_c (-Im Z_seen - m_2 u + k_1/u) > Im Z_c (R - b_1).

Multiplied by s c |F|^2, s = sin(theta/2) and c = cos(theta/2), they are regular at both ends.

An impedance display meets Z_e through Y = y/Z_c + G, an admittance, and a pole is where -1/Y = Z_e. With Y = s^2 (r +
j i/s)/d, d > 0, and Q = s^2 r^2 + i^2, none is if for each y from 1/g to 1

    r > 0,   or   r d + b_1 Q > 0,   or   c i d > Q (m_2 (2/T) s^2 - k_1 (T/2) c^2),
    or   c i d < Q (m_1 (2/T) s^2 - k_2 (T/2) c^2).
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple

from vctune.model.coupling import sampled_reactance, sampled_resistance
from vctune.model.gains import Coupling
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.sampled.impedance_display import Offered as OfferedBySpring
from vctune.model.worlds import Worlds

NOTHING = 1e-30
"""Amount added to sizes that may all be 0. Any number works that is far below them and above the square root of the
least."""


class Seen(NamedTuple):
    """Z_seen = -lost/size - j swing/(s size), the impedance of the loop in a hand that the environment sees.

    On an impedance display it is G/s^2.

    Attributes
    ----------
    lost, size : R = lost/size
    swing : half of Re(P conj F), > 0 for a spring
    """

    lost: Number
    swing: Number
    size: Number


class Offered(NamedTuple):
    """Z_c of the coupling as the firmware runs it.

    Attributes
    ----------
    resistance : Re Z_c
    reactance : c Im Z_c
    """

    resistance: Number
    reactance: Number


class Disjuncts(NamedTuple):
    """Margins as the terms of their sums: where one of the margins is positive, no environment puts a pole there.

    None for an environment that no coupling can have, or that the others contain.

    Attributes
    ----------
    resistive : the real part suffices
    above, below : the reactance is above, or below, that of every environment
    turned : one or the other with every reserve
    """

    resistive: tuple[Number, ...]
    above: tuple[Number, ...] | None
    below: tuple[Number, ...] | None
    turned: tuple[Number, ...] | None


class DisjunctsOfForce(NamedTuple):
    """The same of an impedance display with one share of its coupling.

    Attributes
    ----------
    resistive, above, below : see `Disjuncts`; the real part without any damping of the environment
    damped : the real part suffices with the least damping; None if that is 0
    """

    resistive: tuple[Number, ...]
    above: tuple[Number, ...] | None
    below: tuple[Number, ...] | None
    damped: tuple[Number, ...] | None


def offered_at(coupling: Coupling, sample_time: Number, theta: Number, ops: Arithmetic) -> Offered:
    """Return Z_c at theta = omega T.

    Parameters
    ----------
    coupling : coupling in numbers of the arithmetic
    sample_time : T, s
    theta : rad, in [0, pi]
    ops : arithmetic of all of these
    """
    return Offered(
        sampled_resistance(coupling, sample_time, theta, ops), sampled_reactance(coupling, sample_time, theta, ops)
    )


def posed(worlds: Worlds, factor: float, *, inverse: bool = False) -> tuple[str, ...]:
    """Return the names of the margins that can be positive in a box of environments.

    Parameters
    ----------
    worlds : the box
    factor : g, >= 1
    inverse : whether the display is an impedance display, whose margins are of one share of the coupling
    """
    turned = () if factor == 1 or inverse else ("turned",)
    above = () if _endless(worlds.high.mass) else ("above", *turned)
    damped = ("damped",) if inverse and worlds.low.damping > 0 else ()
    return "resistive", *above, *(() if _endless(worlds.high.stiffness) else ("below",)), *damped


def disjuncts(
    offered: Offered, worlds: Worlds, sample_time: Number, seen: Seen, factor: Number, theta: Number, ops: Arithmetic
) -> Disjuncts:
    """Return the margins, of which one must be positive.

    Parameters
    ----------
    offered : by the coupling
    worlds : the box, in numbers of the arithmetic; a limit that is infinite is a plain float
    sample_time : T, s
    seen : impedance of the loop in a hand
    factor : g, >= 1
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
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


def disjuncts_of_force(
    offered: OfferedBySpring,
    worlds: Worlds,
    sample_time: Number,
    seen: Seen,
    share: Number,
    theta: Number,
    ops: Arithmetic,
) -> DisjunctsOfForce:
    """Return the same of an impedance display with one share of its coupling's admittance.

    Parameters
    ----------
    offered : by the coupling
    worlds, sample_time, seen, theta, ops : see `disjuncts`
    share : y, from 1/g to 1
    """
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    inertia, compliance = sin * sin * (2 / sample_time), cos * cos * (sample_time / 2)
    low, high, size = worlds.low, worlds.high, seen.size
    resistive = (share * (offered.above * size), -(seen.lost * offered.below))
    turning = (share * (offered.spring * size), -(seen.swing * offered.below))
    r, i, d = sum_of(resistive), sum_of(turning), offered.below * size
    Q = sin * sin * (r * r) + i * i
    across = (cos * (d * turning[0]), cos * (d * turning[1]))
    above = below = damped = None
    if not _endless(high.mass):
        above = (*across, low.stiffness * compliance * Q, -(high.mass * inertia * Q))
    if not _endless(high.stiffness):
        below = (low.mass * inertia * Q, -(high.stiffness * compliance * Q), -across[0], -across[1])
    if not ops.is_zero(low.damping):
        damped = (r * d, low.damping * Q)
    return DisjunctsOfForce(resistive, above, below, damped)


def limp_disjuncts(
    offered: Offered, worlds: Worlds, sample_time: Number, seen: Seen, factor: Number, theta: Number, ops: Arithmetic
) -> Disjuncts:
    """Return the same over rho^2, for K_p = 0 next to theta = 0 and a hand without stiffness.

    Parameters
    ----------
    offered, worlds, sample_time, factor, theta, ops : see `disjuncts`
    seen : the loop over rho^2, and its swing also over s
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
    """Return how far a margin is from 0: twice the sum of its terms, relative to the sum of their sizes.

    Near 0 that is the logarithm of the ratio of gain to loss.

    Parameters
    ----------
    terms : terms of the margin
    absolute : returns the size of a number
    """
    return 2 * sum_of(terms) / (sum_of(tuple(map(absolute, terms))) + NOTHING)


def sum_of(terms: tuple[Number, ...]) -> Number:
    """Return a margin from its terms."""
    first, *others = terms
    return sum(others, start=first)


def _endless(limit: Any) -> bool:
    return isinstance(limit, float) and limit == inf
