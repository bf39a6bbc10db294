"""Bound the error of the designs of a box from below, term by term (design/bound/README.md, section 1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from flint import acb, arb, ctx

from vctune.design.bound.couplings import Couplings, SeriesCouplings, SpringDampers
from vctune.design.bound.quadratic_coefficients import (
    Coefficients,
    Term,
    concatenated,
    error_term,
    listed,
    loop_at,
    quadratic,
    repeated,
    replaced,
)
from vctune.design.bound.quadratics import BoundedQuotient, lower, upper
from vctune.interrupt import interrupt_deferred
from vctune.model.device import Device
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import Affine, LoopConstants, loop_constants
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair, re_conj_product
from vctune.model.problem import Band, Problem
from vctune.model.sampled.impedance_display import spring_forms
from vctune.model.transparency import quotient_terms
from vctune.proof.enclosures.arb_balls import BALLS, ball, device_ball
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Floats, decimal
from vctune.running import check_time

PRECISION = 2.0**-44  # Relative precision of the integrals, 6e-14, about the size of `GUARD`


@dataclass(frozen=True, slots=True)
class Objective:
    """The terms of the squared error."""

    admittance: BoundedQuotient  # the two terms of the loop
    tracking: BoundedQuotient
    couplings: Couplings  # the couplings, which give the third term
    omega: Floats | None  # frequencies of the error for norm "peak", rad/s; None for "rms"
    devices: int  # number of devices, whose terms follow one another; the objective is the greatest of their errors


def objective_of(problem: Problem, devices: Sequence[Device], intervals: int) -> Objective:
    """Return the terms of a problem's squared error as quotients, with methods that bound them over boxes."""
    wanted, kind, omega = problem.transparency, problem.device.kind, None
    weights, unit = wanted.weights, kind.reference(wanted.reference_impedance)
    scales = [(weights.admittance * unit) ** 2, weights.tracking**2]
    scales += [(weights.coupling / unit) ** 2] if kind.inverse else []
    if wanted.norm == "peak":
        omega = np.tile(np.geomspace(wanted.band.min, wanted.band.max, intervals), len(devices))
        every = repeated(devices, intervals)
        terms = _loop_terms(loop_at(every, omega), every)
        if kind.inverse:
            terms.append(_compliance(every.converted(decimal), Enclosure(omega), ENCLOSURES))
    else:
        each = [_integrated(one, wanted.band, intervals, [scale > 0 for scale in scales]) for one in devices]
        terms = [replaced(same[0], concatenated([listed(term) for term in same])) for same in zip(*each, strict=True)]
    admittance, tracking, *compliance = (
        BoundedQuotient(
            lower(quadratic(re_conj_product, term.along, term.along, crossed=True)), upper(term.size), scale
        )
        for term, scale in zip(terms, scales, strict=True)
    )
    couplings: Couplings = SeriesCouplings(problem, omega)
    if compliance:
        couplings = SpringDampers(problem, compliance[0], None if omega is not None else len(devices))
    return Objective(admittance, tracking, couplings, omega, len(devices))


def _loop_terms(at: LoopConstants, device: Device) -> list[Term]:
    crossed = device.velocity is not None
    return [error_term(term, crossed=crossed) for term in quotient_terms(at, device.kind)]


def _compliance(device: Device, omega: Number, ops: Arithmetic) -> Term:
    """Return |1/Z_c|^2 as a function of b_c and k_c, in the form s^2/(s^2 |Z_c|^2)."""
    theta = omega * device.sample_time
    _, (damped, crossed, stiff) = spring_forms(device, theta, ops)
    sin = ops.sin(theta / 2)
    size: Coefficients = (0 * sin, None, (damped, stiff), crossed)
    return Term(Affine(Pair(sin, 0), None, None), size)


def _integrated(device: Device, band: Band, intervals: int, wanted: list[bool]) -> list[Term]:
    """Return the terms of the mean over log frequency, with the inequality of Cauchy and Schwarz on each of several
    equal intervals."""
    exact, first = device_ball(device.bare), ball(band.min).log()
    length = ball(band.max).log() - first
    edges = [first + length * k / intervals for k in range(intervals + 1)]

    def of_loop(x: acb) -> list[Term]:
        return _loop_terms(loop_constants(device_response(exact, x.exp(), BALLS)), device)

    terms: list[Callable[[acb], Term]] = [lambda x: of_loop(x)[0], lambda x: of_loop(x)[1]]
    if device.kind.inverse:
        terms.append(lambda x: _compliance(exact, x.exp(), BALLS))

    def integral(integrand: Callable[[acb, bool], acb], k: int) -> arb:
        check_time()
        low, high = edges[k], edges[k + 1]
        throughout = integrand(acb(low.union(high)), True)
        if throughout == 0:
            return arb(0)
        # an absolute tolerance, because the integral may be 0
        size = float(throughout.abs_upper())
        tolerance = size * float(high - low) * PRECISION if size < inf else 0.0
        return acb.integral(integrand, low, high, rel_tol=PRECISION, abs_tol=tolerance).real / length

    def integrated(term: Callable[[acb], Term], counts: bool) -> Term:
        shape = term(acb(edges[0]))

        def row(index: int) -> Enclosure:
            if not counts:
                return Enclosure(np.ones(intervals), np.zeros(intervals))
            found = [integral(lambda x, _analytic: acb(listed(term(x))[index]), k) for k in range(intervals)]
            return Enclosure(*(np.array([float(f(x)) for x in found]) for f in (arb.mid, arb.rad)))

        return replaced(shape, [row(index) for index in range(len(listed(shape)))])

    with ctx.workprec(64), interrupt_deferred():  # Arb would replace an exception of the integrand by another one
        return [integrated(term, counts) for term, counts in zip(terms, wanted, strict=True)]
