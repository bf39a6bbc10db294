"""Fifty digits: the formulas of DESIGN section 1 by their definitions in mpmath, and an exact test of stability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath as mp

from vctune.model.quantities import Coupling, Device, Gains

DIGITS = 50
GUARD = 60
"""More digits than the definitions cancel."""


@dataclass(frozen=True, slots=True)
class Exact:
    """What the definitions give at a frequency: Re Z_c / R, Re G_hh, |1 - G_he|, |S|, |G_hh|, |Z_c|."""

    ratio: Any
    conductance: Any
    tracking: Any
    sensitivity: Any
    admittance: Any
    coupling: Any


def exact(device: Device, gains: Gains, coupling: Coupling, omega: float) -> Exact:
    """Evaluate the definitions at omega > 0, rad/s; the numbers count as the decimals that they are written as."""
    with mp.workdps(DIGITS + GUARD):
        m, b, T, delay, K_v, K_p, b_c, m_c, b_0 = _decimals(device, gains, coupling)
        s = mp.mpc(0, mp.mpf(omega))
        hold = (1 - mp.exp(-s * T)) / (s * T) if device.hold == "zoh" else 2 / (2 + s * T)
        Z_d, C = m * s + b, (K_v + K_p / s) * hold * mp.exp(-s * delay)
        G_hh, q = 1 / (Z_d + C), C / (Z_d + C)
        needed = (abs(q) - mp.re(q)) / (2 * mp.re(G_hh))
        Z_c = b_0 + b_c * m_c * s / (b_c + m_c * s)
        ratio = mp.re(Z_c) / needed if needed else mp.inf
        z = mp.exp(s * T)
        opened, closed = (mp.polyval(characteristic(device, gains, law), z) for law in ((0, 0), (K_v, K_p)))
        return Exact(ratio, mp.re(G_hh), abs(1 - q), abs(opened / closed), abs(G_hh), abs(Z_c))


def _decimals(device: Device, gains: Gains, coupling: Coupling) -> list[Any]:
    numbers = (device.mass, device.damping, device.sample_time, device.delay, gains.velocity, gains.position)
    return [mp.mpf(repr(float(x))) for x in (*numbers, coupling.damping, coupling.mass, coupling.drag)]


def stable(device: Device, gains: Gains) -> bool:
    """Return whether the sampled loop is stable (DESIGN 1.7), by Jury's recursion on its characteristic polynomial."""
    with mp.workdps(DIGITS + GUARD + characteristic_order(device)):
        return _all_inside(characteristic(device, gains, _decimals(device, gains, Coupling(1.0, 1.0, 0.0))[4:6]))


def characteristic_order(device: Device) -> int:
    """Return an upper bound of the polynomial's degree."""
    return int(device.delay / device.sample_time) + 4


def characteristic(device: Device, gains: Gains, law: Sequence[Any]) -> list[Any]:
    """Return the characteristic polynomial of a law K_v, K_p, highest power first, of the order that gains have."""
    m, b, T, delay, *_ = _decimals(device, gains, Coupling(1.0, 1.0, 0.0))
    K_v, K_p = law
    whole = int(mp.floor(delay / T + mp.mpf("1e-12")))
    late = max(delay - whole * T, mp.mpf(0))
    late = mp.mpf(0) if late < mp.mpf("1e-12") * T else late
    rate = b / m
    a = mp.exp(-rate * T)

    def speed(t: Any) -> Any:
        return t / m if b == 0 else (1 - mp.exp(-rate * t)) / b

    def place(t: Any) -> Any:
        return t * t / (2 * m) if b == 0 else (t - (1 - mp.exp(-rate * t)) / rate) / b

    new, old = speed(T - late), speed(T) - speed(T - late)
    z_new, z_old = place(T - late), place(T) - place(T - late)
    if not gains.position > 0:
        poly = [mp.mpf(1), -a] + [mp.mpf(0)] * (whole + 1)
        for i, beta in enumerate((new, old)):
            poly[whole + 1 + i] += K_v * beta
        return poly
    drift = T if b == 0 else (1 - a) / rate
    poly = [mp.mpf(1), -(1 + a), a] + [mp.mpf(0)] * (whole + 1)
    for i, (beta, gamma) in enumerate(((new, z_new), (old, z_old))):
        at = whole + 1 + i
        poly[at] += K_v * beta + K_p * gamma
        poly[at + 1] += -K_v * beta + K_p * (drift * beta - a * gamma)
    return poly


def _all_inside(poly: list[Any]) -> bool:
    """Return whether every root lies inside the unit circle: Jury's table, each row shorter by one."""
    while poly and poly[-1] == 0:
        poly = poly[:-1]
    while len(poly) > 1:
        k = poly[-1] / poly[0]
        if abs(k) >= 1:
            return False
        poly = [x - k * y for x, y in zip(poly[:-1], poly[:0:-1], strict=True)]
    return True
