"""Evaluate the theory from its definitions with fifty digits (mpmath), for one case at one frequency, in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mpmath as mp

from vctune.bench.evaluator import Case

DIGITS = 50
GUARD = 70  # Number of additional digits for the computation


@dataclass(frozen=True, slots=True)
class ExactValues:
    """The defined quantities at one frequency."""

    offered: Any  # Re Z_c, R, and Re Z_c/R (inf if R <= 0); R is inf if Re h11 = 0, and meaningless if Re h11 < 0
    required: Any
    ratio: Any
    resistance: Any  # Re h11, m/(N s)
    admittance: Any  # |G_hh|, |1 - G_he| and |Z_c|, without the least operator
    tracking: Any
    coupling: Any


def exact(case: Case, omega: Any) -> ExactValues:
    """Evaluate the definitions for one case at one frequency, with at least `DIGITS` digits."""
    with mp.workdps(DIGITS + GUARD):
        m, b, T, delay, K_v, K_p, b_c, m_c, b_0, m_h, b_h = _decimals(case)
        s = mp.mpc(0, mp.mpf(omega))
        hold = (1 - mp.exp(-s * T)) / (s * T) if case.hold == "zoh" else 2 / (2 + s * T)
        Z_d, Z_h, C = m * s + b, m_h * s + b_h, (K_v + K_p / s) * hold * mp.exp(-s * delay)
        D, closed = Z_d + C, Z_d + Z_h + C
        h11, h22, q = 1 / closed, Z_h * C / closed, C * D / closed**2
        Z_c = b_0 + b_c * m_c * s / (b_c + m_c * s)
        R = (abs(q) - mp.re(q)) / (2 * mp.re(h11)) - mp.re(h22) if mp.re(h11) else mp.inf
        ratio = mp.re(Z_c) / R if R > 0 else mp.inf
        return ExactValues(mp.re(Z_c), R, ratio, mp.re(h11), abs(1 / D), abs(Z_d / D), abs(Z_c))


def sensitivity(case: Case, omega: Any) -> Any:
    """Return |S| of the sampled loop without a hand on the device."""
    with mp.workdps(DIGITS + GUARD):
        _, _, T, _, K_v, K_p, *_ = _decimals(case)
        z = mp.expj(mp.mpf(omega) * T)
        opened, closed = (_value(characteristic(case, law), z) for law in ((0, 0), (K_v, K_p)))
        return abs(opened / closed)


def stable(case: Case) -> bool:
    """Return whether the sampled loop without a hand is stable, by Jury's recursion on its polynomial."""
    # a digit more for each sample of delay, because the table has a row for each
    with mp.workdps(DIGITS + GUARD + int(case.delay / case.sample_time)):
        return _all_inside(characteristic(case, _decimals(case)[4:6]))


def characteristic(case: Case, law: Sequence[Any]) -> list[Any]:
    """Return the characteristic polynomial of the sampled loop without a hand."""
    m, b, T, delay, *_ = _decimals(case)
    K_v, K_p = law
    whole = int(mp.floor(delay / T + mp.mpf("1e-12")))
    late = max(delay - whole * T, mp.mpf(0))
    late = mp.mpf(0) if late < mp.mpf("1e-12") * T else late
    rate = b / m
    a = mp.exp(-rate * T)

    def velocity(t: Any) -> Any:
        return t / m if b == 0 else (1 - mp.exp(-rate * t)) / b

    def position(t: Any) -> Any:
        return t * t / (2 * m) if b == 0 else (t - (1 - mp.exp(-rate * t)) / rate) / b

    new, old = velocity(T - late), velocity(T) - velocity(T - late)
    x_new, x_old = position(T - late), position(T) - position(T - late)
    if not case.K_p > 0:
        poly = [mp.mpf(1), -a] + [mp.mpf(0)] * (whole + 1)
        for i, beta in enumerate((new, old)):
            poly[whole + 1 + i] += K_v * beta
        return poly
    drift = T if b == 0 else (1 - a) / rate
    poly = [mp.mpf(1), -(1 + a), a] + [mp.mpf(0)] * (whole + 1)
    for i, (beta, gamma) in enumerate(((new, x_new), (old, x_old))):
        at = whole + 1 + i
        poly[at] += K_v * beta + K_p * gamma
        poly[at + 1] += -K_v * beta + K_p * (drift * beta - a * gamma)
    return poly


def _decimals(case: Case) -> list[Any]:
    device = (case.mass, case.damping, case.sample_time, case.delay)
    rest = (case.K_v, case.K_p, case.b_c, case.m_c, case.b_0, case.m_h, case.b_h)
    return [mp.mpf(repr(float(x))) for x in (*device, *rest)]


def _value(poly: list[Any], z: Any) -> Any:
    total = mp.mpf(0)
    for coefficient in poly:
        total = total * z + coefficient
    return total


def _all_inside(poly: list[Any]) -> bool:
    """Return whether every root lies inside the unit circle, by Jury's table."""
    while poly and poly[-1] == 0:
        poly = poly[:-1]
    while len(poly) > 1:
        k = poly[-1] / poly[0]
        if abs(k) >= 1:
            return False
        poly = [x - k * y for x, y in zip(poly[:-1], poly[:0:-1], strict=True)]
    return True
