"""What every admissible design in a box must at least cost: a lower bound on the error (DESIGN 1.8, 1.9).

C is linear in the gains, C = K_v C_v + K_p C_p with C_p at right angles to C_v, so that

    |D|^2 = |Z_d|^2 + 2 K_v Re(Z_d conj C_v) + 2 K_p Re(Z_d conj C_p) + K_v^2 |C_v|^2 + K_p^2 |C_p|^2

takes its greatest value over a box of gains at a vertex, and so do |C|^2, Re D and P = Re(C conj D). With the least
|Im(C conj Z_d)|, attained at a vertex or 0, they bound R from below. Any set of frequencies will do, for the demands
can only be harder on the whole band. The mean of w/|D|^2 over an interval is at least (integral of w)^2 / (integral of
w |D|^2) (Cauchy and Schwarz), where the integrals are of known functions, enclosed by Arb.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import inf, log

import numpy as np
from flint import acb, arb, ctx
from numpy.typing import NDArray

from vctune.document.problem import Problem
from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import re_conj_product
from vctune.model.quantities import Device, Gains
from vctune.proof.balls import BALLS, ball, device_ball
from vctune.proof.enclosures import Enclosure, Flags, Floats, decimal
from vctune.proof.jets import ENCLOSURES

GUARD = 1e-14
"""Covers the rounding of a sum of five products, and of the few operations after it, relative to their moduli."""
ENDS = 1e-12
"""Covers the rounding of the ends of an interval of log frequency, relative."""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """What a frequency contributes for each unit of gain: of K_v and of K_p, where there are two.

    Attributes
    ----------
    Z2 : |Z_d|^2
    along : Re(Z_d conj C_v), Re(Z_d conj C_p)
    C2 : |C_v|^2, |C_p|^2
    turn : Im(C_v conj Z_d), Im(C_p conj Z_d)
    re_C : Re C_v, Re C_p
    """

    Z2: Number
    along: tuple[Number, Number]
    C2: tuple[Number, Number]
    turn: tuple[Number, Number]
    re_C: tuple[Number, Number]


def coefficients(device: Device, omega: Number, ops: Arithmetic) -> Coefficients:
    """Return the coefficients at a frequency omega > 0 from the loops of unit gains."""
    hold = hold_response(device, omega, ops)
    one = loop_response(device, Gains(1, 0), omega, hold, integrator=False)
    two = loop_response(device, Gains(0, 1), omega, hold, integrator=True)
    squared = omega * omega
    return Coefficients(
        one.Z_d.abs2(),
        (re_conj_product(one.Z_d, one.C), re_conj_product(two.Z_d, two.C) / squared),
        (one.C.abs2(), two.C.abs2() / squared),
        (one.turn, two.turn / omega),
        (one.re_D - device.damping, two.re_D - device.damping),
    )


@dataclass(frozen=True, slots=True)
class Quadratic:
    """constant + linear . K + square . K^2 at several places, each coefficient rounded up, or each rounded down.

    Attributes
    ----------
    constant : shape (places,)
    linear, square : of K_v and of K_p, each of that shape; no square is negative
    """

    constant: Floats
    linear: tuple[Floats, Floats]
    square: tuple[Floats, Floats]

    def greatest(self, boxes: Boxes) -> Floats:
        """Return the greatest value over each box of gains, shape (boxes, places): it lies at a vertex."""
        total = self.constant
        for axis in (0, 1):
            ends = [edge[axis][:, None] for edge in (boxes.low, boxes.high)]
            total = total + np.maximum(*(self._part(axis, end) for end in ends))
        return total

    def least(self, boxes: Boxes) -> Floats:
        """Return the least value over each box of gains, shape (boxes, places)."""
        total = self.constant
        for axis in (0, 1):
            low, high = (edge[axis][:, None] for edge in (boxes.low, boxes.high))
            total = total + self._part(axis, np.clip(-0.5 * self.linear[axis] / self.square[axis], low, high))
        return total

    def _part(self, axis: int, gain: Floats) -> Floats:
        return gain * (self.linear[axis] + gain * self.square[axis])


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes of designs: [low, high] in each of K_v, K_p, tau_c = m_c/b_c and b_0; arrays of shape (4, n)."""

    low: Floats
    high: Floats

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def taken(self, at: NDArray[np.intp] | Flags) -> Boxes:
        """Return some of the boxes."""
        return Boxes(self.low[:, at], self.high[:, at])


@dataclass(frozen=True, slots=True)
class Demand:
    """Llewellyn's conditions at some frequencies.

    Attributes
    ----------
    omega : rad/s
    D2, C2, P, re_D : |D|^2, |C|^2, Re(C conj D) and Re D, rounded up
    D2_low, C2_low : rounded down
    turn_low, turn_high : bounds of what K_v and K_p contribute to Im(C conj Z_d)
    """

    omega: Floats
    D2: Quadratic
    C2: Quadratic
    P: Quadratic
    re_D: Quadratic
    D2_low: Quadratic
    C2_low: Quadratic
    turn_low: tuple[Floats, Floats]
    turn_high: tuple[Floats, Floats]


@dataclass(frozen=True, slots=True)
class Share:
    """A term numerator / |D|^2 of the squared error, for each of several places.

    Attributes
    ----------
    numerator : lower bounds
    D2 : upper bounds, weighted like the numerator
    """

    numerator: Floats
    D2: Quadratic


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A design problem made easier: fewer frequencies, and bounds in place of values.

    Attributes
    ----------
    problem : the problem
    demand : on the coupling
    omega_S, sensitivity : rad/s, |S|^2 at some frequencies up to Nyquist
    admittance, tracking : shares of the squared error
    omega : rad/s, where the error is looked at for norm "peak"; None for "rms"
    """

    problem: Problem
    demand: Demand
    omega_S: Floats
    sensitivity: Share
    admittance: Share
    tracking: Share
    omega: Floats | None


def relaxation(problem: Problem, omega: Floats, omega_S: Floats, places: int) -> Relaxation:
    """Relax a problem.

    Parameters
    ----------
    problem : Problem
    omega : rad/s, frequencies of the stability band
    omega_S : rad/s, frequencies up to Nyquist
    places : into how many intervals, or at how many frequencies, the transparency band is divided
    """
    band, weights = problem.transparency.band, problem.transparency.weights
    if problem.transparency.norm == "peak":
        nodes = np.geomspace(band.min, band.max, places)
        seen = _enclosed(problem.device, nodes)
        shares = Share(np.ones(places), _squared(seen)), Share(_bottom(seen.Z2), _squared(seen))
    else:
        nodes, shares = None, _integrated(problem.device, band.min, band.max, places)
    scale = (weights.admittance * problem.transparency.reference_impedance) ** 2, weights.tracking**2
    admittance, tracking = (
        Share(share.numerator * (factor * (1 - GUARD)), share.D2) for share, factor in zip(shares, scale, strict=True)
    )
    demand, sensitivity = _demand(problem.device, omega), _sensitivity(problem.device, omega_S)
    return Relaxation(problem, demand, omega_S, sensitivity, admittance, tracking, nodes)


def at_frequencies(relaxed: Relaxation, omega: Floats, omega_S: Floats) -> Relaxation:
    """Return the relaxation with its demands at other frequencies."""
    device = relaxed.problem.device
    demand, sensitivity = _demand(device, omega), _sensitivity(device, omega_S)
    return replace(relaxed, demand=demand, omega_S=omega_S, sensitivity=sensitivity)


def _demand(device: Device, omega: Floats) -> Demand:
    at, b, none = _enclosed(device, omega), decimal(device.damping), np.zeros(len(omega))
    return Demand(
        omega,
        _squared(at),
        Quadratic(none, (none, none), _tops(at.C2)),
        Quadratic(none, _tops(at.along), _tops(at.C2)),
        Quadratic(np.full(len(omega), _top(b)), _tops(at.re_C), (none, none)),
        Quadratic(_bottom(at.Z2), _bottoms(at.along, 2), _bottoms(at.C2)),
        Quadratic(none, (none, none), _bottoms(at.C2)),
        _bottoms(at.turn),
        _tops(at.turn),
    )


def _sensitivity(device: Device, omega: Floats) -> Share:
    at = _enclosed(device, omega)
    return Share(_bottom(at.Z2), _squared(at))


def _enclosed(device: Device, omega: Floats) -> Coefficients:
    m, b, T, delay = (decimal(x) for x in (device.mass, device.damping, device.sample_time, device.delay))
    return coefficients(Device(m, b, T, delay, device.hold), Enclosure(omega), ENCLOSURES)


def _top(x: Enclosure) -> Floats:
    return x.mid + x.rad + GUARD * (np.abs(x.mid) + x.rad)


def _bottom(x: Enclosure) -> Floats:
    return x.mid - x.rad - GUARD * (np.abs(x.mid) + x.rad)


def _tops(x: tuple[Enclosure, Enclosure]) -> tuple[Floats, Floats]:
    return _top(x[0]), _top(x[1])


def _bottoms(x: tuple[Enclosure, Enclosure], factor: int = 1) -> tuple[Floats, Floats]:
    return factor * _bottom(x[0]), factor * _bottom(x[1])


def _squared(at: Coefficients) -> Quadratic:
    """Return |D|^2."""
    return Quadratic(_top(at.Z2), (2 * _top(at.along[0]), 2 * _top(at.along[1])), _tops(at.C2))


def _integrated(device: Device, low: float, high: float, places: int) -> tuple[Share, Share]:
    """Return the shares of the mean over log frequency, by Cauchy and Schwarz on each of several equal intervals."""
    exact = device_ball(device)
    edges = np.linspace(log(low), log(high), places + 1)
    length = ball(high).log() - ball(low).log()

    def integral(f: Callable[[Coefficients], acb], k: int) -> arb:
        def integrand(x: acb, _analytic: bool) -> acb:
            return f(coefficients(exact, x.exp(), BALLS))

        return acb.integral(integrand, arb(edges[k]), arb(edges[k + 1])).real / length

    def share(weight: Callable[[Coefficients], acb]) -> Share:
        parts = [
            weight,
            lambda c: weight(c) * c.Z2,
            lambda c: weight(c) * c.along[0],
            lambda c: weight(c) * c.along[1],
            lambda c: weight(c) * c.C2[0],
            lambda c: weight(c) * c.C2[1],
        ]
        found = [[integral(part, k) for k in range(places)] for part in parts]
        numerator, constant, v, p, v2, p2 = (
            Enclosure(np.array([float(x.mid()) for x in row]), np.array([float(x.rad()) for x in row])) for row in found
        )
        square = _bottom(numerator) ** 2 * (1 - ENDS)
        return Share(square, Quadratic(_top(constant), (2 * _top(v), 2 * _top(p)), (_top(v2), _top(p2))))

    with ctx.workprec(64):
        return share(lambda c: acb(1)), share(lambda c: c.Z2)


@dataclass(frozen=True, slots=True)
class Least:
    """What the conditions leave to the couplings of each box; arrays of shape (boxes,).

    Attributes
    ----------
    damping, mass : the least b_c and m_c
    none : where they leave none
    """

    damping: Floats
    mass: Floats
    none: Flags


@np.errstate(all="ignore")
def lower_bounds(relaxed: Relaxation, boxes: Boxes) -> Floats:
    """Return for each box a lower bound on the error of its admissible designs; inf where it has none."""
    problem = relaxed.problem
    least = least_coupling(relaxed, boxes)
    limit = problem.stability.max_sensitivity * (1 + GUARD)
    none = (relaxed.sensitivity.numerator > limit**2 * relaxed.sensitivity.D2.greatest(boxes)).any(axis=1)
    room = 1 + 2 * GUARD
    none |= least.none | (least.damping > problem.bounds.damping.max * room)
    none |= least.mass > problem.bounds.mass.max * room
    none |= (boxes.low[1] > 0) & without_integrator(problem, boxes)
    admittance, tracking = (
        share.numerator / share.D2.greatest(boxes) for share in (relaxed.admittance, relaxed.tracking)
    )
    loop = admittance + tracking
    b_0, factor = boxes.low[3], (problem.transparency.weights.coupling / problem.transparency.reference_impedance) ** 2
    if relaxed.omega is None:
        coupling = _coupling(least, boxes, partial(_mean_share, problem))
        squared = loop.sum(axis=1) + factor * (b_0 * b_0 + coupling)
    else:
        coupling = _coupling(least, boxes, partial(_share, relaxed.omega[:, None]))
        squared = (loop + factor * (b_0 * b_0 + coupling).T).max(axis=1)
    known = np.nan_to_num(squared, nan=0.0, posinf=0.0)
    return np.where(none, inf, np.sqrt(known) * (1 - 10 * GUARD))


def without_integrator(problem: Problem, boxes: Boxes) -> Flags:
    """Return the boxes no admissible design of which has K_p > 0: b_0 is below every limit of R at omega = 0.

    The limit is b^2/(4 (b + K_v - tau K_p)) (DESIGN 1.6).
    """
    if problem.stability.band.min > 0:
        return np.zeros(len(boxes), bool)
    b, tau = problem.device.damping, problem.device.lag
    most = (b + boxes.high[0]) * (1 + GUARD) - tau * boxes.low[1] * (1 - GUARD)
    return (most < 0) | (4 * most * boxes.high[3] < problem.stability.safety_factor * b * b * (1 - 10 * GUARD))


def least_coupling(relaxed: Relaxation, boxes: Boxes) -> Least:
    """Return the least b_c and m_c that the conditions and the bounds leave to any design of a box.

    Re Z_c >= r needs b_c >= (r - b_0) (1 + 1/(omega tau_c)^2), least for the greatest tau_c, and m_c = b_c tau_c >=
    (r - b_0) (tau_c + 1/(omega^2 tau_c)), least for the tau_c next to 1/omega.
    """
    at, bounds = relaxed.demand, relaxed.problem.bounds
    R, none = _least_resistance(at, boxes)
    needed = np.maximum(relaxed.problem.stability.safety_factor * R - boxes.high[3][:, None], 0.0)
    shortest, longest = (edge[2][:, None] for edge in (boxes.low, boxes.high))
    nearest = np.clip(1 / at.omega, shortest, longest)
    damping = (needed * (1 + 1 / np.square(at.omega * longest))).max(axis=1)
    mass = (needed * (nearest + 1 / (np.square(at.omega) * nearest))).max(axis=1)
    b_c = np.maximum(np.maximum(damping, bounds.damping.min), bounds.mass.min / boxes.high[2])
    m_c = np.maximum(np.maximum(mass, bounds.mass.min), b_c * boxes.low[2])
    return Least(b_c * (1 - 10 * GUARD), m_c * (1 - 10 * GUARD), none)


def _least_resistance(at: Demand, boxes: Boxes) -> tuple[Floats, Flags]:
    """Return a lower bound of R, shape (boxes, frequencies), and the boxes in which Re D is nowhere positive."""
    low, high = (
        sum(np.minimum(*(turn[axis] * edge[axis][:, None] for edge in (boxes.low, boxes.high))) for axis in (0, 1))
        for turn in (at.turn_low, tuple(-t for t in at.turn_high))
    )
    turn = np.maximum(np.maximum(low, high), 0.0) * (1 - GUARD)
    re_D, P = at.re_D.greatest(boxes), at.P.greatest(boxes)
    weight = np.sqrt(at.C2.greatest(boxes) * at.D2.greatest(boxes)) * (1 + GUARD) + P
    product = np.sqrt(np.maximum(at.C2_low.least(boxes) * at.D2_low.least(boxes), 0.0)) * (1 - GUARD)
    excess = np.fmax(np.where(turn > 0, turn * turn / weight, 0.0), product - P)
    return np.fmax(excess / (2 * re_D) * (1 - 10 * GUARD), 0.0), np.asarray((re_D <= 0).any(axis=1))


def _coupling(least: Least, boxes: Boxes, share: Callable[[Floats], Floats]) -> Floats:
    """Return a lower bound of |Z_c|^2 - b_0^2 = 2 b_0 b_c s + b_c^2 s with s = x^2/(1 + x^2), x = omega tau_c, or its mean.

    s grows with tau_c, s/tau_c^2 falls: in b_c the last term is least for the least tau_c, in m_c for the greatest.
    """
    b_c, m_c, b_0 = least.damping, least.mass, boxes.low[3]
    light, heavy = share(boxes.low[2]), share(boxes.high[2])
    return 2 * b_0 * b_c * light + np.fmax(np.square(b_c) * light, np.square(m_c / boxes.high[2]) * heavy)


def _share(omega: Floats, tau_c: Floats) -> Floats:
    """Return x^2/(1 + x^2), x = omega tau_c: |Z_c/b_c|^2 and Re Z_c/b_c without drag."""
    x2 = np.square(omega * tau_c)
    return x2 / (1 + x2)


def _mean_share(problem: Problem, tau_c: Floats) -> Floats:
    """Return the mean of `_share` over log frequency."""
    low, high = problem.transparency.band.min, problem.transparency.band.max
    rise = (high - low) * (high + low) * np.square(tau_c) / (1 + np.square(low * tau_c))
    return np.log1p(rise) / (2 * log(high / low)) * (1 - GUARD * high / (high - low))
