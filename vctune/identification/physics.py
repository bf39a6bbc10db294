"""The responses of a device with which recordings are compared."""

from __future__ import annotations

from dataclasses import replace
from math import ceil

import numpy as np

from vctune.analysis.sampled_loop import pulse_transfer
from vctune.document.recording import Floats
from vctune.identification.study import Complex
from vctune.model.device import Device
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS


def drive(device: Device, omega: Floats) -> Complex:
    """Return A H e^(-s delay), the response of the motor's force to the held command."""
    at = device_response(device, omega, FLOATS).drive
    return np.asarray(at.re - 1j * omega * at.lag)


def compliances(device: Device, omega: Floats) -> tuple[Complex, Complex]:
    """Return the responses of motor and handle to a force on the motor, m/N."""
    at = device_response(replace(device, delay=0.0, actuator=None, velocity=None), omega, FLOATS)
    s = 1j * omega
    Z_1 = at.damping + s * at.mass
    if at.spring is None:
        return 1 / (s * Z_1), 1 / (s * Z_1)
    y = omega**2 * at.spring.y_c + 1j * omega * at.spring.y_k
    Z_2 = (at.spring.damping or 0.0) + s * at.spring.mass
    motor = 1 / (s * (Z_1 + Z_2 / (1 + y * Z_2)))
    return motor, motor / (1 + y * Z_2)


def held_compliance(device: Device, omega: Floats) -> Complex:
    """Return the exact response of the motor at the samples to a command that is held between them, m/N."""
    T = device.sample_time
    early = max(0, ceil(-float(device.delay) / T))
    there = replace(device, delay=float(device.delay) + early * T, velocity=None)
    return np.asarray(pulse_transfer(there, omega, position=True)[1] * np.exp(1j * omega * T * early))
