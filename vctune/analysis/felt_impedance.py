"""Compute the impedance that the hand feels at the handle, exactly in the sampled loop (README.md, section 1).

The hand pushes with a force of one frequency. The firmware samples what it measures, with all aliases, and holds its
command; of the motion the part at that frequency counts. With P the mechanism's responses, u = U e^(j theta k) the
commands and H the hold with its delay and the actuator, v_h = P_hh f_h + P_hu H U.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.sampled_loop import Complex
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.sampled.hand_loop import CommandInHand, loop_in_hand
from vctune.model.sampled.impedance_display import firmware_filter, spring_damper_admittance
from vctune.model.sampled.loop_in_worlds import offered_at
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import World

NOBODY = Hand(0, 0, 0)


def impedance_felt(
    device: Device, gains: Gains, coupling: AnyCoupling, omega: Floats, environment: World | None
) -> Complex:
    """Return what the hand feels of a design before an environment by the trapezoidal rule, None for a rigid one.

    The frequencies are > 0, rad/s; the impedance is in N s/m.
    """
    device = replace(device.undisturbed.bare, hold="zoh")
    at, theta = device_response(device, omega, FLOATS), omega * device.sample_time
    s = np.asarray(1j * omega, np.complex128)
    drive = at.drive.re - s * at.drive.lag
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.inf if environment is None else _rendered(environment, device, theta)
        if device.servo is not None:
            beyond = beyond + _offered(coupling, device, theta) + _pulled(device, theta)
            return np.asarray(beyond / (_sensed(at, s) * drive))
        P = _mechanism(at, s)
        if isinstance(coupling, SpringDamper):
            command = _inverse(device, gains, coupling, at, theta, beyond, P)
        else:
            command = _forward(device, gains, coupling, at, theta, beyond, P)
        return np.asarray(1 / (P.hand + P.across * drive * command))


class _Mechanism(NamedTuple):
    """The responses of handle to hand, of handle to motor, and of what is sensed to hand, without a loop, m/(N s)."""

    hand: Complex
    across: Complex
    sensed: Complex


def _mechanism(at: DeviceResponse, s: Complex) -> _Mechanism:
    """Go from the motor to the handle: v + y F moves the mass behind a spring of force F, and F + Z v acts there."""
    v, F = 1 + 0 * s, at.mass * s + at.damping
    for spring in at.springs:
        handle = spring.mass * s + (0.0 if spring.damping is None else spring.damping)
        v = v + (-s * s * spring.y_c + s * spring.y_k) * F
        F = F + handle * v
    return _Mechanism(v / F, 1 / F, v / F if at.at_handle else 1 / F)


def _forward(
    device: Device, gains: Gains, coupling: AnyCoupling, at: DeviceResponse, theta: Floats, beyond: Any, P: _Mechanism
) -> Complex:
    """Return the command of an admittance display per force of the hand."""
    s, z, T = 1j * at.omega, np.exp(1j * theta), device.sample_time
    loop, opened = _let_go(device, theta)
    L = gains.velocity * _complex(loop.velocity, theta) + gains.position * _complex(loop.position, theta)
    ahead = T * z / (z - 1) if device.summed else T / (2j * np.tan(theta / 2))
    wanted = _sensed(at, s) / (_offered(coupling, device, theta) + beyond)
    asked = (gains.velocity + gains.position * ahead) * wanted if gains.closed else 0.0
    moved = (gains.velocity * _estimated(at, s) + gains.position / s) * P.sensed
    return np.asarray((asked - moved) / (1 + L / opened))


def _inverse(
    device: Device, gains: Gains, coupling: SpringDamper, at: DeviceResponse, theta: Floats, beyond: Any, P: _Mechanism
) -> Complex:
    """Return the command of an impedance display per force of the hand."""
    s, back = 1j * at.omega, (1 - np.exp(-1j * theta)) / device.sample_time
    loop, opened = _let_go(device, theta)
    damping, stiffness = gains.velocity + 0j, 0j * theta  # that act on the estimate, and on the position
    met = np.any(beyond != 0)
    if met and device.differences:
        stiffness = back / (_compliance(coupling, device, theta) + 1 / beyond)
    elif met:  # two signals drive the coupling, of whose force the environment takes a share
        compliance = _compliance(coupling, device, theta)
        share = compliance / (compliance + 1 / beyond)
        damping, stiffness = damping + coupling.damping * share, coupling.stiffness * share
    L = damping * _complex(loop.velocity, theta) + stiffness * _complex(loop.position, theta)
    return np.asarray(-(damping * _estimated(at, s) + stiffness / s) * P.sensed / (1 + L / opened))


def _let_go(device: Device, theta: Floats) -> tuple[Any, Complex]:
    """Return the sampled loop of a device that nobody holds, and its return difference without gains."""
    loop = loop_in_hand(plant_in_hand(device.sensing_at_once, NOBODY, delays_of(device), FLOATS), theta, FLOATS)
    assert not isinstance(loop, CommandInHand)
    return loop, _complex(loop.open, theta)


def _rendered(environment: World, device: Device, theta: Floats) -> Complex:
    """Return Z_e by the trapezoidal rule."""
    s = 2j / device.sample_time * np.tan(theta / 2)
    return np.asarray(environment.mass * s + environment.damping + environment.stiffness / s)


def _offered(coupling: AnyCoupling, device: Device, theta: Floats) -> Complex:
    """Return Z_c as the firmware runs it."""
    assert not isinstance(coupling, SpringDamper)
    found = offered_at(coupling, device.sample_time, device.rule, theta, FLOATS)
    return np.asarray(found.resistance + 1j * found.reactance / np.cos(theta / 2))


def _compliance(coupling: SpringDamper, device: Device, theta: Floats) -> Complex:
    """Return 1/Z_c as the firmware runs it."""
    low_pass = firmware_filter(device, theta, FLOATS)
    given = spring_damper_admittance(coupling, device.sample_time, low_pass, theta, FLOATS)
    return np.asarray(given.re + 1j * given.im)


def _pulled(device: Device, theta: Floats) -> Complex:
    """Return what the firmware's own spring adds to the impedance of a servo."""
    loop = loop_in_hand(plant_in_hand(device, NOBODY, delays_of(device), FLOATS), theta, FLOATS)
    assert isinstance(loop, CommandInHand)
    return np.asarray(_complex(loop.seen, theta) / (2j * np.sin(theta / 2)))


def _sensed(at: DeviceResponse, s: Complex) -> Complex:
    """Return the sensed force per force of the hand."""
    return np.asarray(1.0 + 0 * s if at.sensor is None else at.sensor.re - s * at.sensor.lag)


def _estimated(at: DeviceResponse, s: Complex) -> Complex:
    """Return the estimate of the velocity per velocity of the motor."""
    return np.asarray(1.0 + 0 * s if at.estimate is None else at.estimate.re - s * at.estimate.lag)


def _complex(number: EvenOdd | Pair, theta: Floats) -> Complex:
    if isinstance(number, Pair):
        return np.asarray(number.re + 1j * number.im)
    return np.asarray(number.even + 1j * np.sin(theta / 2) * number.odd)
