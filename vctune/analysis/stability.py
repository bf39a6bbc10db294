"""Estimate the stability of both loops on grids, for the search: no proofs. See model/README.md, section 7."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats, with_resonance
from vctune.analysis.sampled_loop import Complex, plant_of
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.velocity_loop import ReturnDifference, return_difference, unturned

FIRST_ANGLE, ANGLES_PER_DECADE = 1e-4, 46  # Grid for counting turns
TOO_CLOSE = 0.03  # Least |F| with which the code relies on the grid
LARGEST_TURN = 1.0  # Greatest turn of F between neighbouring angles for which the code relies on the grid, rad

# The function F(theta, K_v, K_p) = 1 + loop gain, affine in the gains; theta is omega T, rad
Curve = Callable[[Floats, Floats, Floats], Complex]


def sampled_curve(device: Device, *, position: bool) -> Curve:
    """Return the return difference of the sampled loop, divided by the return difference of the open loop."""
    plant = plant_of(device)

    def curve(theta: Floats, K_v: Floats, K_p: Floats) -> Complex:
        parts = return_difference(plant, theta, FLOATS, position=position)
        open_loop, velocity, travel = (p.re + 1j * p.im for p in (parts.open, parts.velocity, parts.position))
        return 1 + (K_v * velocity + K_p * travel) / open_loop

    return curve


def model_curve(device: Device) -> Curve:
    """Return D of the frequency model, divided by the D of the open loop: D/Z_d for a rigid device."""

    def curve(theta: Floats, K_v: Floats, K_p: Floats) -> Complex:
        omega = theta / device.sample_time
        at = device_response(device.modelled, omega, FLOATS)
        loop, idle = (loop_response(at, gains, FLOATS) for gains in (Gains(K_v, K_p), Gains(0.0, 0.0)))
        D = (loop.D_scaled.re + 1j * loop.D_scaled.im) / np.sqrt(loop.scale2)
        return np.asarray(D / (idle.D_scaled.re + 1j * idle.D_scaled.im))

    return curve


def angles(device: Device, first: float = FIRST_ANGLE) -> Floats:
    """Return the grid on which the code counts the turns of a device's curves."""
    grid, T = _angles(first), device.sample_time
    return grid if device.structure is None else np.minimum(with_resonance(device, grid / T) * T, np.pi)


@cache
def _angles(first: float) -> Floats:
    """Return a grid that is dense near 0 and near the Nyquist frequency."""
    count = int(np.ceil(ANGLES_PER_DECADE * np.log10(np.pi / 2 / first)))
    below, above = np.geomspace(first, np.pi / 2, count), np.pi - np.geomspace(np.pi / 2, 1e-2, ANGLES_PER_DECADE)
    grid = np.concatenate((below, above[1:], [np.pi]))
    grid.setflags(write=False)
    return grid


def unit_circle(device: Device, first: float = FIRST_ANGLE, *, position: bool) -> ReturnDifference:
    """Return the parts of the sampled loop's polynomial in 1/z on the upper half of the unit circle."""
    plant, theta = plant_of(device), angles(device, first)
    parts = return_difference(plant, theta, FLOATS, position=position)
    return ReturnDifference(
        *(unturned(plant, part, theta, FLOATS) for part in (parts.open, parts.velocity, parts.position))
    )


def makes_no_turn(F: Pair) -> NDArray[np.bool_]:
    """Return whether a closed loop's return difference on `unit_circle` makes no turn around 0."""
    up = F.im >= 0
    cross = F.re[..., :-1] * F.im[..., 1:] - F.re[..., 1:] * F.im[..., :-1]
    clockwise, back = up[..., 1:] & ~up[..., :-1] & (cross < 0), up[..., :-1] & ~up[..., 1:] & (cross > 0)
    turns = np.count_nonzero(back, axis=-1) - np.count_nonzero(clockwise, axis=-1)
    turn = 2 * np.pi * turns - np.arctan2(F.im[..., 0], F.re[..., 0])
    return (np.abs(turn) < np.pi / 2) & (F.re[..., -1] > 0)


def clearly_stable(device: Device, gains: Gains) -> bool | None:
    """Return whether neither loop makes a turn around 0; None if a loop comes too close to 0."""
    if gains.velocity == 0 and gains.position == 0:
        return None
    theta = angles(device)
    stable = True
    for curve in (sampled_curve(device, position=gains.position > 0), model_curve(device)):
        F = curve(theta, np.array(gains.velocity), np.array(gains.position))
        turns = np.unwrap(np.angle(F))
        if np.abs(F).min() < TOO_CLOSE or np.abs(np.diff(turns)).max() > LARGEST_TURN:
            return None
        stable &= bool(turns[0] < LARGEST_TURN and abs(turns[-1] - np.angle(F[-1])) < LARGEST_TURN and F[-1].real > 0)
    return stable
