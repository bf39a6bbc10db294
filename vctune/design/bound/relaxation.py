"""Relax a design problem: lower bounds of the error of the designs of many boxes at once (README.md, section 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, log

import numpy as np

from vctune.design.bound.conditions import (
    Least,
    LlewellynConditions,
    SampledConditions,
    conditions_in_any_hand,
    conditions_in_hands,
    llewellyn_conditions,
    loop_at,
    repeated,
)
from vctune.design.bound.quadratics import B_0, GUARD, K_P, K_V, TAU_C, Quotient, concatenated, products, quadratic
from vctune.model.device import Device
from vctune.model.hands import PlacesInHands
from vctune.model.loop.device_response import device_response
from vctune.model.loop.limits import lags
from vctune.model.loop.loop import Affine, LoopConstants, loop_constants
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.pair import Pair, im_conj_product, re_conj_product
from vctune.model.problem import Band, Problem, Range
from vctune.model.sampled.circle import split_delay
from vctune.model.sampled.impedance_display import spring_forms
from vctune.model.sampled.velocity_loop import plant_let_go, return_difference
from vctune.model.transparency import quotient_terms
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, Floats, between, decimal, stacked
from vctune.proof.enclosures.taylor import Taylor, variables
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.running import check_time

PARTS = 256  # Parts of an interval of log frequency, in each of which a polynomial of order two encloses a term

# A term |X|^2/|Y|^2 of the squared error, prepared for the inequality of Cauchy and Schwarz: Re and Im of the three
# coefficients of X conj X_0, where X_0 is the value of X if both gains are 0, and the six of |X_0|^2 |Y|^2
Term = list[Number]
TERM_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Objective:
    """The terms of the squared error: quotients for each frequency or interval of one device after another."""

    problem: Problem  # problem in SI units
    loop: list[Quotient]  # the two terms of the loop
    compliance: Quotient | None  # |1/Z_c|^2 of an impedance display's coupling as a function of b_c and k_c
    omega: Floats | None  # frequencies of the error for norm "peak", rad/s; None for "rms"
    devices: int  # number of devices; the objective is the greatest of their errors

    def least(self, first: Floats, second: Floats, boxes: Cells) -> Floats:
        """Return a lower bound of the squared error over each box, from the least elements of its couplings."""
        squared = self._total(self.loop[0].of_bounds(boxes) + self.loop[1].of_bounds(boxes))
        return np.asarray((squared + self._coupling(first, second, boxes)).max(axis=1))

    def _total(self, squared: Floats) -> Floats:
        return squared if self.omega is not None else squared.reshape(len(squared), self.devices, -1).sum(axis=2)

    def _coupling(self, first: Floats, second: Floats, boxes: Cells) -> Floats:
        """Return the term of the coupling: |1/Z_c|^2, or |Z_c|^2 = b_0^2 + 2 b_0 b_c s + b_c^2 s."""
        shortest, longest = boxes.low[TAU_C], boxes.high[TAU_C]
        if self.compliance is not None:
            b_c = 1 / second
            most = np.stack((b_c, np.fmin(1 / first, b_c / shortest))) * (1 + 4 * GUARD)
            return self._total(self.compliance.of_bounds(Cells(0 * most, most)))
        b_c, m_c, b_0, shortest, longest = (x[:, None] for x in (first, second, boxes.low[B_0], shortest, longest))
        light, heavy = self._transmitted(shortest), self._transmitted(longest)
        coupled = 2 * b_0 * b_c * light + np.fmax(np.square(b_c) * light, np.square(m_c / longest) * heavy)
        wanted = self.problem.transparency
        return np.asarray((self.problem.weights.coupling / wanted.reference_impedance) ** 2 * (b_0 * b_0 + coupled))

    def _transmitted(self, tau_c: Floats) -> Floats:
        """Return x^2/(1 + x^2), which is |Z_c/b_c|^2 and Re Z_c/b_c without drag, or its mean over log frequency."""
        if self.omega is not None:
            x2 = np.square(self.omega * tau_c)
            return np.asarray(x2 / (1 + x2))
        low, high = self.problem.transparency.band.min, self.problem.transparency.band.max
        rise = (high - low) * (high + low) * np.square(tau_c) / (1 + np.square(low * tau_c))
        return np.asarray(np.log1p(rise) / (2 * log(high / low)) * (1 - GUARD * high / (high - low)))


def objective_of(problem: Problem, devices: Sequence[Device], intervals: int) -> Objective:
    """Return the terms of a problem's squared error as quotients, with methods that bound them over boxes."""
    wanted, kind, omega = problem.transparency, problem.device.kind, None
    weights, unit = problem.weights, kind.reference(wanted.reference_impedance)
    scales = [(weights.admittance * unit) ** 2, weights.tracking**2]
    scales += [(weights.coupling / unit) ** 2] if kind.inverse else []
    if wanted.norm == "peak":
        omega = np.tile(np.geomspace(wanted.band.min, wanted.band.max, intervals), len(devices))
        every = repeated(devices, intervals)
        found = _loop_terms(loop_at(every, omega), every)
        if kind.inverse:
            found.append(_compliance(every.converted(decimal), Enclosure(omega), ENCLOSURES))
        terms = [stacked(term) for term in found]
    else:
        each = [_integrated(one, wanted.band, intervals, [scale > 0 for scale in scales]) for one in devices]
        terms = [concatenated(same) for same in zip(*each, strict=True)]
    admittance, tracking, *rest = map(_quotient, terms, scales)
    return Objective(problem, [admittance, tracking], rest[0] if rest else None, omega, len(devices))


def _quotient(term: Enclosure, scale: float) -> Quotient:
    pairs = ((term[k], term[k + 1]) for k in (0, 2, 4))
    along = Affine(*(Pair(re, im) if np.any(re.mid) or np.any(im.mid) else None for re, im in pairs))
    above = products(lambda x, y: scale * re_conj_product(x, y), along, along)  # `of_bounds` covers the rounding
    return Quotient(quadratic(above), quadratic(term[6:]))


def _loop_terms(at: LoopConstants, device: Device) -> list[Term]:
    found = []
    for X, Y in quotient_terms(at, device.kind):
        idle, weight = X.constant, X.constant.abs2()
        parts = (x for x in (X.velocity, X.position))
        along = [0.0 if x is None else of(x, idle) for x in parts for of in (re_conj_product, im_conj_product)]
        size = products(lambda x, y, k=weight: k * re_conj_product(x, y), Y, Y, crossed=device.velocity is not None)
        found.append([weight, 0.0, *along, *size])
    return found


def _compliance(device: Device, omega: Number, ops: Arithmetic) -> Term:
    """Return |1/Z_c|^2 as a function of b_c and k_c, in the form s^2/(s^2 |Z_c|^2)."""
    theta = omega * device.sample_time
    _, (damped, crossed, stiff) = spring_forms(device, theta, ops)
    return [ops.sin(theta / 2), *[0.0] * 5, 0.0, 0.0, 0.0, damped, stiff, crossed]


def _integrated(device: Device, band: Band, intervals: int, wanted: list[bool]) -> list[Enclosure]:
    """Return the means of the terms over log frequency, each an enclosure of shape (`TERM_LENGTH`, intervals), with the
    inequality of Cauchy and Schwarz on each of several equal intervals."""
    check_time()
    edges = np.linspace(log(band.min), log(band.max), intervals * PARTS + 1)
    (at,) = variables([between(edges[:-1], edges[1:])], [True])
    exact, omega = device.bare.converted(decimal), TAYLOR.exp(at)

    def mean(x: Number) -> Enclosure:
        """Return the share of each interval in the mean of a number, c_0 + c_1 e + c_2 e^2 over a part, |e| <= 1."""
        if not isinstance(x, Taylor):
            return Enclosure(np.full(intervals, float(x) / intervals))
        mid, rad = x.coefficients[0] + x.coefficients[2] / 3, x.radii.sum(axis=0)
        parts = mid, rad + GUARD * np.abs(x.coefficients).sum(axis=0)
        return Enclosure(*(each.reshape(intervals, PARTS).sum(axis=1) / (intervals * PARTS) for each in parts))

    terms = _loop_terms(loop_constants(device_response(exact, omega, TAYLOR)), device)
    if device.kind.inverse:
        terms.append(_compliance(exact, omega, TAYLOR))
    one = Enclosure(np.ones((TERM_LENGTH, intervals)), np.zeros((TERM_LENGTH, intervals)))
    return [stacked([mean(x) for x in term]) if counts else one for term, counts in zip(terms, wanted, strict=True)]


@dataclass(frozen=True, slots=True)
class ImposedPlaces:
    """The places at which a relaxation imposes the constraints."""

    omega: Floats  # frequencies of the stability band for Llewellyn's conditions, rad/s
    sensitivity: Floats  # frequencies up to Nyquist for the limit on |S|, rad/s
    in_hands: PlacesInHands = field(default_factory=lambda: PlacesInHands.of(()))
    any_hand: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """The number of places for each of the constraints on the coupling, and for |S|."""
        return len(self.omega), len(self.in_hands), len(self.any_hand), len(self.sensitivity)

    def joined(self, more: ImposedPlaces) -> ImposedPlaces:
        """Return the union of these places and others, in ascending order and without duplicates."""
        return ImposedPlaces(
            np.union1d(self.omega, more.omega),
            np.union1d(self.sensitivity, more.sensitivity),
            self.in_hands.joined(more.in_hands).unique,
            np.union1d(self.any_hand, more.any_hand),
        )


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A relaxed design problem: fewer frequencies, and bounds instead of values."""

    problem: Problem  # the problem
    devices: list[Device]  # devices and places for which the relaxation imposes the constraints
    places: ImposedPlaces
    conditions: list[LlewellynConditions | SampledConditions]  # constraints on the coupling
    sensitivity: Quotient  # |S|^2 of the sampled loop of each device
    objective: Objective  # the terms of the squared error


def relaxation(problem: Problem, devices: list[Device], places: ImposedPlaces, objective: Objective) -> Relaxation:
    """Relax a problem: impose its constraints at some places only, and bound the terms of its error from below."""
    found: list[LlewellynConditions | SampledConditions] = []
    if problem.passive:
        found.append(llewellyn_conditions(devices, places.omega))
    if problem.hands_met is not None:
        worlds = None if problem.worlds is None else problem.worlds.linear
        found.append(conditions_in_hands(devices, places.in_hands, worlds))
    if problem.any_hand:
        found.append(conditions_in_any_hand(devices, places.any_hand))
    return Relaxation(problem, devices, places, found, _sensitivity(devices, places.sensitivity), objective)


def _sensitivity(devices: list[Device], upto: Floats) -> Quotient:
    """Return |F_0|^2/|F|^2 of the sampled loop. F is affine in the gains, so |F|^2 is convex in them."""
    device, omega = repeated(devices, len(upto)), np.tile(upto, len(devices))
    whole, fraction = split_delay(device.delay, device.sample_time)
    exact = device.bare.converted(decimal)
    plant = plant_let_go(exact, whole, ENCLOSURES, fractional=bool(np.any(fraction)))
    F = return_difference(plant, exact.sample_time * omega, ENCLOSURES, position=True)
    loop, open_loop = Affine(F.open, F.velocity, F.position), Affine(F.open)
    return Quotient(*(quadratic(products(re_conj_product, each, each)) for each in (open_loop, loop)))


@np.errstate(all="ignore")
def lower_bounds(relaxed: Relaxation, boxes: Cells) -> tuple[Floats, Floats]:
    """Return lower bounds of the error of the feasible designs in each box, shape (boxes,), inf if none is feasible;
    and of the greatest of |S| and the coupling's elements, each divided by its limit."""
    problem, (first, second, none) = relaxed.problem, least_coupling(relaxed, boxes)
    S = np.sqrt(relaxed.sensitivity.of_bounds(boxes).max(axis=1))
    excess = S / problem.stability.max_sensitivity * (1 - GUARD)
    for element, range_ in zip((first, second), _element_ranges(problem), strict=True):
        excess = np.fmax(excess, element / range_.max)
    none = none | (excess > 1 + 4 * GUARD) | ((boxes.low[K_P] > 0) & without_integrator(problem, boxes))
    squared = np.nan_to_num(relaxed.objective.least(first, second, boxes), nan=0.0, posinf=0.0)
    return np.where(none, inf, np.sqrt(squared) * (1 - 10 * GUARD)), np.where(none, inf, excess)


@np.errstate(all="ignore")
def least_coupling(relaxed: Relaxation, boxes: Cells) -> Least:
    """Return the least elements of the coupling that the conditions and the bounds permit in each box, and the boxes
    that permit no coupling; see `Least`."""
    one, other = _element_ranges(relaxed.problem)
    lowest, highest = boxes.low[TAU_C], boxes.high[TAU_C]  # of the ratio of the second element to the first
    if relaxed.problem.device.kind.inverse:
        lowest, highest = 1 / highest, 1 / lowest
    first, second, none = (
        np.fmax(one.min, other.min / highest),
        np.full(len(boxes), other.min),
        np.zeros(len(boxes), bool),
    )
    for condition in relaxed.conditions:
        b, m, never = condition.least_elements(boxes, relaxed.problem.stability.safety_factor)
        first, second, none = np.maximum(first, b.max(axis=1)), np.maximum(second, m.max(axis=1)), none | never
    second = np.maximum(second, first * lowest)
    return first * (1 - 10 * GUARD), second * (1 - 10 * GUARD), none


def _element_ranges(problem: Problem) -> tuple[Range, Range]:
    """Return the bounds of b_c and m_c; for an impedance display those of 1/k_c and 1/b_c."""
    if not problem.device.kind.inverse:
        return problem.bounds.damping, problem.bounds.mass
    k_c, b_c = (
        Range(*(1 / end if end > 0 else inf for end in (of.max, of.min)))
        for of in (problem.bounds.stiffness, problem.bounds.damping)
    )
    return k_c, b_c


def without_integrator(problem: Problem, boxes: Cells) -> Flags:
    """Return the boxes in which no feasible design has K_p > 0, because b_0 lies below R at omega = 0."""
    device = problem.device
    beyond = device.structure is not None or (device.operator is not None and not device.ideal)
    if not problem.passive or problem.stability.band.min > 0 or beyond:
        return np.zeros(len(boxes), bool)
    late, gripped = lags(device, FLOATS), device.least_damping
    b = device.damping + boxes.low[K_P] * late.sensor * (1 - GUARD)
    b_h, factor = gripped - device.damping, problem.stability.safety_factor
    most = (gripped + boxes.high[K_V]) * (1 + GUARD) - late.drive * boxes.low[K_P] * (1 - GUARD)
    eased = 4 * (most * boxes.high[B_0] + factor * b_h * np.maximum(most - gripped, 0.0))
    return (most < 0) | (eased < factor * b * b * (1 - 10 * GUARD))
