"""Compute, in doubles, the sides of the set of environments that run late or step by Euler's rules (model/README.md,
section 20)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.sampled.worlds.loop_in_late_worlds import LEADING, HalfPlane
from vctune.model.worlds import World, Worlds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating[Any, Any]]
SIDES = 8  # Number of half-planes from `open_sides`, the greatest number of sides
LEAST = 1e-9  # Least distance of an angle from 0 and pi, rad, because factors may be infinite at 0 and pi
# Value of `HalfPlane.room` for a side that the set does not have or that lies at infinity: no loop is beyond it
UNPOSED = -1e30


@np.errstate(all="ignore")
def open_sides(worlds: Worlds, sample_time: float, theta: Floats) -> list[HalfPlane]:
    """Return `SIDES` half-planes. A loop has to be beyond one of them; the first belongs to the real part."""
    theta = np.clip(theta, LEAST, np.pi - LEAST)
    each, across, along = _factors(worlds, sample_time, theta), 1 + 0j * theta, 1j + 0 * theta
    factors = each[:2] if worlds.rule == "trapezoid" else each  # by this rule, mass and spring have parallel factors
    normals = [1j * factor / np.abs(factor) for factor in factors]
    normals = [np.where(normal.real < 0, -normal, normal) for normal in normals]
    others = [-across, *(-normal for normal in normals)] if worlds.ahead else [along, -along]
    sin, cos = np.sin(theta / 2), np.cos(theta / 2)
    posed = [across] if worlds.resistive else [across, *normals, *others]
    found = [_half_plane(normal, each, worlds, sin, cos) for normal in posed]
    nothing = HalfPlane(0 * theta, 0 * theta, 0 * theta, UNPOSED + 0 * theta)
    return [*found, *[nothing] * (SIDES - len(found))]


def _factors(worlds: Worlds, T: float, theta: Floats) -> list[Complexes]:
    """Return the factors of mass, damping and stiffness in the impedance."""
    z, q = np.exp(1j * theta), LEADING[worlds.rule]
    moved = 2j / T * np.sin(theta / 2)
    mass = moved / np.cos(theta / 2) if q == 0 else moved * z ** (q / 2)
    spring = 1 / mass if q == 0 else z ** (-q / 2) / moved
    late = z ** (-worlds.late)
    return [late * mass, late, late * spring]


def _half_plane(normal: Complexes, factors: Sequence[Complexes], worlds: Worlds, sin: Floats, cos: Floats) -> HalfPlane:
    """Return a half-plane, multiplied by the powers of sine and cosine that make it regular."""
    room = np.zeros(sin.shape)
    for factor, low, high in zip(factors, _numbers(worlds.low), _numbers(worlds.high), strict=True):
        along = (np.conj(normal) * factor).real
        along = np.where(np.abs(along) < 1e-12 * np.abs(factor), 0.0, along)
        room = room + np.where(along >= 0, low * along, np.nan_to_num(high * along, nan=UNPOSED))
    scale = sin * cos
    return HalfPlane(normal.real * scale, normal.imag * sin, -normal.imag * cos, np.maximum(room, UNPOSED) * scale)


def _numbers(world: World) -> tuple[float, float, float]:
    return world.mass, world.damping, world.stiffness
