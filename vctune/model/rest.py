"""Say whether dry friction holds a device between two readings of its encoder (model/README.md, section 20)."""

from __future__ import annotations

from fractions import Fraction
from math import exp, floor, inf, log10, pi

import numpy as np

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import FLOATS

DIGITS = 8  # Number of significant digits to which the greatest stiffness at rest is rounded down, those of a design


def stiffness_read(gains: Gains, coupling: AnyCoupling) -> float:
    """Return the stiffness that acts on the read position, N/m: k_c of an impedance display, else K_p."""
    return float(coupling.stiffness if isinstance(coupling, SpringDamper) else gains.position)


def damping_read(gains: Gains, coupling: AnyCoupling) -> float:
    """Return the damping that acts on the differenced position, N s/m."""
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
    error = 0.5 * stiffness_read(gains, coupling) * q + step_of_damper(device, gains, coupling)
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
    """Return the greatest force with which the damper answers one step of the reading, N.

    The force rises to it and dies away; its rises and falls add up to twice this number.
    """
    estimate = device.velocity
    assert estimate is not None
    assert estimate.resolution is not None
    peak = 1.0
    if estimate.filter_hz is not None:
        weight, left = (float(x) for x in low_pass_coefficients(estimate.filter_hz, device.sample_time, FLOATS))
        after = np.arange(2 + int(left / weight))  # of two low-passes the greatest is left/weight samples later
        peak = weight if estimate.filter_order == 1 else float((weight**2 * (after + 1) * left**after).max())
    return damping_read(gains, coupling) * estimate.resolution / device.sample_time * peak


def _exact(number: float) -> Fraction:
    return Fraction(repr(float(number)))
