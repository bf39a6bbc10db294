"""Constraints on the coupling at some places of several devices: the least elements of the coupling that they leave in
boxes of designs (README.md, section 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from vctune.design.bound.quadratics import B_0, GUARD, TAU_C, Quadratic, Quotient, concatenated, products, quadratic
from vctune.model.device import Device, devices_as_one
from vctune.model.gains import Gains
from vctune.model.hands import Hand, PlacesInHands
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import Affine, LoopConstants, loop_constants
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import EvenOdd, Pair, im_conj_product, re_conj_product
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import CommandInHand, LoopInHand, loop_in_hand
from vctune.model.sampled.impedance_display import spring_forms
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import Worlds
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, Floats, decimal, stacked

NO_GAINS = Gains(0.0, 0.0)  # Gains with which the code evaluates the parts of a loop that do not depend on the gains

# The least first and second element of the coupling at each place, each of shape (boxes, places): b_c and m_c, or 1/k_c
# and 1/b_c of an impedance display. Then the boxes that permit no coupling
Least = tuple[Floats, Floats, Flags]


@dataclass(frozen=True, slots=True)
class SeriesOffer:
    """The resistance Re Z_c at omega. In the sampled loop omega is (2/T) tan(theta/2)."""

    omega: Floats  # frequencies, rad/s

    def least_elements(self, boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least b_c = 1 + 1/x^2, at the greatest tau_c, and the least m_c = tau_c + 1/(omega^2 tau_c), for a
        resistance of 1 without drag."""
        shortest, longest = (edge[TAU_C][:, None] for edge in (boxes.low, boxes.high))
        nearest = np.clip(1 / self.omega, shortest, longest)
        return 1 + 1 / np.square(self.omega * longest), nearest + 1 / (np.square(self.omega) * nearest)

    def of_reactance(self, boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least b_c and the least m_c for Im Z_c = omega."""
        shortest, longest = (edge[TAU_C][:, None] for edge in (boxes.low, boxes.high))
        nearest, omega2 = np.clip(1 / self.omega, shortest, longest), np.square(self.omega)
        return (1 + omega2 * np.square(nearest)) / nearest, 1 + omega2 * np.square(shortest)


@dataclass(frozen=True, slots=True)
class SpringOffer:
    """Re(1/Z_c)/s^2 of spring-dampers at some angles theta, with s = sin(theta/2) and tau = b_c/k_c."""

    stiff: Quotient  # the 1/k_c and the 1/b_c for which Re(1/Z_c)/s^2 = 1, as functions of boxes of tau
    damped: Quotient
    best_time_constant: Floats  # tau with the least 1/k_c, s, shape (places,)

    def least_elements(self, boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least 1/k_c and 1/b_c for which Re(1/Z_c)/s^2 = 1; inf if Re(1/Z_c)/s^2 is positive nowhere in the
        box."""
        low, high = boxes.low[TAU_C], boxes.high[TAU_C]
        of_tau = Cells(np.stack((low, 0 * low)), np.stack((high, 0 * high)))
        nearest = np.clip(self.best_time_constant, low[:, None], high[:, None])
        offered = self.stiff.below.greatest(of_tau) > 0
        stiff = self.stiff.least(of_tau, (nearest, 0 * nearest))
        damped = self.damped.least(of_tau, (high[:, None] + 0 * nearest, 0 * nearest))
        return np.where(offered, stiff, inf), np.where(offered, damped, inf)


def elements_for(required: Floats, offer: SeriesOffer | SpringOffer, boxes: Cells) -> tuple[Floats, Floats]:
    """Return the least first and second element with which couplings can have a required resistance, at each place."""
    needed = np.maximum(required - boxes.high[B_0][:, None], 0.0)
    first, second = (np.where(needed > 0, needed * each, 0.0) for each in offer.least_elements(boxes))
    return first, second


def offer_of(devices: Sequence[Device], angles: Sequence[Floats]) -> SeriesOffer | SpringOffer:
    """Return the resistance of the couplings in the sampled loop, at angles of several devices."""
    pairs = list(zip(devices, angles, strict=True))
    if not devices[0].kind.inverse:
        return SeriesOffer(np.concatenate([np.tan(theta / 2) * (2 / device.sample_time) for device, theta in pairs]))
    each = []
    for device, theta in pairs:
        (a_1, a_0), (b_2, b_1, b_0) = spring_forms(device.converted(decimal), Enclosure(theta), ENCLOSURES)
        above, stiff, damped = [b_0, b_1, 0, b_2, 0, 0], [a_0, a_1, 0, 0, 0, 0], [0, a_0, 0, a_1, 0, 0]
        each.append(stacked([*above, *stiff, *damped]))
    of = concatenated(each)
    mid = of.mid
    with np.errstate(all="ignore"):  # the slope of the quotient is 0 where c_2 tau^2 + 2 c_1 tau - c_0 = 0
        c_0, c_1, c_2 = mid[7] * mid[0] - mid[6] * mid[1], mid[6] * mid[3], mid[7] * mid[3]
        root = c_1 + np.sqrt(np.maximum(c_1 * c_1 + c_2 * c_0, 0.0))
        best = np.where(c_0 > 0, c_0 / root, 0.0)
    needed, stiffness, damping = (quadratic(of[k : k + 6]) for k in (0, 6, 12))
    return SpringOffer(Quotient(needed, stiffness), Quotient(needed, damping), best)


@dataclass(frozen=True, slots=True)
class LlewellynConditions:
    """Llewellyn's conditions at some frequencies (model/README.md, section 4)."""

    offer: SeriesOffer  # resistance of the couplings at these frequencies
    C2: Quadratic  # |C|^2, |D|^2, Re(C conj D), Im(C conj D) and the loop's resistance
    D2: Quadratic
    P: Quadratic
    im: Quadratic
    resistance: Quadratic
    relief: Quadratic | None  # 2 b_h Re(C conj N); None without an operator

    def least_elements(self, boxes: Cells, factor: float) -> Least:
        """Return the least elements of the coupling, from a lower bound of R."""
        im = np.maximum(np.maximum(self.im.least(boxes), -self.im.greatest(boxes)), 0.0) * (1 - GUARD)
        resistance, P = self.resistance.greatest(boxes), self.P.greatest(boxes)
        weight = np.sqrt(self.C2.greatest(boxes) * self.D2.greatest(boxes)) * (1 + GUARD) + P
        least = np.maximum(self.C2.least(boxes), 0.0) * np.maximum(self.D2.least(boxes), 0.0)
        excess = np.fmax(np.where(im > 0, im * im / weight, 0.0), np.sqrt(least) * (1 - GUARD) - P)
        if self.relief is not None:
            relief = self.relief.greatest(boxes)
            excess = excess - relief - GUARD * np.abs(relief)
        R = np.fmax(excess / (2 * resistance) * (1 - 10 * GUARD), 0.0)
        return *elements_for(factor * R, self.offer, boxes), np.asarray((resistance <= 0).any(axis=1))


def llewellyn_conditions(devices: Sequence[Device], omega: Floats) -> LlewellynConditions:
    """Return Llewellyn's conditions at some frequencies."""
    device, omega = repeated(devices, len(omega)), np.tile(omega, len(devices))
    at, crossed, relief = loop_at(device, omega), device.velocity is not None, None
    C2, D2 = (products(re_conj_product, part, part, crossed=crossed) for part in (at.C, at.D))
    P, im = (products(of, at.C, at.D, crossed=crossed) for of in (re_conj_product, im_conj_product))
    if device.ideal:  # C conj C is real, so the square terms are only rounding errors
        im[3:] = [0.0] * 3
    if device.operator is not None:
        twice = 2 * decimal(device.operator.damping)
        relief = quadratic(products(lambda x, y: twice * re_conj_product(x, y), at.C, at.numerator, crossed=crossed))
    resistance = quadratic(_resistance(device, at, omega, crossed=crossed))
    of_C, of_D, of_P, of_im = map(quadratic, (C2, D2, P, im))
    return LlewellynConditions(SeriesOffer(omega), of_C, of_D, of_P, of_im, resistance, relief)


def _resistance(device: Device, at: LoopConstants, omega: Floats, *, crossed: bool) -> list[Number]:
    """Return the coefficients of the loop's resistance, Re W + Re y |W|^2 + b_h |N|^2."""
    W, exact, square = at.motor, device.converted(decimal), Enclosure(omega) * Enclosure(omega)
    found = [0 * square + W.constant.re, W.velocity.re, W.position.re, 0.0, 0.0, 0.0]
    springs = device_response(exact.bare, Enclosure(omega), ENCLOSURES).springs
    forces = (W, *at.further)[: len(springs)]
    added = [(square * spring.y_c, force) for spring, force in zip(springs, forces, strict=True)]
    if exact.operator is not None:
        added.append((exact.operator.damping, at.numerator if springs else Affine(Pair(1, 0))))
    for factor, of in added:
        more = products(lambda x, y, k=factor: k * re_conj_product(x, y), of, of, crossed=crossed)
        found = [x + y for x, y in zip(found, more, strict=True)]
    return found


def repeated(devices: Sequence[Device], count: int) -> Device:
    """Return several devices as one device with arrays of parameters, which repeat the parameters of each device."""
    return devices_as_one([device for device in devices for _ in range(count if len(devices) > 1 else 1)])


def loop_at(device: Device, omega: Floats) -> LoopConstants:
    """Return the constants of a device's loop without a hand, as enclosures (model/README.md, section 2)."""
    return loop_constants(device_response(device.bare.converted(decimal), Enclosure(omega), ENCLOSURES))


@dataclass(frozen=True, slots=True)
class SampledConditions:
    """The constraint on the coupling in the sampled loop at some angles: in some hands, in any passive hand, or in some
    hands with a box of environments, where `resistive` or `below` must be positive if `above` is negative."""

    offer: SeriesOffer | SpringOffer  # resistance of the couplings at these angles
    required: Quotient  # R, the resistance that the loop requires of the coupling; for an impedance display R/s^2
    kept: float = 0.0  # b_1, the least damping of the environments, N s/m
    light_enough: Quadratic | None = None  # (m_2 (2/T) s^2 - k_1 (T/2) c^2) |F|^2 - c e/2
    reactive: Quotient | None = None  # the least s c Im Z_c/g for which `below` is positive
    inertia: Floats | float = 1.0  # (2/T) s^2 at each angle

    def least_elements(self, boxes: Cells, factor: float) -> Least:
        """Return the least elements of the coupling, from a lower bound of R."""
        none = (self.required.below.greatest(boxes) < 0).any(axis=1)
        first, second = elements_for(factor * (self.required.least(boxes) - self.kept), self.offer, boxes)
        if self.light_enough is not None:
            above_negative = self.light_enough.least(boxes) > 0
            first, second = np.where(above_negative, first, 0.0), np.where(above_negative, second, 0.0)
        if self.reactive is not None and isinstance(self.offer, SeriesOffer):
            reactance = factor * self.reactive.least(boxes)
            each = (x / self.inertia for x in self.offer.of_reactance(boxes))
            b_c, m_c = (np.where(reactance > 0, reactance * x, 0.0) for x in each)
            first, second = np.fmin(first, b_c), np.fmin(second, m_c)
        return first, second, np.asarray(none)


def conditions_in_hands(
    devices: Sequence[Device], places: PlacesInHands, worlds: Worlds | None = None
) -> SampledConditions:
    """Return the constraint on the coupling in hands at some places, also with a box of environments."""
    angles = _angles(devices, places.at)
    each = [_in_hands(device, theta, places.hands) for device, theta in zip(devices, angles, strict=True)]
    lost, F2, _ = (quadratic(concatenated(same)) for same in zip(*each, strict=True))
    offer = offer_of(devices, angles)
    if worlds is None:
        return SampledConditions(offer, Quotient(lost, F2))
    light, soft = worlds.high.mass < inf, worlds.high.stiffness < inf  # without a bound the margin is never positive
    ends, inertias, margins = worlds.converted(decimal), [], []
    for device, theta, (_, size, swing) in zip(devices, angles, each, strict=True):
        half, T = Enclosure(theta) / 2, decimal(device.sample_time)
        sin, cos = ENCLOSURES.sin(half), ENCLOSURES.cos(half)
        inertia, compliance, turned = sin * sin * (2 / T), cos * cos * (T / 2), cos * swing
        more = ends.high.mass * inertia - ends.low.stiffness * compliance if light else inertia
        less = ends.high.stiffness * compliance - ends.low.mass * inertia if soft else inertia
        margins.append((more * size - turned, less * size + turned))
        inertias.append(inertia.mid)
    above, below = (quadratic(concatenated(same)) for same in zip(*margins, strict=True))
    reactive = Quotient(below, F2) if soft else None
    kept, inertia = worlds.low.damping, np.concatenate(inertias)
    return SampledConditions(offer, Quotient(lost, F2), kept, above if light else None, reactive, inertia)


def conditions_in_any_hand(devices: Sequence[Device], omega: Floats) -> SampledConditions:
    """Return the constraint on the coupling of impedance displays in any passive hand."""
    angles, each = _angles(devices, omega), []
    for device, theta in zip(devices, angles, strict=True):
        delays, at = delays_of(device), Enclosure(theta)
        disc = any_hand(device.converted(decimal), delays.loop, at, ENCLOSURES, fractional=delays.loop_fractional)
        lost, slope, size_slope, size_square = disc.of_velocity
        size = [1 + 0 * at, size_slope, 0, size_square, 0, 0]
        each.append((stacked([lost + 0 * at, slope, 0, 0, 0, 0]), stacked(size)))
    required = Quotient(*(quadratic(concatenated(same)) for same in zip(*each, strict=True)))
    return SampledConditions(offer_of(devices, angles), required)


def _angles(devices: Sequence[Device], omega: Floats) -> list[Floats]:
    """Return the angles omega T of each device, at most pi."""
    return [np.minimum(omega * device.sample_time, np.pi) for device in devices]


def _in_hands(device: Device, theta: Floats, hands: Hand) -> tuple[Enclosure, Enclosure, Enclosure]:
    """Return -o/2, |F|^2 and e/2 as quadratics in the gains (model/README.md, section 14)."""
    plant = plant_in_hand(device.bare.converted(decimal), hands.mapped(decimal), delays_of(device), ENCLOSURES)
    at, sin = loop_in_hand(plant, Enclosure(theta), ENCLOSURES), ENCLOSURES.sin(Enclosure(theta) / 2)
    if isinstance(at, LoopInHand):
        F, P = Affine(at.open, at.velocity, at.position), Affine(None, at.seen_velocity, at.seen_position)
    else:
        F = Affine(at.closed(NO_GAINS)) if isinstance(at, CommandInHand) else Affine(at.open, at.velocity)
        P = Affine(at.numerator(NO_GAINS))

    def parts(number: EvenOdd) -> Pair:
        return Pair(number.even, number.odd)

    def true(number: EvenOdd) -> Pair:
        return Pair(number.even, sin * number.odd)

    # P conj F = e + j s o; without the factor s in each number (`parts`), the imaginary part is o
    lost = products(lambda x, y: -0.5 * im_conj_product(x, y), P.mapped(parts), F.mapped(parts))
    swing = products(lambda x, y: 0.5 * re_conj_product(x, y), P.mapped(true), F.mapped(true))
    whole = F.mapped(true)
    return stacked(lost), stacked(products(re_conj_product, whole, whole)), stacked(swing)
