"""Compute the exact limits of R and Re Z_c at the ends of the frequency axis. See model/README.md, sections 6, 9 and
12."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from math import inf

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.matrices import add


@dataclass(frozen=True, slots=True)
class EndLimit:
    """Re Z_c and R at an end of the frequency axis. If both vanish, both are divided by the same positive power of
    omega."""

    coupling: Number  # the limit of Re Z_c
    required: Number  # the limit of R; inf if no coupling suffices


@dataclass(frozen=True, slots=True)
class Lags:
    """The lags of a device's parts for omega -> 0, and the loss and the compliance of the device's springs."""

    drive: Number  # tau, the lag of hold, delay and actuator; for a servo of hold, delay, low-pass and interpolation, s
    estimate: Number  # lags of the velocity estimate and of the force sensor, s
    sensor: Number
    loss: Number  # c/k^2 of the springs, m s/N
    compliance: Number  # 1/k of the springs, m/N


def lags(device: Device, ops: Arithmetic) -> Lags:
    """Return the lags of a device's parts for omega -> 0 (model/README.md, section 12)."""
    at = device_response(device, 0 * device.sample_time, ops)
    return Lags(
        drive=at.drive.lag,
        estimate=0 if at.estimate is None else at.estimate.lag,
        sensor=0 if at.sensor is None else at.sensor.lag,
        loss=reduce(add, (spring.y_c for spring in at.springs), 0),
        compliance=reduce(add, (spring.y_k for spring in at.springs), 0),
    )


def low_frequency_limit(device: Device, gains: Gains, coupling: Coupling, ops: Arithmetic = FLOATS) -> EndLimit:
    """Return the limits of Re Z_c and R for omega -> 0, for an admittance display with any hold."""
    at, b = lags(device, ops), device.damping
    mass = device.mass
    K_v, K_p, b_0 = gains.velocity, gains.position, coupling.drag
    integral = not _is_zero(K_p)
    told = K_v - at.drive * K_p if integral else K_v
    n = 1 + K_p * at.compliance
    operator = device.operator.damping if device.operator is not None else 0
    resistance = b + told + K_p * K_p * at.loss + operator * (n * n)
    coupling_limit = coupling.mass * coupling.mass / coupling.damping if _is_zero(b_0) else b_0
    if resistance < 0 or _is_zero(resistance):
        return EndLimit(coupling_limit, inf)
    late = b + at.sensor * K_p if integral else b
    if not _is_zero(operator):
        # Re(C conj N) of C -> told - tau_s K_p - j K_p/omega and N -> n + j omega n'
        slope = at.loss * -K_p + at.compliance * (b + told)
        met = (told - at.sensor * K_p) * n - K_p * slope if integral else K_v
        return EndLimit(b_0, ((late * late if integral else 0) - 4 * operator * met) / (4 * resistance))
    if integral:
        return EndLimit(coupling_limit, 0) if _is_zero(late) else EndLimit(b_0, late * late / (4 * resistance))
    inertia = mass + b * at.drive - K_v * at.estimate + at.sensor * (b + K_v)
    return EndLimit(coupling_limit, K_v * inertia * inertia / (4 * resistance * resistance) if _is_zero(b_0) else 0)


def high_frequency_limit(device: Device, gains: Gains, coupling: Coupling) -> EndLimit:
    """Return the limits for omega -> inf, for an ideal device with hold "lag" and no delay."""
    needed = 2 * device.mass * gains.velocity / device.sample_time
    damping = device.damping if device.operator is None else device.damping + device.operator.damping
    required = needed / damping if not _is_zero(damping) else inf
    of_branch = 0 if coupling.rigid or _is_zero(coupling.mass) else coupling.damping
    return EndLimit(of_branch + coupling.drag, required)


def _is_zero(x: Number) -> bool:
    return bool(x == 0)
