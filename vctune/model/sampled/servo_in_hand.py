"""The impedance that the environment sees of a servo in a hand, and its requirement on the coupling (model/README.md,
section 17).

The motion follows the command alone, and the sensed force of a hand is linear in it:

    Z_seen = M G_a + B G_v + K G_x = e^(-j mu theta) (e + j s c o)/(2 j s D),   R = -Re Z_seen,

times cos(theta/2) for a position command, with e and o polynomials of y = s^2 that are linear in the hand. Hence

    R = (e sin(mu theta)/s - o c cos(mu theta))/(2 D).

The firmware's own spring adds its stiffness times the G_x of a servo without force sensor to Z_seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.hand_arrays import stacked
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.matrices import Vector, add, dot
from vctune.model.sampled.circle import Circle, circle
from vctune.model.sampled.servo_plant import Numerator, Pull, ServoPlant, sensed_delay, servo_plant

Floats = NDArray[np.float64]
Radii = tuple[tuple[float, float], ...]
"""(Hz, r) of a disc that contains Z_seen: r is linear between these on logarithmic axes, constant above the last, and
below the first proportional to the frequency: at rest a servo is at its command."""
BEYOND = 1e9
"""Times the last frequency of a disc, up to which r is constant. Half and twice it are above Nyquist as well."""


@dataclass(frozen=True, slots=True)
class Seen:
    """Z_seen = (even + j s odd)/(2 j s size) at an angle.

    Attributes
    ----------
    even, odd, size : regular at theta = 0; size > 0
    """

    even: Number
    odd: Number
    size: Number


def seen_of_servo(plant: ServoPlant, hand: Hand, theta: Number, ops: Arithmetic) -> Seen:
    """Return Z_seen, the impedance of a servo in a hand that the environment sees (model/README.md, section 17).

    The firmware's own spring, if the servo has one, adds to it.

    Parameters
    ----------
    plant : the servo over a sample
    hand : M, B and K; arrays of shape (h, 1) for several hands
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments

    Returns
    -------
    Seen
        The three parts of Z_seen, of the shape of theta and the hand together.
    """
    at = circle(theta, ops)
    seen = _seen_at(plant, hand, at)
    return seen if plant.pull is None else _both(seen, _seen_at(plant.pull.plant, _pulling(plant.pull), at))


def _seen_at(plant: ServoPlant, hand: Hand, at: Circle) -> Seen:
    """Return the part of Z_seen that a hand makes through the force sensor."""
    even, odd, size = _at_once(plant, hand, at)
    cos, sine = at.turned(plant.turns)
    found = cos * even + at.square * (sine * odd), cos * odd - sine * even
    even, odd = (at.cos * x for x in found) if plant.interpolated else found
    return Seen(even, odd, size)


def _pulling(pull: Pull) -> Hand:
    """Return the firmware's own spring as a hand."""
    return Hand(0, 0, pull.stiffness)


def _both(one: Seen, other: Seen) -> Seen:
    """Return the sum of two parts of Z_seen."""
    even, odd = one.even * other.size + other.even * one.size, one.odd * other.size + other.odd * one.size
    return Seen(even, odd, one.size * other.size)


def blur_of(plant: ServoPlant, seen: Seen, theta: Number, ops: Arithmetic) -> Number:
    """Return the greatest increase of -odd/2 while Z_seen moves within its disc: r |Z_seen| size.

    Parameters
    ----------
    plant : the servo over a sample; its `radii` are those of the disc
    seen : Z_seen in a hand, without the disc
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of the other arguments

    Returns
    -------
    Number
        N s/m times `Seen.size`, of the shape of theta; 0 without a disc.
    """
    if not plant.radii:
        return 0
    around = ops.modulus(seen.even, ops.sin(theta / 2) * seen.odd)
    return _blur(plant.radii, plant.sample_time, theta, ops) * around


def _at_once(plant: ServoPlant, hand: Hand, at: Circle) -> tuple[Number, Number, Number]:
    """Return e, c o and D in a hand."""
    numbers = hand.mass, hand.damping, hand.stiffness
    powers = [at.square]
    while len(powers) < max(len(plant.size), len(plant.position.even)) - 1:
        half = len(powers) // 2
        powers.append(powers[half] * powers[len(powers) - 1 - half])

    def in_hand(of: Callable[[Numerator], Vector]) -> Number:
        numerators = zip(*(of(part) for part in (plant.acceleration, plant.velocity, plant.position)), strict=True)
        return _polynomial([dot(numbers, each) for each in numerators], powers)

    even, odd = in_hand(lambda part: part.even), in_hand(lambda part: part.odd)
    return even, at.cos * odd, _polynomial(plant.size, powers)


def _polynomial(coefficients: Sequence[Number], powers: Sequence[Number]) -> Number:
    """Return the sum of a_k y^k, of y, y^2, ... at least as many."""
    first, *others = coefficients
    return add(first, dot(others, powers[: len(others)]))


def _blur(radii: Radii, sample_time: Number, theta: Number, ops: Arithmetic) -> Number:
    """Return r/(2 s); r/f is as linear between the points as r."""
    beyond = BEYOND * radii[-1][0]
    table = (*((hertz, radius / hertz) for hertz, radius in radii), (beyond, radii[-1][1] / beyond))
    turn = 2 * ops.pi * sample_time
    return ops.interpolated(theta / turn, table) / (turn * ops.sinc(theta / 2))


@dataclass(frozen=True, slots=True)
class Demand:
    """The requirement of the hands of a box on a coupling.

    Attributes
    ----------
    plant : the servo, in plain numbers
    vertices : hands, one of which requires most at every angle, numbers of shape (v, 1)
    """

    plant: ServoPlant
    vertices: Hand

    def in_each(self, theta: Floats) -> Floats:
        """Return R at angles of shape (n,) in each vertex, N s/m, of shape (v, n)."""
        seen = seen_of_servo(self.plant, self.vertices, theta, FLOATS)
        return np.asarray((blur_of(self.plant, seen, theta, FLOATS) - 0.5 * seen.odd) / seen.size)

    def at(self, theta: Floats) -> Floats:
        """Return R at angles, N s/m, of their shape."""
        return np.asarray(self.in_each(np.ravel(theta)).max(axis=0).reshape(np.shape(theta)))


def demand_of(device: Device, hands: Hands) -> Demand:
    """Return the resistance R that a box of hands requires of a servo's coupling, as a function of the angle.

    Parameters
    ----------
    device : a servo in plain numbers
    hands : the box; its vertices suffice, since R is convex in the hand

    Returns
    -------
    Demand
        Evaluates R at angles.
    """
    return Demand(servo_plant(device, sensed_delay(device), FLOATS), stacked(hands.corners, (-1, 1)))
