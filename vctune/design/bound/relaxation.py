"""A design problem made easier, so that boxes of designs can be judged at once.

See design/bound/README.md, section 1; model/README.md, section 8.

C is linear in the gains, C = K_v C_v + K_p C_p with C_p at right angles to C_v, so that

    |D|^2 = |Z_d|^2 + 2 K_v Re(Z_d conj C_v) + 2 K_p Re(Z_d conj C_p) + K_v^2 |C_v|^2 + K_p^2 |C_p|^2

takes its greatest value over a box of gains at a vertex, and so do |C|^2, Re D and P = Re(C conj D). With the least
|Im(C conj Z_d)|, attained at a vertex or 0, they bound R from below. Any set of frequencies will do, for the demands
can only be harder on the whole band. The mean of w/|D|^2 over an interval is at least (integral of w)^2 / (integral of
w |D|^2) (Cauchy and Schwarz), where the integrals are of known functions, enclosed by Arb.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import acb, arb, ctx

from vctune.design.bound.quadratics import Quadratic
from vctune.interrupt import interrupt_deferred
from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import re_conj_product
from vctune.model.problem import Problem
from vctune.model.quantities import Device, Gains
from vctune.model.sampled import return_difference, sampled_plant, whole_samples
from vctune.proof.balls import BALLS, ball, device_ball
from vctune.proof.devices import UNCERTAIN
from vctune.proof.enclosures import Enclosure, Floats, decimal
from vctune.proof.jets import ENCLOSURES

GUARD = 1e-14
"""Covers the rounding of a sum of five products, and of the few operations after it, relative to their moduli."""
PRECISION = 2.0**-44
"""Of the integrals, relative: what is enclosed is exact, a coarser one is a weaker bound by that much."""


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
    one = loop_response(device, Gains(1, 0), omega, hold, ops)
    two = loop_response(device, Gains(0, 1), omega, hold, ops)
    squared = omega * omega
    return Coefficients(
        one.Z_d.abs2(),
        (re_conj_product(one.Z_d, one.C), re_conj_product(two.Z_d, two.C) / squared),
        (one.C.abs2(), two.C.abs2() / squared),
        (one.turn, two.turn / omega),
        (one.resistance - device.damping, two.resistance - device.damping),
    )


@dataclass(frozen=True, slots=True)
class Conditions:
    """Llewellyn's conditions at some frequencies.

    Attributes
    ----------
    omega : rad/s, those of one device after another
    operator : b_h, rounded up
    D2, C2, P, resistance : |D|^2, |C|^2, Re(C conj D) and Re(D + Z_h), rounded up
    D2_low, C2_low : rounded down
    turn_low, turn_high : bounds of what K_v and K_p contribute to Im(C conj Z_d)
    """

    omega: Floats
    operator: float
    D2: Quadratic
    C2: Quadratic
    P: Quadratic
    resistance: Quadratic
    D2_low: Quadratic
    C2_low: Quadratic
    turn_low: tuple[Floats, Floats]
    turn_high: tuple[Floats, Floats]


@dataclass(frozen=True, slots=True)
class BoundedQuotient:
    """A quotient of quadratics in the gains for each of several points: a term of the squared error, or |S|^2.

    Attributes
    ----------
    numerator : lower bounds, of what does not depend on the gains
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
    devices : at which the demands are posed
    conditions : on the coupling
    omega_S, sensitivity : rad/s, |S|^2 of the sampled loop at some frequencies; for an uncertain device the demands
        are posed at each vertex of its box too
    admittance, tracking : quotients of the squared error
    omega : rad/s, where the error is looked at for norm "peak"; None for "rms"
    objective_devices : number of devices the greatest of whose errors is the objective; their quotients follow one
        another
    """

    problem: Problem
    devices: list[Device]
    conditions: Conditions
    omega_S: Floats
    sensitivity: BoundedQuotient
    admittance: BoundedQuotient
    tracking: BoundedQuotient
    omega: Floats | None
    objective_devices: int


def relaxation(
    problem: Problem, devices: list[Device], objective: list[Device], omega: Floats, omega_S: Floats, intervals: int
) -> Relaxation:
    """Relax a problem.

    Parameters
    ----------
    problem : Problem
    devices : at which the demands are posed
    objective : those of them the greatest of whose errors is the objective
    omega : rad/s, frequencies of the stability band
    omega_S : rad/s, frequencies up to Nyquist
    intervals : into how many intervals, or at how many frequencies, the transparency band is divided
    """
    band, weights = problem.transparency.band, problem.transparency.weights
    if problem.transparency.norm == "peak":
        nodes = np.geomspace(band.min, band.max, intervals)
        omega_e = np.tile(nodes, len(objective))
        enclosed = _enclosed(_as_one(objective, intervals), omega_e)
        quotients = (
            BoundedQuotient(np.ones(len(omega_e)), _squared(enclosed)),
            BoundedQuotient(_bottom(enclosed.Z2), _squared(enclosed)),
        )
    else:
        omega_e = None
        admittances, trackings = zip(*(_integrated(d, band.min, band.max, intervals) for d in objective), strict=True)
        quotients = _in_a_row(admittances), _in_a_row(trackings)
    scale = (weights.admittance * problem.transparency.reference_impedance) ** 2, weights.tracking**2
    admittance, tracking = (
        BoundedQuotient(quotient.numerator * (factor * (1 - GUARD)), quotient.D2)
        for quotient, factor in zip(quotients, scale, strict=True)
    )
    conditions, sensitivity = (
        _conditions(*_at_each_device(devices, omega)),
        _sensitivity(*_at_each_device(devices, omega_S)),
    )
    return Relaxation(problem, devices, conditions, omega_S, sensitivity, admittance, tracking, omega_e, len(objective))


def at_frequencies(relaxed: Relaxation, omega: Floats, omega_S: Floats) -> Relaxation:
    """Return the relaxation with its demands at other frequencies."""
    devices = relaxed.devices
    conditions, sensitivity = (
        _conditions(*_at_each_device(devices, omega)),
        _sensitivity(*_at_each_device(devices, omega_S)),
    )
    return replace(relaxed, conditions=conditions, omega_S=omega_S, sensitivity=sensitivity)


def _at_each_device(devices: list[Device], omega: Floats) -> tuple[Device, Floats]:
    """Return devices as one, and every frequency for each of them."""
    return _as_one(devices, len(omega)), np.tile(omega, len(devices))


def _as_one(devices: list[Device], count: int) -> Device:
    """Return devices as one whose numbers are arrays, each repeated so often; a single one as it is."""
    if len(devices) == 1:
        return devices[0]
    mass, damping, delay = (np.repeat([getattr(d, name) for d in devices], count) for name in UNCERTAIN)
    return replace(devices[0], mass=mass, damping=damping, delay=delay)


def _in_a_row(quotients: Sequence[BoundedQuotient]) -> BoundedQuotient:
    if len(quotients) == 1:
        return quotients[0]

    def row(of: Callable[[BoundedQuotient], Floats]) -> Floats:
        return np.concatenate([of(quotient) for quotient in quotients])

    linear = row(lambda quotient: quotient.D2.linear[0]), row(lambda quotient: quotient.D2.linear[1])
    square = row(lambda quotient: quotient.D2.square[0]), row(lambda quotient: quotient.D2.square[1])
    return BoundedQuotient(
        row(lambda quotient: quotient.numerator), Quadratic(row(lambda quotient: quotient.D2.constant), linear, square)
    )


def _conditions(device: Device, omega: Floats) -> Conditions:
    at, none = _enclosed(device, omega), np.zeros(len(omega))
    held = device.over(decimal).held.damping
    return Conditions(
        omega,
        float(_top(decimal(device.operator.damping))) if device.operator is not None else 0.0,
        _squared(at),
        Quadratic(none, (none, none), _tops(at.C2)),
        Quadratic(none, _tops(at.along), _tops(at.C2)),
        Quadratic(np.full(len(omega), _top(held)), _tops(at.re_C), (none, none)),
        Quadratic(_bottom(at.Z2), _bottoms(at.along, 2), _bottoms(at.C2)),
        Quadratic(none, (none, none), _bottoms(at.C2)),
        _bottoms(at.turn),
        _tops(at.turn),
    )


def _sensitivity(device: Device, omega: Floats) -> BoundedQuotient:
    """Return |F_0|^2/|F|^2 of the sampled loop; F is affine in the gains, so that |F|^2 is convex in them."""
    whole, fraction = whole_samples(device.delay, device.sample_time)
    exact = device.bare.over(decimal)
    plant = sampled_plant(exact, whole, ENCLOSURES, fractional=bool(np.any(fraction)))
    F = return_difference(plant, exact.sample_time * omega, ENCLOSURES, position=True)
    along = re_conj_product(F.open, F.velocity), re_conj_product(F.open, F.position)
    squares = F.velocity.abs2(), F.position.abs2()
    cross = 2 * _top(re_conj_product(F.velocity, F.position))
    linear = 2 * _top(along[0]), 2 * _top(along[1])
    openness = F.open.abs2()
    return BoundedQuotient(np.maximum(_bottom(openness), 0.0), Quadratic(_top(openness), linear, _tops(squares), cross))


def _enclosed(device: Device, omega: Floats) -> Coefficients:
    return coefficients(device.bare.over(decimal), Enclosure(omega), ENCLOSURES)


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


def _integrated(device: Device, low: float, high: float, intervals: int) -> tuple[BoundedQuotient, BoundedQuotient]:
    """Return the quotients of the mean over log frequency, by Cauchy and Schwarz on each of several equal intervals."""
    exact = device_ball(device.bare)
    first, length = ball(low).log(), ball(high).log() - ball(low).log()
    edges = [first + length * k / intervals for k in range(intervals + 1)]

    def integral(f: Callable[[Coefficients], acb], k: int) -> arb:
        def integrand(x: acb, _analytic: bool) -> acb:
            return f(coefficients(exact, x.exp(), BALLS))

        return acb.integral(integrand, edges[k], edges[k + 1], rel_tol=PRECISION, abs_tol=0).real / length

    def quotient(weight: Callable[[Coefficients], acb]) -> BoundedQuotient:
        parts = [
            weight,
            lambda c: weight(c) * c.Z2,
            lambda c: weight(c) * c.along[0],
            lambda c: weight(c) * c.along[1],
            lambda c: weight(c) * c.C2[0],
            lambda c: weight(c) * c.C2[1],
        ]
        found = [[integral(part, k) for k in range(intervals)] for part in parts]
        numerator, constant, v, p, v2, p2 = (
            Enclosure(np.array([float(x.mid()) for x in row]), np.array([float(x.rad()) for x in row])) for row in found
        )
        square = _bottom(numerator) ** 2 * (1 - GUARD)
        return BoundedQuotient(square, Quadratic(_top(constant), (2 * _top(v), 2 * _top(p)), (_top(v2), _top(p2))))

    with ctx.workprec(64), interrupt_deferred():  # an exception within Arb's integrand becomes one of another name
        return quotient(lambda c: acb(1)), quotient(lambda c: c.Z2)
