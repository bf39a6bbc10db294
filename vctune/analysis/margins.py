"""Gain, phase and delay margins of the velocity loop L = C/Z_d (frequency model, double precision)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi

import numpy as np

from vctune.analysis.demands import response
from vctune.analysis.extrema import Floats, frequency_grid
from vctune.model.pair import re_conj_product
from vctune.model.quantities import Device, Gains

BISECTIONS = 40
MARGIN_POINTS_PER_DECADE = 100


@dataclass(frozen=True, slots=True)
class Margins:
    """The margins nearest to instability; inf where nothing crosses.

    Attributes
    ----------
    gain : factor on L that makes it unstable, the one nearest to 1
    phase : rad, the one nearest to 0
    delay : s, the least additional delay that makes the loop unstable
    """

    gain: float
    phase: float
    delay: float


def loop_margins(device: Device, gains: Gains) -> Margins:
    """Return the margins of the velocity loop.

    Crossings are looked for up to the sampling rate (hold "zoh"), where the hold's gain vanishes, or far beyond every
    corner (hold "lag").
    """
    if gains.velocity == 0 and gains.position == 0:
        return Margins(inf, inf, inf)
    grid = _grid(device, gains)
    turned = _roots(lambda omega: response(device, gains, omega).turn, grid)
    loop = response(device, gains, turned)
    against = re_conj_product(loop.C, loop.Z_d) < 0
    factors = np.sqrt(loop.Z_d.abs2() / loop.C.abs2())[against]
    crossing = _roots(lambda omega: _log_gain(device, gains, omega), grid)
    loop = response(device, gains, crossing)
    angle = np.arctan2(_cross(loop.C.im, loop.C.re, loop.Z_d.im, loop.Z_d.re), re_conj_product(loop.C, loop.Z_d))
    phases = np.where(angle > 0, angle - pi, angle + pi)
    return Margins(
        gain=float(factors[np.argmin(np.abs(np.log(factors)))]) if factors.size else inf,
        phase=float(phases[np.argmin(np.abs(phases))]) if phases.size else inf,
        delay=float(np.min(np.mod(phases, 2 * pi) / crossing)) if phases.size else inf,
    )


def encirclements(device: Device, gains: Gains) -> int:
    """Return N, how often L goes clockwise around -1, the path indented to the right of poles at s = 0.

    The argument of 1 + L turns by a quarter for each such pole when nothing is encircled.
    """
    if gains.velocity == 0 and gains.position == 0:
        return 0
    loop = response(device, gains, _grid(device, gains))
    real = 1 + re_conj_product(loop.C, loop.Z_d) / loop.Z_d.abs2()
    turns = np.unwrap(np.arctan2(_cross(loop.C.im, loop.C.re, loop.Z_d.im, loop.Z_d.re) / loop.Z_d.abs2(), real))
    poles_at_zero = int(gains.position > 0) + int(device.damping == 0)
    return -round(float(turns[-1] - turns[0] - poles_at_zero * pi / 2) / pi)


def _grid(device: Device, gains: Gains) -> Floats:
    rate = 1 / device.sample_time
    stiff = device.damping + gains.velocity
    corners = [rate, stiff / device.mass, device.damping / device.mass, (gains.position / device.mass) ** 0.5]
    corners += [gains.position / loss for loss in (stiff, device.damping) if loss > 0]
    low = min(corner for corner in corners if corner > 0)
    high = 2 * pi * rate * (1 - 1e-9) if device.hold == "zoh" else max(corners) * 1e3
    return frequency_grid(min(low * 1e-3, high * 1e-3), high, MARGIN_POINTS_PER_DECADE)


def _log_gain(device: Device, gains: Gains, omega: Floats) -> Floats:
    loop = response(device, gains, omega)
    return np.log(loop.C.abs2() / loop.Z_d.abs2())


def _cross(a_im: Floats, a_re: Floats, b_im: Floats, b_re: Floats) -> Floats:
    """Return Im(a conj b)."""
    return a_im * b_re - a_re * b_im


def _roots(f: Callable[[Floats], Floats], grid: Floats) -> Floats:
    """Return the places where f changes its sign, by bisection, all at once."""
    values = f(grid)
    at = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    low, high = grid[at], grid[at + 1]
    rising = values[at + 1] > 0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        up = (f(middle) > 0) == rising
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    return (low + high) / 2
