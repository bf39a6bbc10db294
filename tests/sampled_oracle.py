"""A linear scene sample by sample with scipy's matrix exponentials, not from vctune.

Written from model/README.md, sections 1 to 7.

The firmware is not solved by hand: its equations of a sample are put into a matrix and given to numpy.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.linalg


@dataclass(frozen=True)
class Linear:
    """Device, delay, hand, law K_v + K_p/s + K_i/s^2, coupling, virtual mass and damping, environment."""

    m: float
    b: float
    T: float
    delay: float
    hand: tuple[float, float, float]
    law: tuple[float, float, float]
    coupling: tuple[float, float, float] | None
    virtual: tuple[float, float]
    environment: tuple[float, float, float, float]


def simulate(case: Linear, intended: np.ndarray, rates: np.ndarray) -> dict[str, np.ndarray]:
    """Return x, v, f_h, x_e, v_e, u at each sample; starts at rest, handle and x_e where the motion starts, u = 0."""
    M_h, b_h, k_h = case.hand
    K_v, K_p, K_i = case.law
    m_v, b_v = case.virtual
    m_e, b_e, k_e, zero = case.environment
    b_c, m_c, b_0 = case.coupling or (0.0, 1.0, 0.0)
    T, total = case.T, case.m + M_h
    whole = int(np.floor(case.delay / T + 1e-9))
    early = case.delay - whole * T
    x, v = intended[0], 0.0
    x_e = y = intended[0]  # x_e by the trapezoidal rule, y, where the spring is, by backward Euler
    v_e = v_c = total_error = 0.0
    past = [0.0] * (whole + 2)  # u[k-1], u[k-2], ...
    out: dict[str, list[float]] = {
        name: [] for name in ("position", "velocity", "force", "reference", "desired", "motor")
    }
    for k in range(len(intended) - 1):
        x_i, v_i = intended[k], rates[k]
        push = k_h * x_i + b_h * v_i
        acceleration = (past[whole] + push - k_h * x - (case.b + b_h) * v) / total
        force = push - k_h * x - b_h * v - M_h * acceleration
        # unknowns: v_e, v_c, x_e, y at the end of the sample
        A = np.array(
            [
                [(m_v + m_e) / T + b_v + b_e + b_0 + b_c, -b_c, 0, k_e],
                [-b_c / 2, m_c / T + b_c / 2, 0, 0],
                [-T / 2, 0, 1, 0],
                [-T, 0, 0, 1],
            ]
        )
        right = [
            force + k_e * zero + (m_v + m_e) / T * v_e,
            m_c / T * v_c + b_c / 2 * (v_e - v_c),
            x_e + T / 2 * v_e,
            y,
        ]
        v_e, v_c, x_e, y = np.linalg.solve(A, right)
        total_error += T * (x_e - x)
        u = K_v * (v_e - v) + K_p * (x_e - x) + K_i * total_error
        for name, value in zip(out, (x, v, force, x_e, v_e, u), strict=True):
            out[name].append(value)
        cubic = np.polynomial.Polynomial(scipy.linalg.solve(_hermite(T), [x_i, v_i, intended[k + 1], rates[k + 1]]))
        hand = k_h * cubic + b_h * cubic.deriv()
        for begin, length, motor in ((0.0, early, past[whole]), (early, T - early, ([u, *past])[whole])):
            x, v = _move(total, case.b + b_h, k_h, x, v, hand, motor, begin, length)
        past = [u, *past[:-1]]
    return {name: np.array(values) for name, values in out.items()}


def _hermite(T: float) -> np.ndarray:
    return np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, T, T**2, T**3], [0, 1, 2 * T, 3 * T**2]], dtype=float)


def _move(m, b, k, x, v, hand, motor, begin, length):
    """x and v after `length` under a polynomial force in the time since `begin`."""
    if length == 0:
        return x, v
    force = (hand(np.polynomial.Polynomial([begin, 1.0])) + motor).coef
    return _response(m, b, k, length) @ np.array([x, v, *np.pad(force, (0, 4 - len(force)))])


@cache
def _response(m, b, k, length):
    """x and v after `length` for x = 1, v = 1 and the forces 1, s, s^2, s^3: e^(At) of x, v beside the powers of s."""
    columns = []
    for n in range(-2, 4):
        A = np.zeros((6, 6))
        A[0, 1], A[1, 0], A[1, 1] = 1.0, -k / m, -b / m
        A[[3, 4, 5], [2, 3, 4]] = [1.0, 2.0, 3.0]  # d s^n/dt = n s^(n-1)
        start = np.array([n == -2, n == -1, 1.0, 0.0, 0.0, 0.0], dtype=float)
        if n >= 0:
            A[1, 2 + n] = 1 / m
        columns.append((scipy.linalg.expm(A * length) @ start)[:2])
    return np.array(columns).T
