"""Elementary functions in double precision whose errors follow from IEEE 754 alone (proof/README.md, section 6).

They use + - x / and the square root, which round to nearest, and functions that are exact: rounding to an integer,
scaling by a power of 2 and splitting into mantissa and exponent. They return the same digits on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

UNIT = 2.0**-52  # Twice the relative rounding error of an operation (IEEE 754, round to nearest)
# Bounds on the error of sine and cosine; on the relative error of the exponential; and on the relative error of
# phi_1 and (1 - sinc x)/x^2
SINE_ERROR, EXP_ERROR, PHI_ERROR = 3 * UNIT, 3 * UNIT, 1e-13
LOG_ERROR = 4 * UNIT  # Bound on the error of the logarithm, relative to 1 + |log x|

GREATEST = 2.0**20  # Greatest argument of sine and cosine; beyond it they are nan
# pi/2 = QUARTER + QUARTER_LOW + QUARTER_REST and log 2 = LOG_2 + LOG_2_REST; products of the first parts with the
# integers below are exact
QUARTER, QUARTER_LOW = float.fromhex("0x1.921fb544p+0"), float.fromhex("0x1.0b4611ap-34")
QUARTER_REST = float.fromhex("0x1.898cc51701b84p-64")
LOG_2, LOG_2_REST = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
PHI_BELOW, CURVATURE_BELOW = 1.0, 0.5  # arguments below which phi_1 and (1 - sinc x)/x^2 are series


def _series(terms: Sequence[float], x: Floats) -> Floats:
    """Return terms[0] + terms[1] x + ... by Horner's rule."""
    total = x * terms[-1] + terms[-2]
    for term in terms[-3::-1]:
        total *= x
        total += term
    return total


SINE = [(-1) ** n / factorial(2 * n + 1) for n in range(1, 8)]
COSINE = [(-1) ** n / factorial(2 * n) for n in range(1, 9)]
EXPONENTIAL = [1 / factorial(n) for n in range(1, 14)]
PHI_1 = [(-1) ** n / factorial(n + 1) for n in range(19)]
CURVATURE = [(-1) ** n / factorial(2 * n + 3) for n in range(7)]
LOGARITHM = [2 / (2 * n + 1) for n in range(1, 11)]


def sine_and_cosine(x: Any) -> tuple[Floats, Floats]:
    """Return sin x and cos x."""
    x = np.asarray(x, float)
    x = np.where(np.abs(x) <= GREATEST, x, np.nan)
    quarters = np.rint(x * (2 / np.pi))
    r = ((x - quarters * QUARTER) - quarters * QUARTER_LOW) - quarters * QUARTER_REST
    z = r * r
    sine, cosine = r + r * (z * _series(SINE, z)), 1 + z * _series(COSINE, z)
    if not quarters.any():
        return sine, cosine
    turn = np.nan_to_num(quarters).astype(np.int64) & 3
    odd, sign = turn & 1 == 1, np.where(turn & 2, -1.0, 1.0)
    return sign * np.where(odd, cosine, sine), sign * np.where(odd, -sine, cosine)


def sine(x: Any) -> Floats:
    """Return sin x."""
    return sine_and_cosine(x)[0]


def cosine(x: Any) -> Floats:
    """Return cos x."""
    return sine_and_cosine(x)[1]


@np.errstate(over="ignore")
def exponential(x: Any) -> Floats:
    """Return e^x; inf where it overflows, and a number below 1e-300 where it underflows."""
    x = np.clip(np.asarray(x, float), -800.0, 800.0)
    doublings = np.rint(x * (1 / np.log(2.0)))
    r = (x - doublings * LOG_2) - doublings * LOG_2_REST
    return np.ldexp(1 + r * _series(EXPONENTIAL, r), np.nan_to_num(doublings).astype(np.int64))


def logarithm(x: Any) -> Floats:
    """Return the natural logarithm of normal numbers x > 0."""
    mantissa, doublings = np.frexp(np.asarray(x, float))
    small = mantissa < np.sqrt(0.5)
    mantissa, doublings = np.where(small, 2 * mantissa, mantissa), doublings - small
    s = (mantissa - 1) / (mantissa + 1)
    return np.asarray(doublings * LOG_2 + (doublings * LOG_2_REST + (2 * s + s * (s * s * _series(LOGARITHM, s * s)))))


def sinc(x: Any) -> Floats:
    """Return sin(x)/x, 1 at x = 0."""
    x = np.asarray(x, float)
    return np.where(x == 0, 1.0, sine(x) / np.where(x == 0, 1.0, x))


def sinc_curvature(x: Any) -> Floats:
    """Return (1 - sin(x)/x)/x^2, 1/6 at x = 0."""
    x = np.asarray(x, float)
    small = np.abs(x) < CURVATURE_BELOW
    near, far = np.where(small, x, 0.0), np.where(small, 1.0, x)
    return np.where(small, _series(CURVATURE, near * near), (1 - sinc(far)) / far**2)


def phi_1(x: Any) -> Floats:
    """Return (1 - e^-x)/x for x >= 0, 1 at x = 0."""
    x = np.asarray(x, float)
    small = np.abs(x) < PHI_BELOW
    near, far = np.where(small, x, 0.0), np.where(small, 1.0, x)
    return np.where(small, _series(PHI_1, near), (1 - exponential(-far)) / far)


def interpolated(x: Any, table: tuple[tuple[float, float], ...]) -> Floats:
    """Return a table's values at x > 0, interpolated linearly in the logarithms of both."""
    at, value = (logarithm(np.array(row)) for row in zip(*table, strict=True))
    return exponential(np.interp(logarithm(x), at, value))
