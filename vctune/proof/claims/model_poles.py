"""Prove that the frequency model has no pole in the closed right half plane (model/README.md, section 4)."""

from __future__ import annotations

from math import pi, sqrt

from vctune.model.device import Device
from vctune.model.loop.device_response import mechanism
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic

# Relative allowance for rounding errors, which are about 1e-12, in the frequency that `curve_end` returns and in an
# angle
NEAR = 1e-6
# Greatest difference, rad, between the argument at `curve_end` and its limit, at which the prover accepts the loop as
# stable
ROOM = 2.0


def final_angle(device: Device, *, integral: bool) -> float:
    """Return the limit of the argument of `model_curve` for omega -> inf if all poles are stable."""
    return pi / 2 * (1 + integral + (2 if device.structure is not None else 0))


def curve_end(device: Device, K_v: float, K_p: float, ops: Arithmetic = FLOATS) -> float:
    """Return a frequency beyond which the argument of `model_curve` stays within `ROOM` of its limit."""
    size = ops.magnitude
    if device.structure is None:
        return 4 * max(size(K_v / device.mass), sqrt(size(K_p / device.mass)))
    parts = mechanism(device, device.structure, ops)
    motor, handle = parts.motor, parts.handle
    held = 0.0 if parts.damping is None else size(parts.damping / handle)
    rates = size(K_v / motor), 4 / 3 * size(parts.viscosity / motor), size(parts.viscosity / handle), held
    squares = size(K_p / motor), 4 / 3 * size(parts.stiffness / motor), size(parts.stiffness / handle)
    return (1 + NEAR) * max(*(8 * rate for rate in rates), *(sqrt(8 * square) for square in squares))
