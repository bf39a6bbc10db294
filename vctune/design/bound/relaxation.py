"""Relax a design problem, so that many boxes of designs can be bounded at once. See model/README.md, section 8;
design/bound/README.md, section 1."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from vctune.design.bound.design_boxes import DesignBoxes
from vctune.design.bound.hands_bound import conditions_in_any_hand, conditions_in_hands
from vctune.design.bound.llewellyn_bound import llewellyn_conditions
from vctune.design.bound.objective import Objective, objective_of
from vctune.design.bound.quadratic_coefficients import quadratic, repeated
from vctune.design.bound.quadratics import BoundedQuotient, Quadratic, rounded_down, upper
from vctune.design.bound.worlds_bound import conditions_in_worlds
from vctune.model.device import Device
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.loop.loop import Affine
from vctune.model.numbers.pair import re_conj_product
from vctune.model.problem import Problem
from vctune.model.sampled.velocity_loop import return_difference, sampled_plant, split_delay
from vctune.proof.enclosures.intervals import ENCLOSURES, Flags, Floats, decimal


class Conditions(Protocol):
    """A constraint on the coupling at some places of several devices, one device after another."""

    def least_elements(self, boxes: DesignBoxes, factor: float) -> tuple[Floats, Floats, Flags]:
        """Return the least elements of the coupling, each of shape (boxes, places), and the boxes that permit no
        coupling."""


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A relaxed design problem: fewer frequencies, and bounds instead of values."""

    problem: Problem  # the problem
    devices: list[Device]  # devices and places for which the relaxation imposes the constraints
    places: Places
    conditions: list[Conditions]  # constraints on the coupling
    sensitivity: BoundedQuotient  # |S|^2 of the sampled loop of each device
    objective: Objective  # the terms of the squared error


@dataclass(frozen=True, slots=True)
class Places:
    """The places at which a relaxation imposes the constraints."""

    omega: Floats  # frequencies of the stability band for Llewellyn's conditions, rad/s
    sensitivity: Floats  # frequencies up to Nyquist for the limit on |S|, rad/s
    in_hands: PlacesInHands = field(default_factory=lambda: PlacesInHands.of(()))
    any_hand: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def most(self) -> int:
        """The greatest number of places for one of the constraints on the coupling."""
        return max(len(self.omega), len(self.in_hands), len(self.any_hand))

    @property
    def number(self) -> int:
        """The total number of places."""
        return len(self.omega) + len(self.sensitivity) + len(self.in_hands) + len(self.any_hand)

    def joined(self, more: Places) -> Places:
        """Return the union of these places and others, in ascending order and without duplicates."""
        return Places(
            np.union1d(self.omega, more.omega),
            np.union1d(self.sensitivity, more.sensitivity),
            self.in_hands.joined(more.in_hands).unique,
            np.union1d(self.any_hand, more.any_hand),
        )


def relaxation(
    problem: Problem, devices: list[Device], objective: list[Device], places: Places, intervals: int
) -> Relaxation:
    """Relax a problem: impose its constraints at some places only, and bound the terms of its error from below."""
    terms = objective_of(problem, objective, intervals)
    return Relaxation(
        problem,
        devices,
        places,
        _conditions(problem, devices, places),
        _sensitivity(devices, places.sensitivity),
        terms,
    )


def at_places(relaxed: Relaxation, places: Places) -> Relaxation:
    """Return a relaxation with the constraints at other places, and with the same terms of the error."""
    problem, devices = relaxed.problem, relaxed.devices
    return replace(
        relaxed,
        places=places,
        conditions=_conditions(problem, devices, places),
        sensitivity=_sensitivity(devices, places.sensitivity),
    )


def _conditions(problem: Problem, devices: list[Device], places: Places) -> list[Conditions]:
    found: list[Conditions] = []
    if problem.passive:
        found.append(llewellyn_conditions(devices, places.omega))
    if problem.hands_met is not None and problem.worlds is None:
        found.append(conditions_in_hands(devices, places.in_hands))
    if problem.hands_met is not None and problem.worlds is not None:
        found.append(conditions_in_worlds(devices, places.in_hands, problem.worlds.linear))
    if problem.any_hand:
        found.append(conditions_in_any_hand(devices, places.any_hand))
    return found


def _sensitivity(devices: list[Device], upto: Floats) -> BoundedQuotient:
    """Return |F_0|^2/|F|^2 of the sampled loop. F is affine in the gains, so |F|^2 is convex in them."""
    device, omega = repeated(devices, len(upto)), np.tile(upto, len(devices))
    whole, fraction = split_delay(device.delay, device.sample_time)
    exact = device.bare.converted(decimal)
    plant = sampled_plant(exact, whole, ENCLOSURES, fractional=bool(np.any(fraction)))
    F = return_difference(plant, exact.sample_time * omega, ENCLOSURES, position=True)
    loop = Affine(F.open, F.velocity, F.position)
    size = upper(quadratic(re_conj_product, loop, loop, crossed=True))
    return BoundedQuotient(Quadratic(rounded_down(F.open.abs2())), size)
