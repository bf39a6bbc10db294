"""Bound the coupling that an impedance display with a box of environments requires (design/bound/README.md, section
1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from vctune.design.bound.design_boxes import TAU_C, DesignBoxes
from vctune.design.bound.hands_bound import NO_GAINS, angles_of, coefficients_in_hands
from vctune.design.bound.quadratic_coefficients import Coefficients, concatenated, joined
from vctune.design.bound.quadratics import GUARD, Quadratic, lower, upper
from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import firmware_filter, offered_by_spring, spring_forms
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import Worlds
from vctune.proof.enclosures.array_intervals import Enclosure, Flags, Floats, decimal
from vctune.proof.enclosures.jets import ENCLOSURES

# Allowance for the rounding of a coefficient or a discriminant, relative to the sum of the moduli of its terms
ROUNDING = 20 * GUARD


class Interval(NamedTuple):
    """Lower and upper bounds of a number over boxes, shape (boxes, places) or (places,)."""

    low: Floats
    high: Floats

    @property
    def size(self) -> Floats:
        """The greatest modulus."""
        return np.maximum(-self.low, self.high)

    def times(self, other: Interval) -> Interval:
        """Return the bounds of a product."""
        each = [x * y for x in self for y in other]
        return Interval(np.minimum.reduce(each), np.maximum.reduce(each))

    def plus(self, other: Interval) -> Interval:
        """Return the bounds of a sum, with an allowance for the rounding of its terms and of their factors."""
        slack = ROUNDING * (self.size + other.size)
        return Interval(self.low + other.low - slack, self.high + other.high + slack)

    def minus(self, other: Interval) -> Interval:
        """Return the bounds of a difference."""
        return self.plus(Interval(-other.high, -other.low))


@dataclass(frozen=True, slots=True)
class Bounded:
    """A quadratic in K_v, or in tau, rounded down and rounded up."""

    lower: Quadratic  # the quadratic with rounded coefficients
    upper: Quadratic

    def over(self, boxes: DesignBoxes) -> Interval:
        """Return the bounds of the quadratic over each box of its two variables."""
        return Interval(self.lower.least(boxes), self.upper.greatest(boxes))


@dataclass(frozen=True, slots=True)
class SpringsInWorlds:
    """The constraint on the coupling of an impedance display with a box of environments, at places of several
    devices."""

    lost: Bounded  # R/s^2 times |F|^2, |F|^2, and e/2 (`coefficients_in_hands`), as functions of K_v
    size: Bounded
    swing: Bounded
    above: Bounded  # 1/Z_c/s^2 = (above + j spring/s)/below for k_c = 1, as functions of tau
    spring: Bounded
    below: Bounded
    met: Interval  # |P|^2/4
    heavy: Interval | None  # s c (k_1/u - m_2 u), None if the mass has no limit
    light: Interval | None
    kept: Interval  # b_1, the least damping of the environments
    cos: Interval  # c = cos(theta/2), and s^2 with s = sin(theta/2)
    square: Interval

    def least_elements(self, boxes: DesignBoxes, factor: float) -> tuple[Floats, Floats, Flags]:
        """Return the least 1/k_c at each place, 0 for 1/b_c, and the boxes that permit no coupling."""
        tau = DesignBoxes(*(np.stack((edge[TAU_C], 0 * edge[TAU_C])) for edge in (boxes.low, boxes.high)))
        lost, size, swing = (each.over(boxes) for each in (self.lost, self.size, self.swing))
        above, spring, below = (each.over(tau) for each in (self.above, self.spring, self.below))
        crossed = self.square.times(above.times(lost)).plus(spring.times(swing))

        def least(bent: Interval, straight: Interval, seen: Interval) -> Floats:
            turned = bent.times(crossed)
            slope = straight.minus(turned.plus(turned))
            return _first_positive(bent.times(size), slope, below.times(bent.times(self.met).plus(seen)))

        reactive, turning = self.cos.times(spring.times(size)), self.cos.times(swing)
        found = least(self.kept, above.times(size), _negative(lost))
        if self.heavy is not None:
            found = np.fmin(found, least(self.heavy, reactive, _negative(turning)))
        if self.light is not None:
            found = np.fmin(found, least(self.light, _negative(reactive), turning))
        found = factor * found
        return found, np.zeros_like(found), np.asarray(np.isinf(found).any(axis=1))


def _negative(x: Interval) -> Interval:
    return Interval(-x.high, -x.low)


@np.errstate(all="ignore")
def _first_positive(square: Interval, slope: Interval, constant: Interval) -> Floats:
    """Return a lower bound of the p >= 0 at which a quadratic is positive; inf if it is positive for no p."""
    a, b, c = (each.high + ROUNDING * each.size for each in (square, slope, constant))
    slack = ROUNDING * (b * b + np.abs(4 * a * c))
    inside = b * b - 4 * a * c
    rising = np.where(inside + slack < 0, inf, -2 * c / (b + np.sqrt(np.maximum(inside + slack, 0.0))))
    falling = np.where(a > 0, (-b + np.sqrt(np.maximum(inside - slack, 0.0))) / (2 * a), inf)
    found = np.where(b > 0, rising, falling) * (1 - ROUNDING)
    return np.where(c > 0, 0.0, np.nan_to_num(found, nan=0.0, posinf=inf))


def springs_in_worlds(devices: Sequence[Device], places: PlacesInHands, worlds: Worlds) -> SpringsInWorlds:
    """Return the constraint on the coupling of impedance displays with a box of environments, at some places."""
    angles = [angles_of(device, places.at) for device in devices]
    pairs = list(zip(devices, angles, strict=True))
    lost, size, swing = (
        _bounded(each) for each in zip(*(coefficients_in_hands(*pair, places.hands) for pair in pairs), strict=True)
    )
    above, spring, below = (_bounded(each) for each in zip(*(_of_coupling(*pair) for pair in pairs), strict=True))
    rest = concatenated([_of_angle(*pair, places, worlds) for pair in pairs])
    met, heavy, light, kept, cos, square = (_interval(each) for each in rest)
    return SpringsInWorlds(
        lost,
        size,
        swing,
        above,
        spring,
        below,
        met,
        heavy if worlds.high.mass < inf else None,
        light if worlds.high.stiffness < inf else None,
        kept,
        cos,
        square,
    )


def _bounded(each: Sequence[Coefficients]) -> Bounded:
    coefficients = joined(each)
    return Bounded(lower(coefficients), upper(coefficients))


def _interval(x: Enclosure) -> Interval:
    return Interval(x.mid - x.rad, x.mid + x.rad)


def _of_coupling(device: Device, theta: Floats) -> tuple[Coefficients, Coefficients, Coefficients]:
    """Return the coefficients of `above`, `spring` and `below` as quadratics in tau."""
    exact, at = device.converted(decimal), Enclosure(theta)
    (a_1, a_0), (b_2, b_1, b_0) = spring_forms(exact, at, ENCLOSURES)
    T, low_pass, zero = exact.sample_time, firmware_filter(exact, at, ENCLOSURES), 0 * at
    damper, spring = (
        offered_by_spring(SpringDamper(b_c, k_c), T, low_pass, at, ENCLOSURES).spring + zero
        for b_c, k_c in ((T, 0 * T), (0 * T, 1 + 0 * T))
    )
    above: Coefficients = (a_0, (a_1, zero), None, None)
    turned: Coefficients = (spring, (damper / T, zero), None, None)
    return above, turned, (b_0, (b_1, zero), (b_2, zero), None)


def _of_angle(device: Device, theta: Floats, places: PlacesInHands, worlds: Worlds) -> list[Enclosure]:
    """Return |P|^2/4, `heavy`, `light`, b_1, c and s^2 at each place; an infinite limit counts as 0."""
    at, T, ends = Enclosure(theta), decimal(device.sample_time), worlds.converted(decimal)
    plant = plant_in_hand(device.bare.converted(decimal), places.hands.mapped(decimal), delays_of(device), ENCLOSURES)
    met = loop_in_hand(plant, at, ENCLOSURES).numerator(NO_GAINS)
    sin, cos = ENCLOSURES.sin(at / 2), ENCLOSURES.cos(at / 2)
    inertia, compliance = sin * sin * (2 / T), cos * cos * (T / 2)
    greatest = 0.0 if worlds.high.mass == inf else ends.high.mass
    stiffest = 0.0 if worlds.high.stiffness == inf else ends.high.stiffness
    heavy = ends.low.stiffness * compliance - greatest * inertia
    light = ends.low.mass * inertia - stiffest * compliance
    return [met.abs2() / 4 + 0 * at, heavy, light, ends.low.damping + 0 * at, cos, sin * sin]
