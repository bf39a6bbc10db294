"""Relax a design problem, and compute from it lower bounds on the error of the designs of many boxes at once. See
model/README.md, section 8; README.md, section 1."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from vctune.design.bound.conditions import (
    Least,
    LlewellynConditions,
    SampledConditions,
    conditions_in_any_hand,
    conditions_in_hands,
    llewellyn_conditions,
    repeated,
)
from vctune.design.bound.objective import Objective
from vctune.design.bound.quadratics import B_0, GUARD, K_P, K_V, TAU_C, Quotient, products, quadratic
from vctune.model.device import Device
from vctune.model.hands import PlacesInHands
from vctune.model.loop.limits import lags
from vctune.model.loop.loop import Affine
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import re_conj_product
from vctune.model.problem import Problem, Range
from vctune.model.sampled.circle import split_delay
from vctune.model.sampled.velocity_loop import plant_let_go, return_difference
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import ENCLOSURES, Flags, Floats, decimal


@dataclass(frozen=True, slots=True)
class Places:
    """The places at which a relaxation imposes the constraints."""

    omega: Floats  # frequencies of the stability band for Llewellyn's conditions, rad/s
    sensitivity: Floats  # frequencies up to Nyquist for the limit on |S|, rad/s
    in_hands: PlacesInHands = field(default_factory=lambda: PlacesInHands.of(()))
    any_hand: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """The number of places for each of the constraints on the coupling, and for |S|."""
        return len(self.omega), len(self.in_hands), len(self.any_hand), len(self.sensitivity)

    def joined(self, more: Places) -> Places:
        """Return the union of these places and others, in ascending order and without duplicates."""
        return Places(
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
    places: Places
    conditions: list[LlewellynConditions | SampledConditions]  # constraints on the coupling
    sensitivity: Quotient  # |S|^2 of the sampled loop of each device
    objective: Objective  # the terms of the squared error


def relaxation(problem: Problem, devices: list[Device], places: Places, objective: Objective) -> Relaxation:
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
