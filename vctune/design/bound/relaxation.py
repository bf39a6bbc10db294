"""A design problem made easier, so that boxes of designs can be judged at once.

See model/README.md, section 8; design/bound/README.md, section 1.

C and D are affine in the gains (`vctune.model.affine.LoopConstants`), so that |D|^2, |C|^2, P = Re(C conj D) and the
loop's resistance are quadratic in them, and take their greatest values over a box of gains at a vertex where they are
convex. With the least |Im(C conj D)| they bound R from below. Any set of frequencies will do, for the demands can only
be harder on the whole band. With X_0 what X is without gains, the mean of |X|^2/|D|^2 over an interval is at least
(integral of Re(X conj X_0))^2 / (integral of |X_0|^2 |D|^2) (Cauchy and Schwarz), where the integrals are of known
functions, enclosed by Arb; the former is affine in the gains, and least at a vertex.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np
from flint import acb, arb, ctx

from vctune.design.bound.boxes import DesignBoxes
from vctune.design.bound.coefficients import (
    Coefficients,
    Term,
    concatenated,
    error_term,
    listed,
    mapped,
    quadratic,
    replaced,
)
from vctune.design.bound.hands import ConditionsInHands, conditions_in_hands
from vctune.design.bound.quadratics import GUARD, Quadratic, lower, rounded_down, upper
from vctune.interrupt import interrupt_deferred
from vctune.model.affine import Affine, LoopConstants, loop_constants
from vctune.model.device_response import device_response
from vctune.model.pair import im_conj_product, re_conj_product
from vctune.model.problem import Problem
from vctune.model.quantities import Device, stacked
from vctune.model.sampled import return_difference, sampled_plant, split_delay
from vctune.proof.arb_balls import BALLS, ball, device_ball
from vctune.proof.array_intervals import Enclosure, Floats, decimal
from vctune.proof.jets import ENCLOSURES

PRECISION = 2.0**-44
"""Of the integrals, relative: 6e-14, of the size of `GUARD`. Half and twice it change the bound by as much, and the
time by one of Gauss's nodes."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """Llewellyn's conditions at some frequencies.

    Attributes
    ----------
    omega : rad/s, those of one device after another
    D2, C2, P, resistance : |D|^2, |C|^2, Re(C conj D) and the loop's resistance, rounded up
    operator_relief : 2 b_h Re(C conj N), rounded up; None without an operator
    D2_low, C2_low : rounded down
    im_low, im_high : Im(C conj D), rounded down and up
    """

    omega: Floats
    D2: Quadratic
    C2: Quadratic
    P: Quadratic
    resistance: Quadratic
    operator_relief: Quadratic | None
    D2_low: Quadratic
    C2_low: Quadratic
    im_low: Quadratic
    im_high: Quadratic


@dataclass(frozen=True, slots=True)
class BoundedQuotient:
    """A quotient of quadratics in the gains at several points: a term of the squared error, or |S|^2.

    A point is a frequency, or an interval over which the term is averaged.

    Attributes
    ----------
    root : the numerator's root, rounded down: Re(X conj X_0) of what is X_0 with both gains 0
    D2 : upper bounds, weighted with |X_0|^2
    scale : of the quotient, rounded down
    """

    root: Quadratic
    D2: Quadratic
    scale: float = 1.0

    def least(self, boxes: DesignBoxes) -> Floats:
        """Return a lower bound over each box of gains, shape (boxes, points)."""
        root = np.maximum(self.root.least(boxes), 0.0)
        bound: Floats = np.square(root) * (self.scale * (1 - GUARD)) / self.D2.greatest(boxes)
        return bound


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A design problem made easier: fewer frequencies, and bounds in place of values.

    Attributes
    ----------
    problem : the problem
    devices, places : at which the demands are posed
    conditions, in_hands : on the coupling, with any passive hand on the band, and in hands; None where not demanded
    sensitivity : |S|^2 of the sampled loop; for an uncertain device the demands are posed at each vertex of its box too
    admittance, tracking : terms of the squared error
    omega : rad/s, where the error is looked at for norm "peak"; None for "rms"
    n_objective_devices : number of devices the greatest of whose errors is the objective; their terms follow one
        another
    """

    problem: Problem
    devices: list[Device]
    places: Places
    conditions: Conditions | None
    in_hands: ConditionsInHands | None
    sensitivity: BoundedQuotient
    admittance: BoundedQuotient
    tracking: BoundedQuotient
    omega: Floats | None
    n_objective_devices: int


@dataclass(frozen=True, slots=True)
class Places:
    """Where a relaxation knows the demands.

    Attributes
    ----------
    omega : rad/s, frequencies of the stability band
    sensitivity : rad/s, frequencies up to Nyquist
    in_hands : those and the numbers of a hand, shape (4, any number)
    """

    omega: Floats
    sensitivity: Floats
    in_hands: Floats = field(default_factory=lambda: np.zeros((4, 0)))

    @property
    def number(self) -> int:
        """How many there are."""
        return len(self.omega) + len(self.sensitivity) + self.in_hands.shape[1]

    def joined(self, more: Places) -> Places:
        """Return these and others, each once and in order."""
        return Places(
            np.union1d(self.omega, more.omega),
            np.union1d(self.sensitivity, more.sensitivity),
            np.unique(np.hstack((self.in_hands, more.in_hands)), axis=1),
        )


def relaxation(
    problem: Problem, devices: list[Device], objective: list[Device], places: Places, intervals: int
) -> Relaxation:
    """Relax a problem.

    Parameters
    ----------
    problem : Problem
    devices : at which the demands are posed
    objective : those of them the greatest of whose errors is the objective
    places : where the demands are posed
    intervals : into how many, or at how many frequencies, the transparency band is divided
    """
    band, weights = problem.transparency.band, problem.transparency.weights
    crossed = problem.device.velocity is not None
    if problem.transparency.norm == "peak":
        omega_e = np.tile(np.geomspace(band.min, band.max, intervals), len(objective))
        at_nodes = _enclosed(_repeated(objective, intervals), omega_e)
        parts = [error_term(at_nodes, X, crossed=crossed) for X in (at_nodes.numerator, at_nodes.miss)]
    else:
        omega_e = None
        each = [_integrated(device, band.min, band.max, intervals, crossed=crossed) for device in objective]
        parts = [concatenated(terms) for terms in zip(*each, strict=True)]
    scales = (weights.admittance * problem.transparency.reference_impedance) ** 2, weights.tracking**2
    admittance, tracking = (
        BoundedQuotient(lower(root), upper(D2), scale) for (root, D2), scale in zip(parts, scales, strict=True)
    )
    demands = _demands(problem, devices, places)
    return Relaxation(problem, devices, places, *demands, admittance, tracking, omega_e, len(objective))


def at_places(relaxed: Relaxation, places: Places) -> Relaxation:
    """Return the relaxation with its demands at other places, on each device; the error's terms are as they were."""
    conditions, in_hands, sensitivity = _demands(relaxed.problem, relaxed.devices, places)
    return replace(relaxed, places=places, conditions=conditions, in_hands=in_hands, sensitivity=sensitivity)


def _demands(
    problem: Problem, devices: list[Device], places: Places
) -> tuple[Conditions | None, ConditionsInHands | None, BoundedQuotient]:
    return (
        _conditions(*_everywhere(devices, places.omega)) if problem.passive else None,
        conditions_in_hands(devices, places.in_hands) if problem.hands_met is not None else None,
        _sensitivity(*_everywhere(devices, places.sensitivity)),
    )


def _everywhere(devices: list[Device], omega: Floats) -> tuple[Device, Floats]:
    """Return devices as one, and every frequency for each of them."""
    return _repeated(devices, len(omega)), np.tile(omega, len(devices))


def _repeated(devices: list[Device], count: int) -> Device:
    """Return devices as one whose numbers are arrays, each repeated so often; a single one as it is."""
    if len(devices) == 1:
        return devices[0]
    return stacked([device for device in devices for _ in range(count)])


def _enclosed(device: Device, omega: Floats) -> LoopConstants:
    return loop_constants(device_response(device.bare.converted(decimal), Enclosure(omega), ENCLOSURES))


def _conditions(device: Device, omega: Floats) -> Conditions:
    at, crossed = _enclosed(device, omega), device.velocity is not None
    C2, D2 = (quadratic(re_conj_product, part, part, crossed=crossed) for part in (at.C, at.D))
    im = quadratic(im_conj_product, at.C, at.D, crossed=crossed)
    if device.ideal:  # C against itself contributes nothing, but rounding
        im = im[0], im[1], None, None
    return Conditions(
        omega,
        upper(D2),
        upper(C2),
        upper(quadratic(re_conj_product, at.C, at.D, crossed=crossed)),
        upper(_resistance(device, at, omega, crossed=crossed)),
        _relief(device, at, crossed=crossed),
        lower(D2),
        lower(C2),
        lower(im),
        upper(im),
    )


def _resistance(device: Device, at: LoopConstants, omega: Floats, *, crossed: bool) -> Coefficients:
    """Return Re W + Re y |W|^2 + b_h |N|^2."""
    W, exact = at.motor, device.converted(decimal)
    assert W.constant is not None and W.velocity is not None and W.position is not None
    constant, square, cross = 0 * Enclosure(omega) + W.constant.re, None, None
    linear = W.velocity.re, W.position.re
    spring = device_response(exact.bare, Enclosure(omega), ENCLOSURES).spring
    added = [] if spring is None else [(Enclosure(omega) * Enclosure(omega) * spring.y_c, W)]
    if exact.operator is not None:
        if spring is None:
            constant = constant + exact.operator.damping
        else:
            added.append((exact.operator.damping, at.numerator))
    for factor, part in added:
        more, linears, squares, crosses = quadratic(re_conj_product, part, part, crossed=crossed)
        assert linears is not None and squares is not None
        constant, linear = constant + factor * more, (linear[0] + factor * linears[0], linear[1] + factor * linears[1])
        more_square = factor * squares[0], factor * squares[1]
        square = more_square if square is None else (square[0] + more_square[0], square[1] + more_square[1])
        if crosses is not None:
            cross = factor * crosses if cross is None else cross + factor * crosses
    return constant, linear, square, cross


def _relief(device: Device, at: LoopConstants, *, crossed: bool) -> Quadratic | None:
    """Return 2 b_h Re(C conj N)."""
    if device.operator is None:
        return None
    b_h = decimal(device.operator.damping)
    relief = quadratic(re_conj_product, at.C, at.numerator, crossed=crossed)
    return upper(mapped(relief, lambda x: b_h * x), 2)


def _sensitivity(device: Device, omega: Floats) -> BoundedQuotient:
    """Return |F_0|^2/|F|^2 of the sampled loop; F is affine in the gains, so that |F|^2 is convex in them."""
    whole, fraction = split_delay(device.delay, device.sample_time)
    exact = device.bare.converted(decimal)
    plant = sampled_plant(exact, whole, ENCLOSURES, fractional=bool(np.any(fraction)))
    F = return_difference(plant, exact.sample_time * omega, ENCLOSURES, position=True)
    loop = Affine(F.open, F.velocity, F.position)
    root = F.open.abs2().sqrt()
    return BoundedQuotient(Quadratic(rounded_down(root)), upper(quadratic(re_conj_product, loop, loop, crossed=True)))


def _integrated(device: Device, low: float, high: float, intervals: int, *, crossed: bool) -> tuple[Term, Term]:
    """Return the terms of the mean over log frequency, by Cauchy and Schwarz on each of several equal intervals."""
    exact = device_ball(device.bare)
    first, length = ball(low).log(), ball(high).log() - ball(low).log()
    edges = [first + length * k / intervals for k in range(intervals + 1)]

    def coefficients(x: acb, which: str) -> list[acb]:
        at = loop_constants(device_response(exact, x.exp(), BALLS))
        return listed(error_term(at, getattr(at, which), crossed=crossed))

    def integral(which: str, index: int, k: int) -> arb:
        def integrand(x: acb, _analytic: bool) -> acb:
            return coefficients(x, which)[index]

        low, high = edges[k], edges[k + 1]
        throughout = integrand(acb(low.union(high)), True)
        if throughout == 0:
            return arb(0)
        # relative to the integrand, not to its integral, which may be 0
        size = float(throughout.abs_upper())
        tolerance = size * float(high - low) * PRECISION if size < inf else 0.0
        return acb.integral(integrand, low, high, rel_tol=PRECISION, abs_tol=tolerance).real / length

    def term(which: str) -> Term:
        middle = loop_constants(device_response(exact, acb(edges[0]).exp(), BALLS))
        shape = error_term(middle, getattr(middle, which), crossed=crossed)
        rows = [[integral(which, index, k) for k in range(intervals)] for index in range(len(listed(shape)))]
        found = (Enclosure(*(np.array([float(f(x)) for x in row]) for f in (arb.mid, arb.rad))) for row in rows)
        return replaced(shape, found)

    with ctx.workprec(64), interrupt_deferred():  # an exception within Arb's integrand becomes one of another name
        return term("numerator"), term("miss")
