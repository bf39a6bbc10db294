"""Which part of a device is how late: phases around the velocity loop and along the force path, in double precision.

See model/README.md, sections 1, 2 and 7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.analysis.extrema import Floats, frequency_grid
from vctune.analysis.resonance import with_resonance
from vctune.analysis.sampled_loop import Complex, loop_gain
from vctune.model.arithmetic import FLOATS
from vctune.model.device_response import DeviceResponse, device_response, hold_response
from vctune.model.filters import FilterResponse, actuator_response, force_sensor_response
from vctune.model.quantities import Device, Gains

DECADES_BELOW_NYQUIST = 7
"""How far below Nyquist a crossover is looked for: no loop is as slow. Half misses those of slow loops, twice is
time for nothing."""
POINTS_PER_DECADE = 100
"""Of the grid on which it is found. Half: two crossings within 5 % are missed together. Twice: twice the time."""
ZOOMS, ZOOM_POINTS = 5, 33
"""How often the interval of the grid is divided, and into how many points: to 1e-9 of it, beyond what is shown. Half
shows; twice is rounding."""

SENSOR, SENSOR_DELAY, ESTIMATE, LAW = "force sensor", "force sensor's delay", "velocity estimate", "velocity law"
HOLD, DELAY, ACTUATOR, MECHANISM = "hold", "delay", "actuator", "mechanism"
FEEDBACK, ALIASES = "feedback", "aliases of sampling"
PARTS = (SENSOR, SENSOR_DELAY, ESTIMATE, LAW, HOLD, DELAY, ACTUATOR, MECHANISM, FEEDBACK, ALIASES)
"""What has a phase, as it is called on a page, from the hand on."""


@dataclass(frozen=True, slots=True)
class Phases:
    """The share of each part in a phase at one frequency.

    Attributes
    ----------
    omega : rad/s
    shares : by part, rad; only of parts that there are
    """

    omega: float
    shares: dict[str, float]

    @property
    def total(self) -> float:
        """All of them together, rad."""
        return sum(self.shares.values())


def crossover(device: Device, gains: Gains) -> float | None:
    """Return the highest frequency at which the sampled loop has |L| = 1, rad/s; None where it has none.

    Parameters
    ----------
    device : Device
    gains : K_v, K_p, N s/m and N/m
    """
    if not gains.closed:
        return None
    nyquist = pi / device.sample_time
    grid = with_resonance(device, frequency_grid(nyquist * 10.0**-DECADES_BELOW_NYQUIST, nyquist, POINTS_PER_DECADE))
    for _ in range(1 + ZOOMS):
        above = np.abs(loop_gain(device, gains, grid)) > 1
        crossings = np.flatnonzero(above[:-1] != above[1:])
        if not crossings.size:
            return None
        last = int(crossings[-1])
        grid = np.geomspace(grid[last], grid[last + 1], ZOOM_POINTS)
    return float(grid[ZOOM_POINTS // 2])


def loop_phases(device: Device, gains: Gains, omega: float) -> Phases:
    """Return what each part takes from the phase of L = A H (K_v F + K_p/s) P_mu of the sampled loop.

    What sampling adds to the frequency model is a share of its own. The hold is the exact one: it is what runs.

    Parameters
    ----------
    device : Device
    gains : K_v, K_p, N s/m and N/m
    omega : rad/s, 0 < omega <= pi/T
    """
    at = device_response(device, np.array(omega), FLOATS)
    estimate = 1.0 if at.estimate is None else _response(at.estimate, omega)
    law = gains.velocity + gains.position / (1j * omega)
    shares = {LAW: _angle(law)} if gains.position > 0 else {}
    if device.velocity is not None:
        shares[ESTIMATE] = _angle((gains.velocity * estimate + gains.position / (1j * omega)) / law)
    shares |= _drive_phases(replace(device, hold="zoh"), omega)
    shares[MECHANISM] = _angle(_P_mu(at))
    L = complex(loop_gain(device, gains, np.array([omega]))[0])
    shares[ALIASES] = _angle(L * np.exp(-1j * sum(shares.values())))
    return Phases(omega, shares)


def force_phases(device: Device, gains: Gains, omega: float) -> Phases:
    """Return what each part adds to the phase of q = F_s G_he, with G_he = P_hu C_0/(1 + P_mu C_f).

    The feedback, 1/(1 + P_mu C_f), makes up for most of what is late within the loop; nothing does for the force
    sensor.

    Parameters
    ----------
    device : Device
    gains : K_v, K_p, N s/m and N/m
    omega : rad/s, > 0
    """
    at = device_response(device, np.array(omega), FLOATS)
    shares = {}
    if device.force_sensor is not None:
        low_pass = force_sensor_response(replace(device.force_sensor, delay=0.0), np.array(omega), FLOATS)
        shares = {SENSOR: _angle(_response(low_pass, omega))} if low_pass is not None else {}
        shares |= {SENSOR_DELAY: -omega * device.force_sensor.delay} if device.force_sensor.delay > 0 else {}
    estimate = 1.0 if at.estimate is None else _response(at.estimate, omega)
    drive, integral = complex(at.drive.re, -omega * at.drive.lag), gains.position / (1j * omega)
    C_f, P_mu = drive * (gains.velocity * estimate + integral), _P_mu(at)
    shares |= {LAW: _angle(gains.velocity + integral)} if gains.position > 0 else {}
    shares |= _drive_phases(device, omega)
    shares[MECHANISM] = _angle(P_mu) - _angle(_bent(at))
    shares[FEEDBACK] = -_angle(1 + P_mu * C_f)
    return Phases(omega, shares)


def sensor_miss(device: Device, omega: Floats) -> Floats | None:
    """Return |1 - F_s|, by how much the sensed force misses the hand's; None where it is the same.

    Parameters
    ----------
    device : Device
    omega : rad/s, > 0, shape (n,)
    """
    sensor = device_response(device, omega, FLOATS).sensor
    return None if sensor is None else np.abs(omega * omega * sensor.curvature + 1j * omega * sensor.lag)


def _drive_phases(device: Device, omega: float) -> dict[str, float]:
    """Return the phases of hold, delay and actuator."""
    held = hold_response(replace(device, delay=0.0), np.array(omega), FLOATS)
    shares = {HOLD: _angle(complex(held.re, -omega * held.lag))}
    shares |= {DELAY: -omega * device.delay} if device.delay > 0 else {}
    if device.actuator is not None:
        shares[ACTUATOR] = _angle(_response(actuator_response(device.actuator, np.array(omega), FLOATS), omega))
    return shares


def _P_mu(at: DeviceResponse) -> complex:
    """Return the admittance from the motor's force to its velocity."""
    Z_1 = complex(at.damping, at.omega * at.mass)
    if at.spring is None:
        return 1 / Z_1
    bent = _bent(at)
    return bent / (Z_1 * bent + _handle(at))


def _bent(at: DeviceResponse) -> complex:
    """Return P_mu/P_hu = 1 + y Z_2: what the spring between motor and handle takes from the handle, at 0 to 180 deg."""
    if at.spring is None:
        return 1 + 0j
    return 1 + complex(at.omega * at.omega * at.spring.y_c, at.omega * at.spring.y_k) * _handle(at)


def _handle(at: DeviceResponse) -> complex:
    assert at.spring is not None
    return complex(at.spring.damping or 0.0, at.omega * at.spring.mass)


def _response(filter_: FilterResponse, omega: float) -> complex:
    return complex(filter_.re, -omega * filter_.lag)


def _angle(value: complex | Complex) -> float:
    return float(np.angle(value))
