"""Bound the coupling that a box of environments requires, over boxes of gains (design/bound/README.md, section 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from vctune.design.bound.couplings import SeriesOffer, elements_for
from vctune.design.bound.design_boxes import K_P, K_V, TAU_C, DesignBoxes
from vctune.design.bound.hands_bound import angles_of, coefficients_in_hands
from vctune.design.bound.quadratic_coefficients import Coefficients, joined, mapped, summed
from vctune.design.bound.quadratics import LeastQuotient, Quadratic, lower, upper
from vctune.model.device import Device
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.worlds import Worlds
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, Floats, decimal


@dataclass(frozen=True, slots=True)
class ConditionsInWorlds:
    """The constraint on the coupling with a box of environments, at some places of several devices."""

    offer: SeriesOffer  # resistance of the couplings at these places
    required: LeastQuotient  # R, the resistance that the loop requires of the coupling, N s/m
    kept: float  # b_1, the least damping of the environments, N s/m
    light_enough: Quadratic | None  # (m_2 (2/T) s^2 - k_1 (T/2) c^2) |F|^2 - c e/2
    reactive: LeastQuotient | None  # the least s c Im Z_c/g for which `below` is positive
    inertia: Floats  # (2/T) s^2 at each place

    def least_elements(self, boxes: DesignBoxes, factor: float) -> tuple[Floats, Floats, Flags]:
        """Return the least b_c and m_c at each place, shape (boxes, places), and the boxes that permit no coupling."""
        resistance = factor * (_least(self.required, boxes) - self.kept)
        first, second = elements_for(resistance, self.offer, boxes)
        if self.light_enough is not None:
            above_negative = self.light_enough.least(boxes) > 0
            first, second = np.where(above_negative, first, 0.0), np.where(above_negative, second, 0.0)
        if self.reactive is not None:
            reactance = factor * _least(self.reactive, boxes)
            b_c, m_c = (np.where(reactance > 0, reactance * x, 0.0) for x in self._elements_of_reactance(boxes))
            first, second = np.fmin(first, b_c), np.fmin(second, m_c)
        return first, second, np.zeros(len(boxes), bool)

    def _elements_of_reactance(self, boxes: DesignBoxes) -> tuple[Floats, Floats]:
        """Return the least b_c and the least m_c for s c Im Z_c = 1."""
        shortest, longest = (edge[TAU_C][:, None] for edge in (boxes.low, boxes.high))
        nearest, omega2 = np.clip(1 / self.offer.omega, shortest, longest), np.square(self.offer.omega)
        b_c, m_c = (1 + omega2 * np.square(nearest)) / nearest, 1 + omega2 * np.square(shortest)
        return b_c / self.inertia, m_c / self.inertia


def _least(quotient: LeastQuotient, boxes: DesignBoxes) -> Floats:
    middle = 0.5 * (boxes.low + boxes.high)
    K_v, K_p = middle[K_V][:, None], middle[K_P][:, None]
    return quotient.least(boxes, quotient.above.at(K_v, K_p) / quotient.below.at(K_v, K_p))


def conditions_in_worlds(devices: Sequence[Device], places: PlacesInHands, worlds: Worlds) -> ConditionsInWorlds:
    """Return the constraint on the coupling with a box of environments at some places, for each of several devices."""
    angles = [angles_of(device, places.at) for device in devices]
    each = [_at(device, theta, places, worlds) for device, theta in zip(devices, angles, strict=True)]
    lost, size, heavy, soft = (joined([found[k] for found in each]) for k in range(4))
    times = [device.sample_time for device in devices]
    rate = np.concatenate([np.full(theta.size, 2 / T) for theta, T in zip(angles, times, strict=True)])
    theta = np.concatenate(angles)
    above, below = upper(size), lower(size)
    return ConditionsInWorlds(
        SeriesOffer(np.tan(theta / 2) * rate),
        LeastQuotient(lower(lost), above, below),
        worlds.low.damping,
        lower(heavy) if worlds.high.mass < inf else None,
        LeastQuotient(lower(soft), above, below) if worlds.high.stiffness < inf else None,
        rate * np.square(np.sin(theta / 2)),
    )


def _at(device: Device, theta: Floats, places: PlacesInHands, worlds: Worlds) -> tuple[Coefficients, ...]:
    """Return the coefficients of four quadratics; an infinite m_2 or k_2 counts as 0."""
    lost, size, swing = coefficients_in_hands(device, theta, places.hands)
    half, T, ends = Enclosure(theta) / 2, decimal(device.sample_time), worlds.converted(decimal)
    sin, cos = ENCLOSURES.sin(half), ENCLOSURES.cos(half)
    inertia, compliance = sin * sin * (2 / T), cos * cos * (T / 2)
    turned = mapped(swing, lambda x: cos * x)
    greatest = 0.0 if worlds.high.mass == inf else ends.high.mass
    stiffest = 0.0 if worlds.high.stiffness == inf else ends.high.stiffness
    heavy, soft = greatest * inertia - ends.low.stiffness * compliance, stiffest * compliance - ends.low.mass * inertia
    of_heavy, of_soft = mapped(size, lambda x: heavy * x), mapped(size, lambda x: soft * x)
    return lost, size, summed(of_heavy, mapped(turned, lambda x: -x)), summed(of_soft, turned)
