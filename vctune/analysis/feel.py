"""Compute how a device feels in the hand, in double precision (README.md, section 1)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from vctune.analysis.demands import response
from vctune.analysis.extrema import Floats, frequency_grid, with_resonance
from vctune.analysis.felt_impedance import impedance_felt
from vctune.analysis.sampled_loop import Complex
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair
from vctune.model.worlds import World

# Frequencies, Hz, at which the code evaluates mass and damping of free motion: the frequency of a slow reach, and the
# frequency of the fastest voluntary motion of an arm
FREE_HZ = (1.0, 10.0)
# Frequency, Hz, at which the code evaluates the wall: the upper end of voluntary motion and force
WALL_HZ = 10.0
HALF_POWER = sqrt(0.5)  # Value of |G_he| at which tracking ends: half the power
LOWEST = 1e-6  # Lowest frequency of the search for the end of tracking, relative to Nyquist: half a millihertz at 1 kHz
# Number of finer grids between the two neighbouring frequencies that enclose the end of tracking, and number of points
# of each grid
ZOOMS, ZOOM_POINTS = 3, 33
NO_LOOP = Gains(0.0, 0.0), Coupling(0.0, 0.0, 0.0)  # Gains and coupling that stand for the bare device: all 0


@dataclass(frozen=True, slots=True)
class Feel:
    """Values that describe how a device feels, with a design or without a loop."""

    mass: tuple[float | None, ...]  # apparent mass and damping in free motion at each of `FREE_HZ`, kg and N s/m
    damping: tuple[float | None, ...]
    stiffness: float | None  # stiffness of the stiffest wall at `WALL_HZ`, N/m
    tracking_bandwidth: float  # Hz


def feel(device: Device, gains: Gains, coupling: AnyCoupling) -> Feel:
    """Return how a device feels in the hand."""
    nyquist = 0.5 / device.sample_time
    free = [_free(device, gains, coupling, hz) if hz <= nyquist else None for hz in FREE_HZ]
    wall = None
    if nyquist >= WALL_HZ:
        omega = 2 * pi * WALL_HZ
        wall = omega * abs(complex(impedance_felt(device, gains, coupling, np.array([omega]), None)[0]))
    return Feel(
        mass=tuple(None if Z is None else Z.imag / (2 * pi * hz) for Z, hz in zip(free, FREE_HZ, strict=True)),
        damping=tuple(None if Z is None else Z.real for Z in free),
        stiffness=wall,
        tracking_bandwidth=_tracking_bandwidth(device, gains),
    )


def stiffness_in_contact(device: Device, gains: Gains, coupling: AnyCoupling) -> float:
    """Return the stiffness of a rigid wall at rest, N/m: at 10 Hz, inertia and damping count too."""
    omega = np.array([LOWEST * pi / device.sample_time])
    return float((1j * omega * impedance_felt(device, gains, coupling, omega, None))[0].real)


def _free(device: Device, gains: Gains, coupling: AnyCoupling, hz: float) -> complex:
    """Return the impedance of free motion."""
    omega = np.array([2 * pi * hz])
    return complex(impedance_felt(device, gains, coupling, omega, World(0.0, 0.0, 0.0))[0])


def _tracking_bandwidth(device: Device, gains: Gains) -> float:
    """Return the frequency up to which the handle follows its command, which is a velocity or a force, Hz."""
    grid = with_resonance(device, frequency_grid(LOWEST * pi / device.sample_time, pi / device.sample_time))
    for _ in range(1 + ZOOMS):
        below = np.flatnonzero(_tracking(device, gains, grid) < HALF_POWER)
        if not below.size:
            return 0.5 / device.sample_time
        if below[0] == 0:
            return 0.0
        low, high = grid[below[0] - 1], grid[below[0]]
        grid = np.geomspace(low, high, ZOOM_POINTS)
    return float(high) / (2 * pi)


def _tracking(device: Device, gains: Gains, omega: Floats) -> Floats:
    """Return |G_he|, or |A H/N| for an impedance display."""
    loop = response(device, gains, omega)
    if device.kind.inverse:
        at = device_response(device, omega, FLOATS)
        N = 1.0 if loop.numerator is None else _complex(loop.numerator)
        return np.abs((at.drive.re - 1j * omega * at.drive.lag) / N)
    return np.abs(1 - _complex(loop.miss_scaled) / _complex(loop.D_scaled))


def sensor_miss(device: Device, omega: Floats) -> Floats | None:
    """Return |1 - F_s|, the error of the sensed force; None if it is 0."""
    sensor = device_response(device, omega, FLOATS).sensor
    return None if sensor is None else np.abs(omega * omega * sensor.loss + 1j * omega * sensor.lag)


def _complex(pair: Pair) -> Complex:
    return np.asarray(pair.re + 1j * pair.im)
