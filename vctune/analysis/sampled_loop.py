"""Evaluate the exact sampled loop at frequencies up to Nyquist, in double precision."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.circle import split_delay
from vctune.model.sampled.velocity_loop import (
    PlantLetGo,
    ReturnDifference,
    plant_let_go,
    return_difference,
    sensitivity_abs2,
    unturned,
)

ROUNDING_ERROR = 1e-15  # Coefficient of a polynomial, relative to the greatest, that is a rounding error
Complex = NDArray[np.complex128]


def plant_of(device: Device) -> PlantLetGo:
    """Return the sampled plant of a device, or of several devices whose numbers are arrays."""
    several = any(np.ndim(number) for number in device.numbers().values())
    return _sampled(device) if several else _sampled_once(device)


def _sampled(device: Device) -> PlantLetGo:
    whole, fraction = split_delay(device.delay, device.sample_time)
    return plant_let_go(device, whole, FLOATS, fractional=bool(np.any(fraction)))


# Return a device's plant from a cache, because all frequencies and all rounds of an exchange need the same matrix
# exponential
_sampled_once = lru_cache(maxsize=1024)(_sampled)


def return_difference_at(device: Device, omega: Floats, *, position: bool) -> ReturnDifference:
    """Return the parts of the loop's return difference at frequencies 0 < omega <= pi/T, rad/s."""
    return return_difference(plant_of(device), omega * device.sample_time, FLOATS, position=position)


def sensitivity_of(device: Device, gains: Gains) -> Callable[[Floats], Floats]:
    """Return |S| as a function of frequencies omega > 0, rad/s. The function samples the plant only once."""
    plant, position = plant_of(device), bool(np.any(gains.position))

    def sensitivity(omega: Floats) -> Floats:
        parts = return_difference(plant, omega * device.sample_time, FLOATS, position=position)
        return np.asarray(np.sqrt(sensitivity_abs2(parts, gains)))

    return sensitivity


def pulse_transfer(device: Device, omega: Floats, *, position: bool) -> tuple[Complex, Complex]:
    """Return G_v and G_x, from the held force to velocity and position, at omega > 0."""
    parts = return_difference_at(device, omega, position=position)
    open_loop, velocity, travel = (part.re + 1j * part.im for part in (parts.open, parts.velocity, parts.position))
    return velocity / open_loop, travel / open_loop


def loop_gain(device: Device, gains: Gains, omega: Floats) -> Complex:
    """Return L = K_v G_v + K_p G_x at omega > 0, so that S = 1/(1 + L)."""
    G_v, G_x = pulse_transfer(device, omega, position=bool(np.any(gains.position)))
    return gains.velocity * G_v + gains.position * G_x


def spectral_radius(device: Device, gains: Gains) -> float:
    """Return the greatest modulus of the sampled loop's poles; a multiple pole has half of a double's digits.

    The coefficients of their polynomial are the Fourier transform of its values on the circle.
    """
    plant = plant_of(device)
    count = plant.states + int(plant.plant.delays.loop) + 5
    theta = 2 * np.pi * np.arange(count) / count
    F = return_difference(plant, theta, FLOATS, position=gains.position > 0).closed(gains)
    polynomial = unturned(plant, F, theta, FLOATS)
    coefficients = np.fft.ifft(polynomial.re + 1j * polynomial.im).real
    rounded = np.where(np.abs(coefficients) < ROUNDING_ERROR * np.abs(coefficients).max(), 0.0, coefficients)
    return float(np.abs(np.roots(rounded)).max(initial=0.0))
