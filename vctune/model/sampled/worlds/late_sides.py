"""Sides of the environments of a box that run late or by Euler's rules, in double precision (model/README.md, section
20).

A search looks at a greater set: the polygon of the environments z^-n (m f_m + b + k f_k), with any damping on time
beside each of them. If -Y is never in it, the loop is stable without further proof, for with the greatest damping v_e =
0. Sides of this set are those of the polygon with a normal of positive real part, and two along the real axis. Masses
by explicit Euler that are on time do not bear any damping; of these the search looks at the polygon itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.sampled.worlds.loop_in_late_worlds import LEADING, HalfPlane
from vctune.model.worlds import World, Worlds

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating[Any, Any]]
SIDES = 8
"""Number of sides: perpendicular to three factors on both sides of the polygon, and along the real axis and across it
on both sides. Of these some are unposed."""
LEAST = 1e-9
"""Least distance of an angle from 0 and pi, rad, where factors may be infinite. Half and twice it: the same sides."""
UNPOSED = -1e30
"""Room of a side that no loop is beyond."""


@np.errstate(all="ignore")
def open_sides(worlds: Worlds, sample_time: float, theta: Floats) -> list[HalfPlane]:
    """Return `SIDES` half-planes, of which a loop has to be beyond one; the first is the real part's.

    Parameters
    ----------
    worlds : the box, in plain numbers
    sample_time : T, s
    theta : omega T, rad
    """
    theta = np.clip(theta, LEAST, np.pi - LEAST)
    each, across, along = _factors(worlds, sample_time, theta), 1 + 0j * theta, 1j + 0 * theta
    factors = each[:2] if worlds.rule == "trapezoid" else each  # those of mass and spring are along one line then
    normals = [1j * factor / np.abs(factor) for factor in factors]
    normals = [np.where(normal.real < 0, -normal, normal) for normal in normals]
    others = [-across, *(-normal for normal in normals)] if worlds.ahead else [along, -along]
    sin, cos = np.sin(theta / 2), np.cos(theta / 2)
    posed = [across] if worlds.resistive else [across, *normals, *others]
    found = [_half_plane(normal, each, worlds, sin, cos) for normal in posed]
    nothing = HalfPlane(0 * theta, 0 * theta, 0 * theta, UNPOSED + 0 * theta)
    return [*found, *[nothing] * (SIDES - len(found))]


def _factors(worlds: Worlds, T: float, theta: Floats) -> list[Complexes]:
    """Return what multiplies mass, damping and stiffness."""
    z, q = np.exp(1j * theta), LEADING[worlds.rule]
    moved = 2j / T * np.sin(theta / 2)
    mass = moved / np.cos(theta / 2) if q == 0 else moved * z ** (q / 2)
    spring = 1 / mass if q == 0 else z ** (-q / 2) / moved
    late = z ** (-worlds.late)
    return [late * mass, late, late * spring]


def _half_plane(normal: Complexes, factors: Sequence[Complexes], worlds: Worlds, sin: Floats, cos: Floats) -> HalfPlane:
    """Return a half-plane, times the sine and the cosine that make it regular."""
    room = np.zeros(sin.shape)
    for factor, low, high in zip(factors, _numbers(worlds.low), _numbers(worlds.high), strict=True):
        along = (np.conj(normal) * factor).real
        along = np.where(np.abs(along) < 1e-12 * np.abs(factor), 0.0, along)
        room = room + np.where(along >= 0, low * along, np.nan_to_num(high * along, nan=UNPOSED))
    scale = sin * cos
    return HalfPlane(normal.real * scale, normal.imag * sin, -normal.imag * cos, np.maximum(room, UNPOSED) * scale)


def _numbers(world: World) -> tuple[float, float, float]:
    return world.mass, world.damping, world.stiffness
