"""Compute the gain, phase and delay margins of the exact sampled loop L = K_v G_v + K_p G_x, in double precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, pi

import numpy as np

from vctune.analysis.extrema import Floats, frequency_grid, last_to_hold, local_minima, with_resonance
from vctune.analysis.sampled_loop import Complex, loop_gain, return_difference_at
from vctune.analysis.stability import makes_no_turn, unit_circle
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.numbers.pair import Pair

HALVINGS = 10  # Number of halvings of a step of the delay
MARGIN_POINTS_PER_DECADE = 100  # Number of points per decade of the grid for crossings
DECADES_BELOW_NYQUIST = 7  # Number of decades below Nyquist that the code searches
# Number of steps in which the code increases the delay to its estimated margin, and the multiple of this margin at
# which it stops
STEPS, FARTHEST = 16, 32
BISECTIONS = 48  # Number of halvings of an interval of the grid, which leave only rounding
NEWTON_STEPS, DIFFERENCE = 8, 1e-6  # Number of Newton steps, and the step of their central differences
FARTHEST_CORRECTION = 0.05  # Greatest share of the delay by which the root may differ from the halved interval


@dataclass(frozen=True, slots=True)
class Margins:
    """The margins of a loop. A margin is inf if there is no crossing."""

    gain: float  # factor of L, nearest to 1, that makes the loop unstable
    phase: float  # phase shift of L, rad, nearest to 0, that makes the loop unstable
    delay: float  # least additional delay of the device, s, that makes the sampled loop unstable


@lru_cache(maxsize=16)
def loop_margins(device: Device, gains: Gains) -> Margins:
    """Return the margins of a stable loop, from L on the upper half of the unit circle."""
    if not gains.closed:
        return Margins(inf, inf, inf)
    grid, nyquist = _grid(device), pi / device.sample_time

    def L(omega: Floats) -> Complex:
        return loop_gain(device, gains, omega)

    real = L(np.append(roots(lambda omega: L(omega).imag, grid), nyquist)).real
    factors = -1 / real[real < 0]
    crossing = unit_gain_frequencies(device, gains)
    angle = np.angle(L(crossing))
    phases = np.where(angle > 0, angle - pi, angle + pi)
    return Margins(
        gain=float(factors[np.argmin(np.abs(np.log(factors)))]) if factors.size else inf,
        phase=float(phases[np.argmin(np.abs(phases))]) if phases.size else inf,
        delay=_delay_margin(device, gains, float(np.min(np.mod(phases, 2 * pi) / crossing))) if phases.size else inf,
    )


def unit_gain_frequencies(device: Device, gains: Gains) -> Floats:
    """Return the frequencies at which the sampled loop has |L| = 1, rad/s, in ascending order."""
    return roots(lambda omega: np.log(np.abs(loop_gain(device, gains, omega))), _grid(device))


def unstable_poles(device: Device, gains: Gains) -> int:
    """Return the number of poles of the closed sampled loop outside the unit circle."""
    F = _circle(device, gains)
    turns = np.unwrap(np.arctan2(F.im, F.re))
    return -round(float(turns[-1]) / pi)


def _grid(device: Device) -> Floats:
    nyquist = pi / device.sample_time
    grid = frequency_grid(nyquist * 10.0**-DECADES_BELOW_NYQUIST, nyquist, MARGIN_POINTS_PER_DECADE)
    return with_resonance(device, grid)


def _circle(device: Device, gains: Gains) -> Pair:
    """Return F on the upper half of the unit circle."""
    return unit_circle(device, position=gains.position > 0).closed(gains)


def _delay_margin(device: Device, gains: Gains, estimate: float) -> float:
    """Return the least delay with which F passes through 0; inf if there is no such delay."""

    def stable(delay: float) -> bool:
        return bool(makes_no_turn(_circle(replace(device, delay=device.delay + delay), gains)))

    step = estimate / STEPS
    first = next((k for k in range(STEPS * FARTHEST) if not stable(k * step)), None)
    if not first:
        return 0.0 if first == 0 else inf
    return _at_zero(device, gains, last_to_hold(stable, (first - 1) * step, first * step, HALVINGS))


def _at_zero(device: Device, gains: Gains, delay: float) -> float:
    """Return the delay with which F = 0 somewhere on the circle, by Newton's method in (log omega, delay)."""
    position, unit = gains.position > 0, device.sample_time

    def F(point: Floats) -> Floats:
        later = replace(device, delay=device.delay + float(point[1]) * unit)
        parts = return_difference_at(later, np.exp(point[:1]), position=position)
        closed, open_loop = parts.closed(gains), np.sqrt(parts.open.abs2())
        return np.array([closed.re[0], closed.im[0]]) / open_loop[0]

    def size(omega: Floats) -> Floats:
        later = replace(device, delay=device.delay + delay)
        parts = return_difference_at(later, omega, position=position)
        return np.asarray(parts.closed(gains).abs2() / parts.open.abs2())

    point = np.array([np.log(local_minima(size, _grid(device)).omega[0]), delay / unit])
    for _ in range(NEWTON_STEPS):
        slopes = [(F(point + step) - F(point - step)) / (2 * DIFFERENCE) for step in DIFFERENCE * np.eye(2)]
        point = point - np.linalg.solve(np.array(slopes).T, F(point))
        if not abs(point[1] * unit - delay) <= FARTHEST_CORRECTION * delay:
            return delay
    return float(point[1]) * unit


def roots(f: Callable[[Floats], Floats], grid: Floats) -> Floats:
    """Return the frequencies at which f changes its sign, by bisecting all intervals at once."""
    values = f(grid)
    at = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    low, high, rising = grid[at], grid[at + 1], values[at + 1] > 0
    for _ in range(BISECTIONS if at.size else 0):
        middle = (low + high) / 2
        below = (f(middle) > 0) != rising
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return (low + high) / 2
