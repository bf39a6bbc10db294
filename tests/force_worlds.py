"""An impedance display, a hand and an environment in exact time: late, by any rule, and with walls; not from vctune.

Builds on `force_loops`: the matrix of one sample without an environment, the tool's velocity as a function of the
state, and the force of an environment on the tool.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from force_loops import ForceLoop
from late_loops import InTime
from wall_loops import Linear, Wall, speeds_of


@lru_cache(maxsize=64)
def tool_side(loop: ForceLoop) -> Linear:
    """Return what an environment meets that acts in parallel with the mass and the damper of the loop's world."""
    m, d, _ = loop.world
    k, T = 1.0 + loop.mass / loop.sample_time**2, loop.sample_time
    free, tied = (replace(loop, world=(m, d, stiffness)).stepped() for stiffness in (0.0, k))
    at = len(loop.sampled()[0]) + loop.sampled()[3] + 3
    rest = np.eye(len(free))[at]
    v = (tied[at, at] - free[at, at]) / T
    at_once = -k / v - k * T / 2
    return Linear(free, (tied - free)[:, at] / (-v * at_once), (free[at] - rest) / T, at_once, at)


def stepped_with(loop: ForceLoop, world: InTime) -> np.ndarray:
    """Return the matrix of one sample of a loop whose environment runs late or by any rule."""
    (m, d, k), T = loop.world, loop.sample_time
    side = tool_side(replace(loop, world=(0.0, 0.0, 0.0)))
    reach = {"trapezoid": T / 2, "explicit": 0.0, "implicit": T}[world.rule]
    inertance = {"trapezoid": 2 * m / T, "explicit": m / T, "implicit": m / T}[world.rule]
    ahead = world.rule == "explicit" and world.late == 0 and m > 0
    # an explicit mass is that of implicit Euler one sample earlier
    own = world.late - 1 if world.rule == "explicit" else world.late
    n = len(side.A)

    def one(memory: np.ndarray) -> np.ndarray:
        z, (x, last, carried, v_next), kept = memory[:n], memory[n : n + 4], memory[n + 4 :]
        contacts, inertias = kept[: world.late], kept[world.late :]
        at_once, known = side.at_once, side.at_once * (side.c @ z)
        if world.late:
            known -= contacts[0]
        else:
            at_once, known = at_once + d + k * reach, known - k * x
        if own > 0:
            known -= inertias[0]
        elif own == 0:
            at_once, known = at_once + inertance, known + inertance * last + carried
        v = v_next if ahead else known / at_once
        v_next = v + T / m * (known - at_once * v) if ahead else 0.0
        contact, inertia = d * v + k * (x + reach * v), inertance * (v - last) - carried
        w = side.at_once * (side.c @ z - v)
        contacts = np.append(contacts[1:], contact) if world.late else contacts
        inertias = np.append(inertias[1:], inertia) if own > 0 else inertias
        after = [x + T * v, v, inertia if world.rule == "trapezoid" and m > 0 else 0.0, v_next]
        return np.concatenate((side.A @ z + side.push * w, after, contacts, inertias))

    return np.array([one(row) for row in np.eye(n + 4 + world.late + max(own, 0))]).T


def radius(loop: ForceLoop, world: InTime) -> float:
    """Return the greatest modulus of the loop's eigenvalues, the position of the tool aside."""
    found = np.linalg.eigvals(stepped_with(loop, world))
    return float(np.abs(found[np.abs(found - 1) > 1e-7]).max())


def speeds_at_walls(loops: list[ForceLoop], walls: list[Wall], samples: int, rng: np.random.Generator) -> np.ndarray:
    """Return the velocities of the tools of loops at walls, stepped by either rule, (samples, loops)."""
    T = np.array([loop.sample_time for loop in loops])
    begun = [len(loop.sampled()[0]) for loop in loops]
    return speeds_of([tool_side(loop) for loop in loops], begun, T, walls, samples, rng)
