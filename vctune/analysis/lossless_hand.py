"""Find the lossless hand in which the motion of a refuted impedance display grows (model/README.md, section 15)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import pi

import numpy as np

from vctune.analysis.destabilising import GrowingEnvironment, growing_with, growing_without
from vctune.analysis.extrema import Floats
from vctune.analysis.in_hands import least_ratios_in_any_hand, ratio_in_any_hand
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hands import LeastOperator
from vctune.model.loop.device_response import mechanism
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.any_hand import drive_at, motor_disc
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance

TURNED = (1, 3, 5, 9, 17, 33)  # Numbers of aliases, counted from the nearest, at which the hand has the worst reactance
DETUNED = (0.1, 1e-2, 1e-3, 1e-4)  # Relative distances of a resonator from its alias
SUMMED = 250  # Number of aliases on either side that the code sums for the hand's response; the rest is below 1e-5
# Distances, rad, from 0 Hz and from Nyquist at which the code searches for a hand near these ends, because nothing
# grows at the ends themselves
FROM_ENDS = (0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3)


@dataclass(frozen=True, slots=True)
class LosslessHand:
    """A mass or a spring at the handle, with resonators: masses on their own springs."""

    mass: float  # mass and stiffness at the handle, kg and N/m; one of them is 0
    stiffness: float
    resonators: tuple[tuple[float, float], ...] = ()  # mass, kg, and stiffness, N/m, of each resonator

    def impedance(self, omega: Number) -> Number:
        """Return the hand's impedance at complex frequencies in rad/s, N s/m."""
        found = 1j * (omega * self.mass - self.stiffness / omega)
        for mass, stiffness in self.resonators:
            found = found + 1j * omega * stiffness / (stiffness / mass - omega * omega)
        return found


def growing_in_any_hand(
    device: Device, gains: Gains, coupling: SpringDamper
) -> tuple[LosslessHand, GrowingEnvironment] | None:
    """Return the simplest lossless hand, and the environment, with which the motion of an impedance display grows."""
    with np.errstate(all="ignore"):
        places = list(_places(device, gains, coupling))
        for count, theta in product(TURNED, places):
            hands = _hands(device, gains, theta, count)
            tried = ((hand, _growing_in(device, gains, coupling, hand, theta)) for hand in hands)
            growing = [(hand, found) for hand, found in tried if found is not None]
            if growing:
                return max(growing, key=lambda pair: pair[1].growth)
    return None


def _growing_in(
    device: Device, gains: Gains, coupling: SpringDamper, hand: LosslessHand, theta: float
) -> GrowingEnvironment | None:
    """Return the environment with which the motion grows in a hand."""

    def loop(theta: complex) -> complex:
        """Return K_v F G_y."""
        return gains.velocity * _low_pass(device, theta) * _answer(device, hand, theta)

    def alone(theta: complex) -> complex:
        low_pass = firmware_filter(device, theta, FLOATS)
        given = _number(spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS))
        return given + _answer(device, hand, theta) / (1 + loop(theta))

    if loop(theta).real < -1:
        return growing_without(lambda theta: -1 - 1 / loop(theta), theta, device.sample_time)
    return growing_with(alone, theta, device.sample_time, admittance=True)


def _places(device: Device, gains: Gains, coupling: SpringDamper) -> Iterator[float]:
    """Yield the angles at which Re(1/Z_c) is less than some hand requires: local minima away from the ends."""

    def missed(theta: float) -> bool:
        return bool(ratio_in_any_hand(device, gains, coupling, np.array([theta]))[0] < 1)

    for worst in least_ratios_in_any_hand(device, gains, coupling):
        theta = worst.omega * device.sample_time
        if worst.ratio >= 1:
            return
        if theta < min(FROM_ENDS):
            yield from (off for off in FROM_ENDS if missed(off))
        elif theta > pi - min(FROM_ENDS):
            yield from (pi - off for off in FROM_ENDS if missed(pi - off))
        else:
            yield theta


def _hands(device: Device, gains: Gains, theta: float, count: int) -> Iterator[LosslessHand]:
    """Yield hands that have the worst reactance at an odd number of aliases."""
    at = theta + 2 * pi * np.array([0, *(sign * n for n in range(1, count // 2 + 1) for sign in (-1, 1))])
    reactance = np.sign(at) * _reactance(device, gains, theta, at)
    for detuned in DETUNED if count > 1 else DETUNED[:1]:
        hand = _with_reactance(np.abs(at) / device.sample_time, reactance, detuned)
        if hand is not None:
            yield hand


def _reactance(device: Device, gains: Gains, theta: float, at: Floats) -> Floats:
    """Return the worst reactance of a hand at each alias. With it, the motor's response is at the edge of its disc."""
    omega, drive = at / device.sample_time, _numbers(drive_at(device, theta, at, FLOATS))
    radius, reactance, leak = motor_disc(device, omega, FLOATS)
    centre = radius * (1.0 if leak is None else 1 + 2 * leak * (device.damping - 1j * reactance))
    weight = (2 * np.sin(theta / 2) / at) ** 2
    c, r = complex(np.sum(weight * drive * centre)), float(np.sum(weight * np.abs(drive) * radius))
    direction = _worst_direction(c, r, gains.velocity * _low_pass(device, theta))
    mass, damping = _motor(device)
    beyond = 1 / (centre + radius * direction * np.abs(drive) / drive) - damping - 1j * omega * mass
    if device.structure is not None:
        spring, handle, _ = _handle(device, omega)
        beyond = 1 / (1 / beyond - 1 / spring) - 1j * omega * handle
    return np.asarray(beyond.imag)


def _worst_direction(c: complex, r: float, k: complex) -> complex:
    """Return (G - c)/r at the point of a disc's edge where Re G/(1 + k G) is least."""
    size = abs(1 + k * c) ** 2 - abs(k * r) ** 2
    if size <= 0:
        along = -np.conj(k) / abs(k)
        off = c * np.conj(along)
        return complex((along * (off.real + np.sqrt(r * r - off.imag**2)) - c) / r)
    least = (c * np.conj(1 + k * c) - np.conj(k) * r * r - r) / size
    return complex((least / (1 - k * least) - c) / r)


def _with_reactance(omega: Floats, reactance: Floats, detuned: float) -> LosslessHand | None:
    """Return a hand with given reactances at given frequencies; None if there is no such hand."""
    heavy = reactance[0] > 0
    own = omega if heavy else -1 / omega
    left = (reactance - own * (reactance[0] / own[0]))[1:]
    pole2 = omega[1:] ** 2 * (1 + detuned * np.sign(left))
    shapes = np.column_stack([own, *(omega / (square - omega**2) for square in pole2)])
    if not np.all(np.isfinite(shapes)) or np.linalg.matrix_rank(shapes) < omega.size:
        return None
    value, *stiffness = np.linalg.solve(shapes, reactance).tolist()
    if min(value, *stiffness, value) < 0:
        return None
    resonators = tuple((k / square, k) for k, square in zip(stiffness, pole2.tolist(), strict=True) if k > 0)
    return LosslessHand(value, 0.0, resonators) if heavy else LosslessHand(0.0, value, resonators)


def _answer(device: Device, hand: LosslessHand, theta: complex) -> complex:
    """Return G_y in a hand at a complex angle."""
    at = theta + 2 * pi * np.arange(-SUMMED, SUMMED + 1)
    omega = at / device.sample_time
    mass, damping = _motor(device)
    beyond = hand.impedance(omega)
    if device.structure is not None:
        spring, handle, held = _handle(device, omega)
        beyond = 1 / (1 / spring + 1 / (1j * omega * handle + held + beyond))
    drive = _numbers(drive_at(device, theta, at, FLOATS))
    return complex(np.sum((2 * np.sin(theta / 2) / at) ** 2 * drive / (1j * omega * mass + damping + beyond)))


def _low_pass(device: Device, theta: complex) -> complex:
    """Return F."""
    found = firmware_filter(device, theta, FLOATS)
    return 1.0 if found is None else _number(found)


def _motor(device: Device) -> tuple[float, float]:
    """Return the mass and damping that the motor moves directly, including a rigid least operator."""
    held = device.operator if device.operator is not None else LeastOperator(0.0, 0.0)
    return device.motor_mass + held.mass, device.least_damping


def _handle(device: Device, omega: Floats) -> tuple[Floats, float, float]:
    """Return the impedance of a structure's spring, and the mass and damping of its handle."""
    assert device.structure is not None
    parts = mechanism(device, device.structure, FLOATS)
    return parts.viscosity + parts.stiffness / (1j * omega), parts.handle, parts.damping or 0.0


def _numbers(pair: Pair) -> Floats:
    return np.asarray(pair.re + 1j * pair.im)


def _number(pair: Pair) -> complex:
    return complex(np.ravel(_numbers(pair))[0])
