"""A design problem made easier, so that boxes of designs can be judged at once.

See model/README.md, section 8; design/bound/README.md, section 1.

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

from vctune.design.bound.quadratics import GUARD, Quadratic, both_down, both_up, rounded_down, rounded_up
from vctune.interrupt import interrupt_deferred
from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import re_conj_product
from vctune.model.problem import Problem
from vctune.model.quantities import Device, Gains
from vctune.model.sampled import return_difference, sampled_plant, split_delay
from vctune.proof.arb_balls import BALLS, ball, device_ball
from vctune.proof.array_intervals import Enclosure, Floats, decimal
from vctune.proof.devices import UNCERTAIN
from vctune.proof.jets import ENCLOSURES

PRECISION = 2.0**-44
"""Of the integrals, relative: 6e-14, of the size of `GUARD`. Half and twice it change the bound by as much, and the
time by one of Gauss's nodes."""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """What a frequency contributes for each unit of gain: of K_v and of K_p, where there are two.

    Attributes
    ----------
    Z2 : |Z_d|^2
    re_Zd_conj_C : Re(Z_d conj C_v), Re(Z_d conj C_p)
    C2 : |C_v|^2, |C_p|^2
    im_C_conj_Zd : Im(C_v conj Z_d), Im(C_p conj Z_d)
    re_C : Re C_v, Re C_p
    """

    Z2: Number
    re_Zd_conj_C: tuple[Number, Number]
    C2: tuple[Number, Number]
    im_C_conj_Zd: tuple[Number, Number]
    re_C: tuple[Number, Number]


def coefficients(device: Device, omega: Number, ops: Arithmetic) -> Coefficients:
    """Return the coefficients at a frequency omega > 0 from the loops of unit gains.

    Parameters
    ----------
    device : its numbers and omega in one arithmetic
    omega : rad/s, > 0
    ops : that arithmetic
    """
    hold = hold_response(device, omega, ops)
    one = loop_response(device, Gains(1, 0), omega, hold, ops)
    two = loop_response(device, Gains(0, 1), omega, hold, ops)
    squared = omega * omega
    return Coefficients(
        one.Z_d_scaled.abs2(),
        (re_conj_product(one.Z_d_scaled, one.C_scaled), re_conj_product(two.Z_d_scaled, two.C_scaled) / squared),
        (one.C_scaled.abs2(), two.C_scaled.abs2() / squared),
        (one.im_C_conj_Zd_scaled, two.im_C_conj_Zd_scaled / omega),
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
    im_low, im_high : bounds of what K_v and K_p contribute to Im(C conj Z_d)
    """

    omega: Floats
    operator: float
    D2: Quadratic
    C2: Quadratic
    P: Quadratic
    resistance: Quadratic
    D2_low: Quadratic
    C2_low: Quadratic
    im_low: tuple[Floats, Floats]
    im_high: tuple[Floats, Floats]


@dataclass(frozen=True, slots=True)
class BoundedQuotient:
    """A quotient of quadratics in the gains at several points: a term of the squared error, or |S|^2.

    A point is a frequency, or an interval over which the term is averaged.

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
    admittance, tracking : terms of the squared error
    omega : rad/s, where the error is looked at for norm "peak"; None for "rms"
    n_objective_devices : number of devices the greatest of whose errors is the objective; their terms follow one
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
    n_objective_devices: int


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
    intervals : into how many, or at how many frequencies, the transparency band is divided
    """
    band, weights = problem.transparency.band, problem.transparency.weights
    if problem.transparency.norm == "peak":
        nodes = np.geomspace(band.min, band.max, intervals)
        omega_e = np.tile(nodes, len(objective))
        at_nodes = _enclosed(_stacked(objective, intervals), omega_e)
        D2 = _squared(at_nodes)
        terms = BoundedQuotient(np.ones(len(omega_e)), D2), BoundedQuotient(rounded_down(at_nodes.Z2), D2)
    else:
        omega_e = None
        admittances, trackings = zip(*(_integrated(d, band.min, band.max, intervals) for d in objective), strict=True)
        terms = _concatenated(admittances), _concatenated(trackings)
    scale = (weights.admittance * problem.transparency.reference_impedance) ** 2, weights.tracking**2
    admittance, tracking = (
        BoundedQuotient(term.numerator * (factor * (1 - GUARD)), term.D2)
        for term, factor in zip(terms, scale, strict=True)
    )
    conditions, sensitivity = _conditions(*_everywhere(devices, omega)), _sensitivity(*_everywhere(devices, omega_S))
    return Relaxation(problem, devices, conditions, omega_S, sensitivity, admittance, tracking, omega_e, len(objective))


def at_frequencies(relaxed: Relaxation, omega: Floats, omega_S: Floats) -> Relaxation:
    """Return the relaxation with its demands at other frequencies."""
    devices = relaxed.devices
    conditions, sensitivity = _conditions(*_everywhere(devices, omega)), _sensitivity(*_everywhere(devices, omega_S))
    return replace(relaxed, conditions=conditions, omega_S=omega_S, sensitivity=sensitivity)


def _everywhere(devices: list[Device], omega: Floats) -> tuple[Device, Floats]:
    """Return devices as one, and every frequency for each of them."""
    return _stacked(devices, len(omega)), np.tile(omega, len(devices))


def _stacked(devices: list[Device], count: int) -> Device:
    """Return devices as one whose numbers are arrays, each repeated so often; a single one as it is."""
    if len(devices) == 1:
        return devices[0]
    mass, damping, delay = (np.repeat([getattr(d, name) for d in devices], count) for name in UNCERTAIN)
    return replace(devices[0], mass=mass, damping=damping, delay=delay)


def _concatenated(terms: Sequence[BoundedQuotient]) -> BoundedQuotient:
    if len(terms) == 1:
        return terms[0]

    def row(of: Callable[[BoundedQuotient], Floats]) -> Floats:
        return np.concatenate([of(term) for term in terms])

    linear = row(lambda term: term.D2.linear[0]), row(lambda term: term.D2.linear[1])
    square = row(lambda term: term.D2.square[0]), row(lambda term: term.D2.square[1])
    D2 = Quadratic(row(lambda term: term.D2.constant), linear, square)
    return BoundedQuotient(row(lambda term: term.numerator), D2)


def _conditions(device: Device, omega: Floats) -> Conditions:
    at, none = _enclosed(device, omega), np.zeros(len(omega))
    damping = device.converted(decimal).with_operator.damping
    return Conditions(
        omega,
        float(rounded_up(decimal(device.operator.damping))) if device.operator is not None else 0.0,
        _squared(at),
        Quadratic(none, (none, none), both_up(at.C2)),
        Quadratic(none, both_up(at.re_Zd_conj_C), both_up(at.C2)),
        Quadratic(np.full(len(omega), rounded_up(damping)), both_up(at.re_C), (none, none)),
        Quadratic(rounded_down(at.Z2), both_down(at.re_Zd_conj_C, 2), both_down(at.C2)),
        Quadratic(none, (none, none), both_down(at.C2)),
        both_down(at.im_C_conj_Zd),
        both_up(at.im_C_conj_Zd),
    )


def _sensitivity(device: Device, omega: Floats) -> BoundedQuotient:
    """Return |F_0|^2/|F|^2 of the sampled loop; F is affine in the gains, so that |F|^2 is convex in them."""
    whole, fraction = split_delay(device.delay, device.sample_time)
    exact = device.bare.converted(decimal)
    plant = sampled_plant(exact, whole, ENCLOSURES, fractional=bool(np.any(fraction)))
    F = return_difference(plant, exact.sample_time * omega, ENCLOSURES, position=True)
    crossed = re_conj_product(F.open, F.velocity), re_conj_product(F.open, F.position)
    squares = F.velocity.abs2(), F.position.abs2()
    cross = 2 * rounded_up(re_conj_product(F.velocity, F.position))
    linear = 2 * rounded_up(crossed[0]), 2 * rounded_up(crossed[1])
    F_0 = F.open.abs2()
    return BoundedQuotient(
        np.maximum(rounded_down(F_0), 0.0), Quadratic(rounded_up(F_0), linear, both_up(squares), cross)
    )


def _enclosed(device: Device, omega: Floats) -> Coefficients:
    return coefficients(device.bare.converted(decimal), Enclosure(omega), ENCLOSURES)


def _squared(at: Coefficients) -> Quadratic:
    """Return |D|^2."""
    return Quadratic(
        rounded_up(at.Z2), (2 * rounded_up(at.re_Zd_conj_C[0]), 2 * rounded_up(at.re_Zd_conj_C[1])), both_up(at.C2)
    )


def _integrated(device: Device, low: float, high: float, intervals: int) -> tuple[BoundedQuotient, BoundedQuotient]:
    """Return the terms of the mean over log frequency, by Cauchy and Schwarz on each of several equal intervals."""
    exact = device_ball(device.bare)
    first, length = ball(low).log(), ball(high).log() - ball(low).log()
    edges = [first + length * k / intervals for k in range(intervals + 1)]

    def integral(f: Callable[[Coefficients], acb], k: int) -> arb:
        def integrand(x: acb, _analytic: bool) -> acb:
            return f(coefficients(exact, x.exp(), BALLS))

        return acb.integral(integrand, edges[k], edges[k + 1], rel_tol=PRECISION, abs_tol=0).real / length

    def term(weight: Callable[[Coefficients], acb]) -> BoundedQuotient:
        parts = [
            weight,
            lambda c: weight(c) * c.Z2,
            lambda c: weight(c) * c.re_Zd_conj_C[0],
            lambda c: weight(c) * c.re_Zd_conj_C[1],
            lambda c: weight(c) * c.C2[0],
            lambda c: weight(c) * c.C2[1],
        ]
        found = [[integral(part, k) for k in range(intervals)] for part in parts]
        numerator, constant, v, p, v2, p2 = (
            Enclosure(np.array([float(x.mid()) for x in row]), np.array([float(x.rad()) for x in row])) for row in found
        )
        square = rounded_down(numerator) ** 2 * (1 - GUARD)
        return BoundedQuotient(
            square,
            Quadratic(rounded_up(constant), (2 * rounded_up(v), 2 * rounded_up(p)), (rounded_up(v2), rounded_up(p2))),
        )

    with ctx.workprec(64), interrupt_deferred():  # an exception within Arb's integrand becomes one of another name
        return term(lambda c: acb(1)), term(lambda c: c.Z2)
