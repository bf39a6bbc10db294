"""The whole loop with walls that come and go, in time, and the condition that is to exclude growth; not from vctune.

Builds on `world_loops`, which knows nothing of vctune either: the matrix of one sample without a spring, and beside it
a force that depends on the position alone, solved for sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from world_loops import Whole, offered, seen, stepped

from vctune.model.worlds import Worlds


@dataclass(frozen=True)
class Wall:
    """A piecewise linear force: its slope, N/m, changes at breakpoints, m, one after the other; one slope more."""

    breaks: np.ndarray
    slopes: np.ndarray

    def forces(self) -> np.ndarray:
        """Return the force at each breakpoint, 0 at the first."""
        return np.concatenate(([0.0], np.cumsum(np.diff(self.breaks) * self.slopes[1:-1])))


def random_wall(least: float, most: float, reach: float, rng: np.random.Generator) -> Wall:
    """Return a one-sided wall, two of them, or any other monotone force with slopes from least to most."""
    breaks = np.sort(rng.uniform(-reach, reach, 4))
    kind = rng.integers(3)
    if kind == 0:  # one-sided, at either side
        slopes = np.array([least, least, most, most, most])
        slopes = slopes if rng.random() < 0.5 else slopes[::-1]
    elif kind == 1:  # a gap between two
        slopes = np.array([most, most, least, most, most])
    else:
        slopes = least + (most - least) * rng.choice([0.0, 1.0, rng.random()], 5)
    return Wall(breaks, slopes)


@dataclass(frozen=True)
class Linear:
    """One sample without a spring: z' = A z + push w, v_e = c z - w/at_once of the wall's force w, x_p = z[at]."""

    A: np.ndarray
    push: np.ndarray
    c: np.ndarray
    at_once: float
    at: int


def linear_part(loop: Whole) -> Linear:
    """Return the linear part of a loop, from its matrices with no spring and with one."""
    m, d, _ = loop.world
    k = 1.0 + loop.plant.mass / loop.plant.sample_time**2
    free, tied = (stepped(replace(loop, world=(m, d, stiffness))) for stiffness in (0.0, k))
    at = free.shape[0] - 4
    by = tied[-1, at] - free[-1, at]
    assert free[-1, at] == 0
    at_once = -k / by - k * loop.plant.sample_time / 2
    return Linear(free, -(tied - free)[:, at] / by / at_once, free[-1], at_once, at)


def speeds(
    loops: list[Whole], walls: list[Wall], samples: int, rng: np.random.Generator, pushed: int = 200
) -> np.ndarray:
    """Return v_e of loops at walls, stepped by either rule, after random beginnings and pushes, (samples, loops)."""
    parts, T = [linear_part(loop) for loop in loops], np.array([loop.plant.sample_time for loop in loops])
    return speeds_of(parts, [len(part.A) - 4 for part in parts], T, walls, samples, rng, pushed)


@np.errstate(all="ignore")
def speeds_of(
    parts: list[Linear],
    begun: list[int],
    T: np.ndarray,
    walls: list[Wall],
    samples: int,
    rng: np.random.Generator,
    pushed: int = 200,
) -> np.ndarray:
    """Return `speeds` of linear parts, of which so many states each begin at random."""
    size, n = max(len(part.A) for part in parts), len(parts)
    A, push, c, z = np.zeros((n, size, size)), np.zeros((n, size)), np.zeros((n, size)), np.zeros((n, size))
    for i, part in enumerate(parts):
        own = len(part.A)
        A[i, :own, :own], push[i, :own], c[i, :own] = part.A, part.push, part.c
        z[i, : begun[i]] = rng.normal(size=begun[i]) * 1e-2
    reach = T * rng.choice([0.5, 1.0], n)  # by the trapezoidal rule, or by backward Euler
    at, at_once = np.array([part.at for part in parts]), np.array([part.at_once for part in parts])
    breaks, slopes, forces = (np.array(x) for x in zip(*((w.breaks, w.slopes, w.forces()) for w in walls), strict=True))
    share, rows = reach / at_once, np.arange(n)
    corners = breaks + share[:, None] * forces
    found = np.empty((samples, n))
    for k in range(samples):
        external = at_once * rng.normal(size=n) * (k < pushed) * 1e-2
        free = np.einsum("ij,ij->i", c, z) + external / at_once
        aim = z[rows, at] + reach * free
        part = (corners < aim[:, None]).sum(axis=1)
        left = np.maximum(part - 1, 0)
        slope = slopes[rows, part]
        x = breaks[rows, left] + (aim - corners[rows, left]) / (1 + share * slope)
        w = forces[rows, left] + slope * (x - breaks[rows, left]) - external
        found[k] = np.einsum("ij,ij->i", c, z) - w / at_once
        z = np.einsum("ijk,ik->ij", A, z) + push * w[:, None]
    return found


@np.errstate(all="ignore")
def grow(v: np.ndarray) -> np.ndarray:
    """Return which of some motions end faster than they ever were, or go on turning around without dying out.

    A heavy mass may still be under way when few samples are looked at: it turns around a few times at most.
    """
    quarter = len(v) // 4
    before, late = np.abs(v[:-quarter]).max(axis=0), np.abs(v[-quarter:]).max(axis=0)
    swinging = v[-quarter:] - v[-quarter:].mean(axis=0)
    turns = (np.diff(np.sign(swinging), axis=0) != 0).sum(axis=0)
    ended, early = (np.sqrt((part**2).mean(axis=0)) for part in (v[-quarter:], v[quarter : 2 * quarter]))
    goes_on = (turns > 20) & (ended > early) & (late > 1e-9 * before)
    return np.asarray(~np.isfinite(late) | (late > 1.02 * before) | goes_on)


def least_of_condition(loop: Whole, theta: np.ndarray, worlds: Worlds, corner: float) -> np.ndarray:
    """Return the least of Re[M (1/P + 1/kappa)] |P|^2 |1 - a/z|^2/(2 s^2 (1 + a)) over masses and dampings of a box.

    By a grid of them, to which those belong at which it may be least.
    """
    T, low, high = loop.plant.sample_time, worlds.low, worlds.high
    kappa, z = high.stiffness - low.stiffness, np.exp(1j * theta)
    s = 2 / T * (z - 1) / (z + 1)
    a = (2 / T - corner) / (2 / T + corner)
    M = (1 - 1 / z) / (1 - a / z)
    scale = np.abs(1 - a / z) ** 2 / (2 * np.sin(theta / 2) ** 2 * (1 + a))
    Y, least = seen(loop, theta) + offered(loop, theta), np.full(theta.shape, np.inf)
    weight = (kappa + np.abs(s * Y)) / np.abs(s) ** 2
    for rate in (s, (1 - 1 / z) / T):  # v_e over the position by the trapezoidal rule, and by backward Euler

        def condition(mass: np.ndarray | float, damping: np.ndarray | float, rate: np.ndarray = rate) -> np.ndarray:
            P = rate * (Y + damping + mass * s) + low.stiffness
            return (M * (1 / P + 1 / kappa)).real * np.abs(P) ** 2 * scale

        for damping in (low.damping, low.damping + 1.0, 100.0 * (1 + low.damping)):
            mass = np.clip(_vertex(lambda x, d=damping: condition(x, d), weight), low.mass, high.mass)
            for tried in (low.mass, high.mass, mass):
                best = np.maximum(_vertex(lambda d, x=tried: condition(x, d), 1.0 + np.abs(Y)), low.damping)
                least = np.minimum(least, np.minimum(condition(tried, damping), condition(tried, best)))
    return least


def _vertex(parabola: Callable[[np.ndarray], np.ndarray], step: np.ndarray | float) -> np.ndarray:
    """Return where parabolas that open upwards are least, from three values of each."""
    below, middle, above = (parabola(sign * step * np.ones(1)) for sign in (-1.0, 0.0, 1.0))
    curve = 2 * (below - 2 * middle + above)
    return np.where(curve > 0, step * (below - above) / np.where(curve > 0, curve, 1.0), 0.0)
