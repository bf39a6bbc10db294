"""Bound R in hands in the sampled loop from below, over boxes of gains (design/bound/README.md, section 1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vctune.design.bound.couplings import Offer, SeriesOffer, elements_for, spring_offer
from vctune.design.bound.design_boxes import K_P, K_V, DesignBoxes
from vctune.design.bound.quadratic_coefficients import Coefficients, joined, mapped, quadratic
from vctune.design.bound.quadratics import LeastQuotient, lower, upper
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.hands import Hand
from vctune.model.loop.loop import Affine
from vctune.model.numbers.pair import EvenOdd, Pair, im_conj_product, re_conj_product
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import CommandInHand, LoopInHand, loop_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, Floats, decimal

NO_GAINS = Gains(0.0, 0.0)  # Gains with which the code evaluates the parts of a loop that do not depend on the gains


@dataclass(frozen=True, slots=True)
class SampledConditions:
    """The constraint on the coupling in the sampled loop at some places of several devices, one device after
    another."""

    offer: Offer  # resistance of the couplings at these places
    required: LeastQuotient  # R, the resistance that the loop requires of the coupling; for an impedance display R/s^2

    def least_elements(self, boxes: DesignBoxes, factor: float) -> tuple[Floats, Floats, Flags]:
        """Return the least elements of the coupling at each place, and the boxes that permit no coupling."""
        R, none = self.least_required(boxes)
        return *elements_for(factor * R, self.offer, boxes), none

    def least_required(self, boxes: DesignBoxes) -> tuple[Floats, Flags]:
        """Return a lower bound of R, at least 0, shape (boxes, places), and the boxes that permit no coupling."""
        middle = 0.5 * (boxes.low + boxes.high)
        K_v, K_p = middle[K_V][:, None], middle[K_P][:, None]
        guess = self.required.above.at(K_v, K_p) / self.required.below.at(K_v, K_p)
        none = (self.required.below.greatest(boxes) < 0).any(axis=1)
        return self.required.least(boxes, guess), np.asarray(none)


def conditions_in_hands(devices: Sequence[Device], places: PlacesInHands) -> SampledConditions:
    """Return the constraint on the coupling in hands at some places, for each of several devices."""
    angles = [angles_of(device, places.at) for device in devices]
    each = [
        coefficients_in_hands(device, theta, places.hands)[:2] for device, theta in zip(devices, angles, strict=True)
    ]
    return _conditions(devices, angles, each)


def conditions_in_any_hand(devices: Sequence[Device], omega: Floats) -> SampledConditions:
    """Return the constraint on the coupling in any passive hand, for each of several impedance displays."""
    angles = [angles_of(device, omega) for device in devices]
    each = [_in_any_hand(device, theta) for device, theta in zip(devices, angles, strict=True)]
    return _conditions(devices, angles, each)


def angles_of(device: Device, omega: Floats) -> Floats:
    """Return the angles omega T, at most pi."""
    return np.minimum(omega * device.sample_time, np.pi)


def _conditions(
    devices: Sequence[Device], angles: list[Floats], each: list[tuple[Coefficients, Coefficients]]
) -> SampledConditions:
    """Return the constraint on the coupling from the coefficients of R's numerator and denominator for each device."""
    lost, size = (joined([coefficients[k] for coefficients in each]) for k in (0, 1))
    offer: Offer
    if devices[0].kind.inverse:
        offer = spring_offer(devices, angles)
    else:
        pairs = zip(devices, angles, strict=True)
        offer = SeriesOffer(np.concatenate([np.tan(theta / 2) * (2 / device.sample_time) for device, theta in pairs]))
    return SampledConditions(offer, LeastQuotient(lower(lost), upper(size), lower(size)))


def coefficients_in_hands(
    device: Device, theta: Floats, hands: Hand
) -> tuple[Coefficients, Coefficients, Coefficients]:
    """Return the coefficients of -o/2, |F|^2 and e/2 as quadratics in the gains (model/README.md, section 14)."""
    plant = plant_in_hand(device.bare.converted(decimal), hands.mapped(decimal), delays_of(device), ENCLOSURES)
    at, sin = loop_in_hand(plant, Enclosure(theta), ENCLOSURES), ENCLOSURES.sin(Enclosure(theta) / 2)

    def parts(number: EvenOdd) -> Pair:
        return Pair(number.even, number.odd)

    def true(number: EvenOdd) -> Pair:
        return Pair(number.even, sin * number.odd)

    def loop(form: Callable[[EvenOdd], Pair]) -> Affine:
        if isinstance(at, CommandInHand):
            return Affine(form(at.closed(NO_GAINS)), None, None)
        position = form(at.position) if isinstance(at, LoopInHand) else None
        return Affine(form(at.open), form(at.velocity), position)

    # P conj F = e + j s o; without the factor s in each number (`parts`), the imaginary part is o
    split, whole = loop(parts), loop(true)

    def seen(form: Callable[[EvenOdd], Pair]) -> Affine:
        if isinstance(at, LoopInHand):
            return Affine(None, form(at.seen_velocity), form(at.seen_position))
        return Affine(form(at.numerator(NO_GAINS)), None, None)

    lost = mapped(quadratic(im_conj_product, seen(parts), split, crossed=True), lambda x: -0.5 * x)
    swing = mapped(quadratic(re_conj_product, seen(true), whole, crossed=True), lambda x: 0.5 * x)
    return lost, quadratic(re_conj_product, whole, whole, crossed=True), swing


def _in_any_hand(device: Device, theta: Floats) -> tuple[Coefficients, Coefficients]:
    """Return the coefficients of the numerator and the denominator of R/s^2."""
    delays, at = delays_of(device), Enclosure(theta)
    fractional = delays.loop_fractional
    of = any_hand(device.converted(decimal), delays.loop, at, ENCLOSURES, fractional=fractional).of_velocity
    zero = 0 * at
    lost, slope, size_slope, size_square = (zero + x for x in of)
    return (lost, (slope, zero), None, None), (1 + zero, (size_slope, zero), (size_square, zero), None)
