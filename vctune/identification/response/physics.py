"""Model the device in the fit of a response: its parameters for each structure, and their effect on a line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.sampled_loop import pulse_transfer
from vctune.document.recording import Floats
from vctune.model.device import Device
from vctune.model.hands import LeastOperator
from vctune.model.loop.device_response import device_response, mechanism
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure

Complex = NDArray[np.complex128]
RIGID = ("mass", "damping", "coulomb", "delay")
SPRING = ("handle_mass", "frequency_hz", "damping_ratio")
SCALED = ("mass", "handle_mass", "frequency_hz", "lag")  # Names of the positive parameters


@dataclass(frozen=True, slots=True)
class Candidate:
    """A structure that the device may have."""

    masses: int  # number of masses, 1 or 2
    lag: bool  # whether there is a first-order actuator between command and motor
    damped_handle: bool = False  # whether the handle has its own damping, which a problem file cannot state

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the structure's parameters."""
        return (
            RIGID
            + (SPRING if self.masses == 2 else ())
            + (("handle_damping",) if self.damped_handle else ())
            + (("lag",) if self.lag else ())
        )

    def __str__(self) -> str:
        parts = ["one mass", "two masses"][self.masses - 1], "actuator" * self.lag, "damped handle" * self.damped_handle
        return ", ".join(part for part in parts if part)


def device_of(numbers: Mapping[str, float], sample_time: float, actuator: Actuator | None = None) -> Device:
    """Return the device with given parameters."""
    structure = None
    if "handle_mass" in numbers:
        damped = numbers.get("handle_damping")
        load = None if damped is None else LeastOperator(0.0, damped)
        structure = Structure(numbers["handle_mass"], numbers["frequency_hz"], numbers["damping_ratio"], load)
    if "lag" in numbers:
        actuator = Actuator(1 / (2 * pi * numbers["lag"]))
    return Device(
        numbers["mass"], numbers["damping"], sample_time, numbers["delay"], actuator=actuator, structure=structure
    )


def compliances(device: Device, omega: Floats) -> tuple[Complex, Complex]:
    """Return the responses of motor and handle to a force on the motor, m/N."""
    at = device_response(
        Device(device.mass, device.damping, device.sample_time, structure=device.structure), omega, FLOATS
    )
    s = 1j * omega
    Z_1 = at.damping + s * at.mass
    if at.spring is None:
        motor = 1 / (s * Z_1)
        return motor, motor
    y = omega**2 * at.spring.y_c + 1j * omega * at.spring.y_k
    Z_2 = (at.spring.damping or 0.0) + s * at.spring.mass
    carried = 1 + y * Z_2
    motor = 1 / (s * (Z_1 + Z_2 / carried))
    return motor, motor / carried


def held_compliance(device: Device, omega: Floats) -> Complex:
    """Return the exact response of the motor at the samples to a command that is held between them, m/N."""
    T = device.sample_time
    early = max(0, ceil(-float(device.delay) / T))
    there = replace(device, delay=float(device.delay) + early * T, velocity=None)
    return np.asarray(pulse_transfer(there, omega, position=True)[1] * np.exp(1j * omega * T * early))


def antiresonance_hz(device: Device) -> float | None:
    """Return the antiresonance of the motor, at which only the handle oscillates, Hz; None if the device is rigid."""
    if device.structure is None:
        return None
    return sqrt(mechanism(device, device.structure, FLOATS).stiffness / device.structure.handle_mass) / (2 * pi)
