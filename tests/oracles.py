"""Independent evaluations: mpmath at 50 digits and plain complex arithmetic, from DESIGN section 1, not from vctune."""

from __future__ import annotations

import cmath
from dataclasses import dataclass

import mpmath as mp
import numpy as np

DIGITS = 50


@dataclass(frozen=True)
class Case:
    """A device with its gains and its coupling, as plain numbers."""

    mass: float
    damping: float
    sample_time: float
    delay: float
    hold: str
    K_v: float
    K_p: float
    b_c: float = 1.0
    m_c: float = 1.0
    b_0: float = 0.0


def exact_required_resistance(case: Case, omega: float, digits: int = DIGITS) -> mp.mpf:
    """R = (|q| - Re q)/(2 Re G_hh) by its definition, with `digits` digits more than cancel."""
    with mp.workdps(digits + 60):
        Z_d, C = _exact_loop(case, omega)
        q, G_hh = C / (Z_d + C), 1 / (Z_d + C)
        return (abs(q) - mp.re(q)) / (2 * mp.re(G_hh))


def exact_ratio(case: Case, omega: float) -> mp.mpf:
    """Re Z_c / R."""
    with mp.workdps(DIGITS + 60):
        s = mp.mpc(0, omega)
        series = 1 / (1 / mp.mpf(repr(case.b_c)) + 1 / (mp.mpf(repr(case.m_c)) * s))
        return (mp.mpf(repr(case.b_0)) + mp.re(series)) / exact_required_resistance(case, omega)


def _exact_loop(case: Case, omega: float) -> tuple[mp.mpc, mp.mpc]:
    m, b, T, d, K_v, K_p = (
        mp.mpf(repr(float(x))) for x in (case.mass, case.damping, case.sample_time, case.delay, case.K_v, case.K_p)
    )
    s = mp.mpc(0, omega)
    hold = (1 - mp.exp(-s * T)) / (s * T) if case.hold == "zoh" else 2 / (2 + s * T)
    return m * s + b, (K_v + K_p / s) * hold * mp.exp(-s * d)


def loop(case: Case, s: complex) -> tuple[complex, complex]:
    """Z_d and C at a complex frequency, in doubles."""
    hold = (1 - cmath.exp(-s * case.sample_time)) / (s * case.sample_time)
    if case.hold == "lag":
        hold = 2 / (2 + s * case.sample_time)
    return case.mass * s + case.damping, (case.K_v + case.K_p / s) * hold * cmath.exp(-s * case.delay)


def coupling(case: Case, s: complex) -> complex:
    """Z_c at a complex frequency."""
    return case.b_0 + case.b_c * case.m_c * s / (case.b_c + case.m_c * s)


def sampled_radius(case: Case) -> float:
    """Spectral radius of the sampled loop from a state-space model with matrix exponentials."""
    import scipy.linalg

    T, whole = case.sample_time, int(np.floor(case.delay / case.sample_time + 1e-12))
    late = max(case.delay - whole * T, 0.0)
    late = 0.0 if late < 1e-12 * T else late
    order = 2 if case.K_p > 0 else 1
    A = np.array([[-case.damping / case.mass, 0.0], [1.0, 0.0]])[:order, :order]
    B = np.array([[1 / case.mass], [0.0]])[:order]

    def transition(t: float) -> tuple[np.ndarray, np.ndarray]:
        block = np.zeros((order + 1, order + 1))
        block[:order, :order], block[:order, order:] = A * t, B * t
        full = scipy.linalg.expm(block)
        return full[:order, :order], full[:order, order:]

    A_T, _ = transition(T)
    A_0, B_new = transition(T - late)
    _, B_part = transition(late)
    B_old = A_0 @ B_part
    size = order + whole + 1
    full = np.zeros((size, size))
    law = np.zeros(size)
    law[:order] = [-case.K_v, -case.K_p][:order]
    full[:order, :order] = A_T
    if whole == 0:
        full[:order] += B_new @ law[None, :]
        full[:order, order] += B_old[:, 0]
    else:
        full[:order, order + whole - 1] += B_new[:, 0]
        full[:order, order + whole] += B_old[:, 0]
    full[order] = law
    for k in range(1, whole + 1):
        full[order + k, order + k - 1] = 1.0
    return float(np.abs(np.linalg.eigvals(full)).max())
