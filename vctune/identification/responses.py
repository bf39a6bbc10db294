"""The sampled responses of a device to what a log contains: held commands, or a measured force (README, section 4)."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, pi, sqrt

import numpy as np

from vctune.analysis.sampled_loop import pulse_transfer
from vctune.document.recording import Floats
from vctune.identification.study import Complex
from vctune.model.device import Device
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS


def held_compliance(device: Device, omega: Floats) -> Complex:
    """Return the exact response of the motor at the samples to a command that is held between them, m/N."""
    T = device.sample_time
    early = max(0, ceil(-float(device.delay) / T))
    there = replace(device, delay=float(device.delay) + early * T, velocity=None)
    return np.asarray(pulse_transfer(there, omega, position=True)[1] * np.exp(1j * omega * T * early))


def compliance(device: Device, omega: Floats) -> Complex:
    """Return the response of the motor to a force on it that is a continuous signal, m/N."""
    at = device_response(replace(device, delay=0.0, actuator=None, velocity=None), omega, FLOATS)
    s = 1j * omega
    Z_1 = at.damping + s * at.mass
    if at.spring is None:
        return np.asarray(1 / (s * Z_1))
    y = omega**2 * at.spring.y_c + 1j * omega * at.spring.y_k
    Z_2 = (at.spring.damping or 0.0) + s * at.spring.mass
    return np.asarray(1 / (s * (Z_1 + Z_2 / (1 + y * Z_2))))


LAGS = {1: 1.0, 2: sqrt(2)}  # Lag of a low-pass, times its angular frequency, by its order


def modes(bandwidth_hz: float, order: int) -> tuple[float, complex, complex]:
    """Return the lag of a low-pass, a pole, and the weight of its decay in a step of the velocity."""
    w = 2 * pi * bandwidth_hz
    if order == 1:
        return 1 / w, complex(-w), complex(1 / w)
    pole = w * complex(-1, 1) / sqrt(2)
    return sqrt(2) / w, pole, 2 * w**2 / (pole**2 * 2 * (pole + w / sqrt(2)))


def servo_response(omega: Floats, T: float, delay: float, bandwidth_hz: float, order: int) -> Complex:
    """Return the exact response from a held velocity to the velocity between two samples of the position."""
    lag, pole, residue = modes(bandwidth_hz, order)
    whole = np.ceil(delay / T)
    since, w = whole * T - delay, np.exp(-1j * omega * T)
    pairs = [(residue, pole)] if order == 1 else [(residue / 2, pole), (np.conj(residue) / 2, np.conj(pole))]
    left = sum((1 - w) * r * np.exp(p * since) / (1 - np.exp(p * T) * w) for r, p in pairs)
    return np.asarray(w**whole * (T * w + (1 - w) * (since - lag + left)) / T)
