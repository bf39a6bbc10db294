"""Compute the impedance that a servo in a hand presents to the environment, and the resistance that this impedance
requires of the coupling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.hands import Hand, Hands, hands_as_one
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.matrices import Vector, add, nothing, times
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.circle import Circle, circle
from vctune.model.sampled.servo_plant import Pull, ServoPlant, sensed_delay, servo_plant

Floats = NDArray[np.float64]
# Points (Hz, r) of the radius of a disc that contains Z_seen. r is linear between the points on logarithmic axes,
# constant above the last point, and proportional to the frequency below the first, because a servo follows a constant
# command exactly
Radii = tuple[tuple[float, float], ...]
BEYOND = 1e9  # Multiple of the disc's last frequency up to which r is constant


@dataclass(frozen=True, slots=True)
class ServoSeen:
    """Z_seen = (even + j s odd)/(2 j s) at an angle."""

    even: Number  # the two parts, N s/m, regular at theta = 0
    odd: Number


def seen_of_servo(plant: ServoPlant, hand: Hand, theta: Number, ops: Arithmetic) -> ServoSeen:
    """Return Z_seen, the impedance that a servo in a hand presents to the environment (model/README.md, section 17)."""
    at = circle(theta, ops)
    seen = _seen_at(plant, hand, at)
    if plant.pull is None:
        return seen
    other = _seen_at(plant.pull.plant, _pulling(plant.pull), at)
    return ServoSeen(seen.even + other.even, seen.odd + other.odd)


def _pulling(pull: Pull) -> Hand:
    """Return a hand that has the stiffness of the firmware's own spring."""
    return Hand(0, 0, pull.stiffness)


class SensedPart(NamedTuple):
    """The part of Z_seen that a hand causes through a force sensor: w^(N+1) (regular + spring step/(1 - w))."""

    regular: Pair
    step: tuple[Number, Number]  # even and odd part
    spring: Number  # K T


def _seen_at(plant: ServoPlant, hand: Hand, at: Circle) -> ServoSeen:
    """Return the part of Z_seen that the hand causes through the force sensor."""
    s, c, y = at.sin, at.cos, at.square
    rest, step, spring = _sensed(plant, hand, at)
    # 2 j s e^(-j theta/2) times a regular number
    turned = rest * Pair(c, -s)
    even, odd = step[0] * spring - 2 * (s * turned.im), step[1] * spring + 2 * turned.re
    cos, sine = at.turned(plant.turns)
    even, odd = cos * even + y * (sine * odd), cos * odd - sine * even
    return ServoSeen(c * even, c * odd) if plant.interpolated else ServoSeen(even, odd)


def seen_apart(plant: ServoPlant, hand: Hand, theta: Number, ops: Arithmetic) -> tuple[Pair, Pair]:
    """Return the numbers r and k in Z_seen = r + k/(1 - 1/z), of a hand and without the firmware's own spring; both are
    regular at theta = 0."""
    at = circle(theta, ops)
    rest, step, spring = _sensed(plant, hand, at)
    angle = theta * (plant.turns + 0.5)
    late = Pair(ops.cos(angle), -ops.sin(angle)).scaled(at.cos if plant.interpolated else 1)
    return rest * late, Pair(step[0], at.sin * step[1]).scaled(spring) * late


def _sensed(plant: ServoPlant, hand: Hand, at: Circle) -> SensedPart:
    s, c, y = at.sin, at.cos, at.square
    spring = times(hand.stiffness, plant.sample_time)
    # K T (1 - delta + delta w), w = 1 - 2 y - 2 j s c
    step = 1 - 2 * (plant.older * y), -2 * (plant.older * c)
    rest = _regular(plant, hand, spring, at)
    held, w, d = Pair(step[0], s * step[1]).scaled(-spring), Pair(1 - 2 * y, -2 * (s * c)), Pair(2 * y, 2 * (s * c))
    for section in plant.filters:  # N/D = 1 - (1 - w) (first + second w)/D
        first, second, a_2 = 1 - section.now, add(section.earlier, times(section.again, -1)), section.again
        # D, of d alone: 1 - w is small at rest, where D is
        below = d.scaled(add(1 - section.rest, times(a_2, -1))).plus(section.rest)
        passed, left = Pair(section.now, 0), Pair(first, 0)
        if not section.low_pass:
            passed = passed + w.scaled(section.before)
        if not section.first_order:
            below, left = below + (d * d).scaled(a_2), left + w.scaled(second)
            passed = passed + (w * w).scaled(section.earlier)
        rest = (rest * passed + held * left) * _reciprocal(below, at.ops)
    return SensedPart(rest, step, spring)


def _regular(plant: ServoPlant, hand: Hand, spring: Number, at: Circle) -> Pair:
    """Return the part of Z_seen/w^(N+1) that is regular at theta = 0. The argument `spring` is K T."""
    late: Number = 0
    for x in plant.lags:
        late = add(late, x)
    w, d = Pair(1 - 2 * at.square, -2 * (at.sin * at.cos)), Pair(2 * at.square, 2 * (at.sin * at.cos))
    carried = times(hand.mass, 1 / plant.sample_time)
    total = Pair(add(hand.damping, -times(spring, late)), 0)
    for first, (p, h, lag, driven) in enumerate(
        zip(_driven(plant, d, at.ops), plant.held, plant.lags, plant.driven, strict=True)
    ):
        moved = add(times(spring, lag), 0 if first else -hand.damping)
        if not nothing(moved):
            total = total + (Pair(h, 0) + (w * p).scaled(-1)).scaled(moved)
        total = total + (d * p).scaled(times(-carried, driven))
    return total


def _driven(plant: ServoPlant, d: Pair, ops: Arithmetic) -> list[Pair]:
    """Return p. The states of the sensor depend on the states of the servo, but not the reverse."""
    first = len(plant.held) - plant.order
    servo, sensor = plant.below[first:], plant.below[:first]
    moved = _solved(servo[0][first:], [Pair(h, 0) for h in plant.held[first:]], d, ops)
    felt = [Pair(h, 0) for h in plant.held[:first]]
    if not felt:
        return moved
    for place, row in enumerate(sensor):
        for g, state in zip(row[first:], moved, strict=True):
            felt[place] = felt[place] + (state * d).scaled(-g)
    return [*_solved(sensor[0][:first], felt, d, ops), *moved]


def _solved(below: Vector, right: list[Pair], d: Pair, ops: Arithmetic) -> list[Pair]:
    """Return (w + d g)^-1 times a vector. g is a number x, or a matrix ((x, y), (-y, x)) with the eigenvalues x + j y
    and x - j y."""
    along = d.scaled(below[0] - 1).plus(1)
    if len(right) == 1:
        return [right[0] * _reciprocal(along, ops)]
    across, (a, b) = Pair(-(d.im * below[1]), d.re * below[1]), right
    one = Pair(a.re + b.im, a.im - b.re) * _reciprocal(along + across, ops)
    other = Pair(a.re - b.im, a.im + b.re) * _reciprocal(along + across.scaled(-1), ops)
    return [(one + other).scaled(0.5), Pair(0.5 * (other.im - one.im), 0.5 * (one.re - other.re))]


def _reciprocal(x: Pair, ops: Arithmetic) -> Pair:
    return Pair(*ops.reciprocal(x.re, x.im))


def blur_of(plant: ServoPlant, seen: ServoSeen, theta: Number, ops: Arithmetic) -> Number:
    """Return r |Z_seen|, the greatest increase of -odd/2 while Z_seen varies within its disc."""
    if not plant.radii:
        return 0
    around = ops.modulus(seen.even, ops.sin(theta / 2) * seen.odd)
    return _blur(plant.radii, plant.sample_time, theta, ops) * around


def _blur(radii: Radii, sample_time: Number, theta: Number, ops: Arithmetic) -> Number:
    """Return r/(2 s). Between two points, r/f is linear on logarithmic axes, as r is."""
    beyond = BEYOND * radii[-1][0]
    table = (*((hertz, radius / hertz) for hertz, radius in radii), (beyond, radii[-1][1] / beyond))
    turn = 2 * ops.pi * sample_time
    return ops.interpolated(theta / turn, table) / (turn * ops.sinc(theta / 2))


@dataclass(frozen=True, slots=True)
class Demand:
    """The resistance that a box of hands requires of a servo's coupling, including the disc of its responses."""

    plant: ServoPlant  # the servo, with plain numbers
    vertices: Hand  # hands at the vertices, with numbers of shape (v, 1); at every angle one of them requires the most

    def in_each(self, theta: Floats) -> Floats:
        """Return R at each vertex for angles of shape (n,), N s/m. The result has shape (v, n)."""
        seen = seen_of_servo(self.plant, self.vertices, theta, FLOATS)
        return np.asarray(blur_of(self.plant, seen, theta, FLOATS) - 0.5 * seen.odd)

    def at(self, theta: Floats) -> Floats:
        """Return R at angles, N s/m. The result has the shape of the angles."""
        return np.asarray(self.in_each(np.ravel(theta)).max(axis=0).reshape(np.shape(theta)))


def demand_of(device: Device, hands: Hands) -> Demand:
    """Return the resistance R that a box of hands requires of a servo's coupling, as a function of the angle."""
    return Demand(servo_plant(device, sensed_delay(device), FLOATS), hands_as_one(hands.corners, (-1, 1)))
