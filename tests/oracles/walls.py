"""Walls that come and go: loops in time, and the multiplier's condition by brute force."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from loop import Loop, Memory, offered, seen, step, turn

Floats = np.ndarray


@dataclass(frozen=True)
class Wall:
    """A piecewise linear force: its slope, N/m, changes at breakpoints, m, one after the other; one slope more."""

    breaks: Floats
    slopes: Floats

    def solved(self, aim: float, share: float) -> float:
        """Return the position x with x + share force(x) = aim."""
        forces = np.concatenate(([0.0], np.cumsum(np.diff(self.breaks) * self.slopes[1:-1])))
        corners = self.breaks + share * forces
        part = int((corners < aim).sum())
        left = max(part - 1, 0)
        return float(self.breaks[left] + (aim - corners[left]) / (1 + share * self.slopes[part]))

    def force(self, x: float) -> float:
        """Return the force at a position."""
        forces = np.concatenate(([0.0], np.cumsum(np.diff(self.breaks) * self.slopes[1:-1])))
        part = int((self.breaks < x).sum())
        left = max(part - 1, 0)
        return float(forces[left] + self.slopes[part] * (x - self.breaks[left]))


def random_wall(least: float, most: float, reach: float, rng: np.random.Generator) -> Wall:
    """Return a one-sided wall, a gap between two, or any other monotone force with slopes from least to most."""
    breaks, kind = np.sort(rng.uniform(-reach, reach, 4)), rng.integers(3)
    if kind == 0:
        slopes = np.array([least, least, most, most, most])[:: int(rng.choice([-1, 1]))]
    elif kind == 1:
        slopes = np.array([most, most, least, most, most])
    else:
        slopes = least + (most - least) * rng.choice([0.0, 1.0, rng.random()], 5)
    return Wall(breaks, slopes)


def speeds(loop: Loop, wall: Wall, samples: int, rng: np.random.Generator, pushed: int = 200) -> Floats:
    """Return v_e of a loop at a wall after a random beginning and pushes; the position by either rule."""
    size, at = Memory(loop).size, Memory(loop).at["x_e"].start
    one, T = np.eye(size + 1), loop.device["sample_time"]
    after, out = step(loop, one[:size], extra=one[size])  # beside the wall's force everything is linear
    A, push, c, at_once = after[:, :size], after[:, size], out[:size], out[size]
    reach = T * float(rng.choice([0.5, 1.0]))  # by the trapezoidal rule, or by backward Euler
    z, found = 1e-2 * rng.normal(size=size), np.empty(samples)
    for k in range(samples):
        external = 1e-2 / at_once * rng.normal() if k < pushed else 0.0
        x = wall.solved(z[at] + reach * (c @ z + at_once * external), reach * at_once)
        w = external - wall.force(x)
        found[k] = c @ z + at_once * w
        z = A @ z + push * w
    return found


def grows(v: Floats) -> bool:
    """Return whether a motion ends faster than it ever was, or goes on turning around without dying out."""
    quarter = len(v) // 4
    before, late = np.abs(v[:-quarter]).max(), np.abs(v[-quarter:]).max()
    swinging = v[-quarter:] - v[-quarter:].mean()
    turns = (np.diff(np.sign(swinging)) != 0).sum()
    ended, early = (np.sqrt((part**2).mean()) for part in (v[-quarter:], v[quarter : 2 * quarter]))
    return bool(
        not np.isfinite(late) or late > 1.02 * before or (turns > 20 and ended > early and late > 1e-9 * before)
    )


def condition(
    loop: Loop, theta: Floats, least: tuple[float, float, float], most: tuple[float, float], corner: float
) -> Floats:
    """Return the least of Re[M (1/P + 1/kappa)] |P|^2 over masses and dampings of a box, scaled, at angles.

    Parameters
    ----------
    least, most : mass, damping and stiffness, and the greatest mass and stiffness
    corner : of the multiplier, rad/s
    """
    T, (mass, damping, k_1), (heavy, k_2) = loop.device["sample_time"], least, most
    z = turn(loop, theta)
    s, a = 2 / T * (z - 1) / (z + 1), (2 / T - corner) / (2 / T + corner)
    M, kappa = (1 - 1 / z) / (1 - a / z), k_2 - k_1
    scale = np.abs(1 - a / z) ** 2 / (2 * np.sin(theta / 2) ** 2 * (1 + a))
    Y, worst = seen(loop, z) + offered(loop, z), np.full(theta.shape, np.inf)
    for rate in (s, (1 - 1 / z) / T):  # v_e over the position by the trapezoidal rule, and by backward Euler

        def value(m: Any, b: Any, rate: Any = rate) -> Floats:
            P = rate * (Y + b + m * s) + k_1
            return (M * (1 / P + 1 / kappa)).real * np.abs(P) ** 2 * scale

        for b in (damping, damping + 1.0, 100 * (1 + damping)):
            there = np.clip(_vertex(lambda m, b=b: value(m, b), (kappa + np.abs(s * Y)) / np.abs(s) ** 2), mass, heavy)
            for m in (mass, heavy, there):
                best = np.maximum(_vertex(lambda b, m=m: value(m, b), 1.0 + np.abs(Y)), damping)
                worst = np.minimum(worst, np.minimum(value(m, b), value(m, best)))
    return worst


def _vertex(parabola: Any, width: Any) -> Floats:
    """Return where parabolas that open upwards are least, from three values of each."""
    below, middle, above = (parabola(sign * width) for sign in (-1.0, 0.0, 1.0))
    curve = 2 * (below - 2 * middle + above)
    return np.where(curve > 0, width * (below - above) / np.where(curve > 0, curve, 1.0), 0.0)


def with_share(loop: Loop, share: float) -> Loop:
    """Return the loop with a share of its coupling."""
    return replace(loop, coupling=tuple(number * share for number in loop.coupling))
