"""Say whether dry friction holds a device between two readings of its encoder (model/README.md, section 20)."""

from __future__ import annotations

from fractions import Fraction
from math import ceil, exp, floor, inf, log, log10, pi

import numpy as np

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.loop.filters import velocity_sections
from vctune.model.numbers.arithmetic import FLOATS, Floats
from vctune.model.sections import rows_of_sections

# An impulse response is computed until its slowest pole has fallen to this share, within these numbers of samples
DIED_AWAY, LEAST_SAMPLES, MOST_SAMPLES = 1e-9, 16, 10**6
DIGITS = 8  # Number of significant digits to which the greatest stiffness at rest is rounded down, those of a design


def stiffness_read(gains: Gains, coupling: AnyCoupling) -> float:
    """Return the stiffness that acts on the read position, N/m: k_c of an impedance display, else K_p."""
    return float(coupling.stiffness if isinstance(coupling, SpringDamper) else gains.position)


def damping_read(device: Device, gains: Gains, coupling: AnyCoupling) -> float:
    """Return the damping that acts on the differenced position, N s/m."""
    return 0.0 if not device.differences else damping_acting(gains, coupling)


def damping_acting(gains: Gains, coupling: AnyCoupling) -> float:
    """Return the damping that acts on the velocity estimate, N s/m."""
    return float(gains.velocity + (coupling.damping if isinstance(coupling, SpringDamper) else 0.0))


def read_in_steps(device: Device) -> float | None:
    """Return the step q of the position that the firmware reads, m; None if it is not known."""
    return None if device.velocity is None else device.velocity.resolution


def rests(design: Design) -> bool | None:
    """Return whether k q <= 2 f, exactly in the decimals that the floats print; None if q or f is not known."""
    q, f = read_in_steps(design.device), design.device.friction
    if q is None or f is None:
        return None
    return _exact(stiffness_read(design.gains, design.coupling)) * _exact(q) <= 2 * _exact(f)


def settles(design: Design) -> bool:
    """Return whether the friction exceeds whatever errors of the readings do to the motor's force: then a device whose
    port is passive comes to rest from every motion."""
    device, gains, coupling = design.device, design.gains, design.coupling
    q, f = read_in_steps(device), device.friction
    assert q is not None
    assert f is not None
    drive, rises = device.actuator, 1.0
    if drive is not None and drive.order == 2:
        rises = (1 + exp(-pi)) / (1 - exp(-pi))  # the sum of the rises and falls of its response to a step
    h = np.concatenate(([0.0], _impulse_response(device), [0.0]))
    answer = _force_of_a_step(device, gains, coupling) * 0.5 * float(np.abs(np.diff(h)).sum())
    error = 0.5 * stiffness_read(gains, coupling) * q + answer
    return bool(rests(design)) and rises * error <= f


def greatest_at_rest(device: Device) -> float | None:
    """Return the greatest stiffness of at most `DIGITS` digits that rests, N/m; None if q or f is not known."""
    q, f = read_in_steps(device), device.friction
    if q is None or f is None:
        return None
    greatest = 2 * _exact(f) / _exact(q)
    if not 0 < float(greatest) < inf:
        return float(greatest)
    exponent = DIGITS - 1 - floor(log10(float(greatest)))
    unit = Fraction(10) ** exponent
    return float(Fraction(floor(greatest * unit)) / unit)


def step_of_damper(device: Device, gains: Gains, coupling: AnyCoupling) -> float:
    """Return the greatest force with which the damper answers one step of the reading, N."""
    return _force_of_a_step(device, gains, coupling) * float(np.abs(_impulse_response(device)).max())


def _force_of_a_step(device: Device, gains: Gains, coupling: AnyCoupling) -> float:
    """Return the force of the damper for one step of the reading in a sample, without the filter, N."""
    q = read_in_steps(device)
    assert q is not None
    return damping_read(device, gains, coupling) * q / device.sample_time


def _impulse_response(device: Device) -> Floats:
    """Return the impulse response of the filter of the velocity until it has died away."""
    from scipy.signal import sosfilt

    sections = velocity_sections(device, FLOATS)
    if not sections:
        return np.ones(1)
    rows = np.array(rows_of_sections(sections), float)
    slowest = max(float(np.abs(np.roots(row[3:])).max()) for row in rows)
    count = LEAST_SAMPLES if slowest == 0 else LEAST_SAMPLES + ceil(log(DIED_AWAY) / log(slowest))
    impulse = np.zeros(min(count, MOST_SAMPLES))
    impulse[0] = 1.0
    return np.asarray(sosfilt(rows, impulse))


def _exact(number: float) -> Fraction:
    return Fraction(repr(float(number)))
