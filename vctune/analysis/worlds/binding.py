"""Find the environment with which a design has the least reserve, with its hand and frequency."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, pi, tan

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, coupling_impedance, series_coupling
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, delays_of, plant_in_hand
from vctune.model.worlds import World, Worlds

LEAST = 1e-6  # Distance, rad, of an angle from 0 and pi within which no environment has a reactance


def binding_world(
    device: Device,
    gains: Gains,
    coupling: AnyCoupling,
    hand: Hand,
    omega: float,
    factor: float,
    worlds: Worlds | None = None,
) -> World | None:
    """Return the environment without additional damping; None near angles 0 and pi, where any environment suffices."""
    theta = omega * device.sample_time
    if not LEAST < theta < pi - LEAST:
        return None
    u = 2 / device.sample_time * tan(theta / 2)
    if device.kind.inverse and worlds is None:  # the reaction is an admittance, as are 1/(mass s) and s/stiffness
        met = -reaction(device, gains, coupling, hand, theta, factor).imag
        return World(0.0, 0.0, u / met) if met > 0 else World(-1 / (met * u), 0.0, 0.0) if met < 0 else None
    met = -impedance_met(device, gains, coupling, hand, factor)(theta).imag
    low, high = (worlds.low, worlds.high) if worlds else (World(0.0, 0.0, 0.0), World(inf, inf, inf))
    mass = (met + low.stiffness / u) / u
    if mass >= low.mass:
        return World(min(mass, high.mass), low.damping, low.stiffness)
    return World(low.mass, low.damping, min((low.mass * u - met) * u, high.stiffness))


def reaction(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, theta: complex, factor: float = 1.0
) -> complex:
    """Return Z_c/factor + Z_seen; for an impedance display 1/Z_c/factor + G_y/(1 + K_v F G_y)."""
    return reaction_in(device, gains, coupling, hand, factor)(theta)


def reaction_in(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return `reaction` as a function of the angle, to evaluate it at many angles."""
    plant = plant_in_hand(device, hand, delays_of(device), FLOATS)

    def at(theta: complex) -> complex:
        if isinstance(coupling, SpringDamper):
            return _met(plant, gains, theta) + _given(coupling, device, theta) / factor
        return _seen(plant, gains, theta) + _coupling(coupling, _warped(theta, device.sample_time)) / factor

    return at


def impedance_met(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return the impedance that an environment meets as a function of the angle: Z_c/factor + Z_seen, or its dual."""
    alone = reaction_in(device, gains, coupling, hand, factor)
    return (lambda theta: 1 / alone(theta)) if device.kind.inverse else alone


def _warped(theta: complex, sample_time: float) -> complex:
    """Return the frequency (2/T) tan(theta/2) of the trapezoidal rule, rad/s."""
    return complex(2 / sample_time * np.tan(theta / 2))


def _coupling(coupling: AnyCoupling, omega: complex) -> complex:
    Z_c = coupling_impedance(series_coupling(coupling), omega)
    return complex(Z_c.re + 1j * Z_c.im)


def _given(coupling: SpringDamper, device: Device, theta: complex) -> complex:
    """Return 1/Z_c."""
    low_pass = firmware_filter(device, theta, FLOATS)
    found = spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS)
    return complex(found.re + 1j * found.im)


def _met(plant: AnyPlantInHand, gains: Gains, theta: complex) -> complex:
    """Return G_y/(1 + K_v F G_y) = s P/(2 j F) of an impedance display."""
    return _seen(plant, gains, theta) * complex(np.sin(theta / 2) ** 2)


def _seen(plant: AnyPlantInHand, gains: Gains, theta: complex) -> complex:
    """Return Z_seen = P/(2 j s F)."""
    loop, s = loop_in_hand(plant, theta, FLOATS), complex(np.sin(theta / 2))
    F, P = loop.closed(gains), loop.numerator(gains)
    even, odd = P.even * F.even + s * s * (P.odd * F.odd), P.odd * F.even - P.even * F.odd
    size = F.even * F.even + s * s * (F.odd * F.odd)
    return complex(odd / (2 * size) - 1j * (even / (2 * s * size)))
