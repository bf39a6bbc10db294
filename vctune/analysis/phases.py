"""Compute the phase of each part of a device around the velocity loop and along the force path, in double precision.
See model/README.md, sections 1, 7 and 12."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.margins import unit_gain_frequencies
from vctune.analysis.sampled_loop import Complex, loop_gain
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.affine import Affine, LoopConstants, loop_constants
from vctune.model.loop.device_response import device_response, hold_response
from vctune.model.loop.drive import drive_response
from vctune.model.loop.filters import FilterResponse, sensor_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair

SENSOR, SENSOR_DELAY, ESTIMATE, LAW = "force sensor", "force sensor's delay", "velocity estimate", "velocity law"
HOLD, DELAY, ACTUATOR, MECHANISM = "hold", "delay", "actuator", "mechanism"
FEEDBACK, ALIASES = "feedback", "aliases of sampling"
# Names of the parts with a phase, in the order of the report's page, which begins at the hand
PARTS = (SENSOR, SENSOR_DELAY, ESTIMATE, LAW, HOLD, DELAY, ACTUATOR, MECHANISM, FEEDBACK, ALIASES)


@dataclass(frozen=True, slots=True)
class Phases:
    """The share of each part in a phase at one frequency."""

    omega: float  # frequency, rad/s
    shares: dict[str, float]  # phase of each existing part, rad

    @property
    def total(self) -> float:
        """The sum of all shares, rad."""
        return sum(self.shares.values())


def crossover(device: Device, gains: Gains) -> float | None:
    """Return the highest frequency at which the sampled loop has |L| = 1, rad/s; None if there is no such frequency."""
    if not gains.closed:
        return None
    crossings = unit_gain_frequencies(device, gains)
    return float(crossings[-1]) if crossings.size else None


def loop_phases(device: Device, gains: Gains, omega: float) -> Phases:
    """Return the contribution of each part to the phase of L = A H (K_v F + K_p/s) P_mu of the sampled loop."""
    known = _constants(device, omega)
    shares = _law_phase(gains, omega)
    if device.velocity is not None:
        C_f = Affine(None, known.motor.velocity, known.motor.position)
        shares[ESTIMATE] = _angle(_number(C_f.closed(gains)) / _number(known.controller.closed(gains)))
    shares |= _drive_phases(replace(device, hold="zoh"), omega)
    shares[MECHANISM] = _angle(_number(known.factor) / _without_loop(known))
    L = complex(loop_gain(device, gains, np.array([omega]))[0])
    shares[ALIASES] = _angle(L * np.exp(-1j * sum(shares.values())))
    return Phases(omega, shares)


def force_phases(device: Device, gains: Gains, omega: float) -> Phases:
    """Return the contribution of each part to the phase of q = F_s G_he, with G_he = P_hu C_0/(1 + P_mu C_f)."""
    known, sensor = _constants(device, omega), device.sensing
    low_pass = sensor_response(replace(sensor, delay=0.0), np.array(omega), FLOATS)
    shares = {SENSOR: _angle(_response(low_pass, omega))} if low_pass is not None else {}
    shares |= {SENSOR_DELAY: -omega * sensor.delay} if sensor.delay > 0 else {}
    shares |= _law_phase(gains, omega)
    shares |= _drive_phases(device, omega)
    idle, e = _without_loop(known), _number(known.factor)
    shares[MECHANISM] = _angle(e / idle) - _angle(e)  # two angles: beyond a resonance, this phase passes -180 deg
    shares[FEEDBACK] = -_angle(_number(known.D.closed(gains)) / idle)
    return Phases(omega, shares)


def sensor_miss(device: Device, omega: Floats) -> Floats | None:
    """Return |1 - F_s|, the error of the sensed force; None if it is 0."""
    sensor = device_response(device, omega, FLOATS).sensor
    return None if sensor is None else np.abs(omega * omega * sensor.loss + 1j * omega * sensor.lag)


def _drive_phases(device: Device, omega: float) -> dict[str, float]:
    """Return the phases of hold, delay and actuator."""
    held = hold_response(replace(device, delay=0.0), np.array(omega), FLOATS)
    shares = {HOLD: _angle(complex(held.re, -omega * held.lag))}
    shares |= {DELAY: -omega * device.delay} if device.delay > 0 else {}
    late = drive_response(device, np.array(omega), FLOATS)
    shares |= {ACTUATOR: _angle(_response(late, omega))} if late is not None else {}
    return shares


def _constants(device: Device, omega: float) -> LoopConstants:
    return loop_constants(device_response(device, np.array(omega), FLOATS))


def _without_loop(known: LoopConstants) -> complex:
    """Return D of the device with all gains 0."""
    assert known.D.constant is not None
    return _number(known.D.constant)


def _law_phase(gains: Gains, omega: float) -> dict[str, float]:
    """Return the phase of K_v + K_p/s, if the law is not 0."""
    return {LAW: _angle(complex(gains.velocity, -gains.position / omega))} if gains.position > 0 else {}


def _number(pair: Pair) -> complex:
    return complex(pair.re, pair.im)


def _response(filter_: FilterResponse, omega: float) -> complex:
    return complex(filter_.re, -omega * filter_.lag)


def _angle(value: complex | Complex) -> float:
    return float(np.angle(value))
