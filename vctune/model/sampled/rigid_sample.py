"""Compute functions of a rigid device and hand over a sample in closed form (model/README.md, section 14)."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from math import comb, factorial, pi, sqrt
from typing import NamedTuple

from vctune.model.numbers.arithmetic import ArrayArithmetic, Number
from vctune.model.numbers.matrices import LEFT_OUT, add, bernoulli, times

WITHIN = 2.0  # Spectral radius of X up to which the code uses the series
COEFFICIENT = 3.3  # Upper bound of 2 zeta(2)
RAISED = 1 + 1e-9  # Factor that covers the rounding errors in a bound


class Linear(NamedTuple):
    """The matrix constant + slope X, stored as its two coefficients."""

    constant: Number
    slope: Number


class Powers(NamedTuple):
    """The powers X^n = u + v X of a matrix with X^2 = -c X - k."""

    each: tuple[Linear, ...]  # u and v for n = 0, 1,
    radius: float  # upper bound of the magnitudes of the eigenvalues of X


def powers_of(c: Number, k: Number, ops: ArrayArithmetic) -> Powers | None:
    """Return as many powers of X as the two series need."""
    damping, stiffness = ops.magnitude(c), ops.magnitude(k)
    # |x|^2 <= |c| |x| + |k| for an eigenvalue x
    radius = (damping + sqrt(damping * damping + 4 * stiffness)) / 2 * RAISED
    if not radius <= WITHIN:
        return None
    found = [Linear(1, 0), Linear(0, 1)]
    while _rest(len(found), radius) > LEFT_OUT * ops.precision:
        u, v = found[-1]
        found.append(Linear(times(-k, v), add(u, times(-c, v))))
    return Powers(tuple(found), radius)


def half_coth_of(powers: Powers, ops: ArrayArithmetic) -> Linear:
    """Return (X/2) coth(X/2). An arithmetic of enclosures includes the remainder of the series."""
    even = {n: _coefficient(bernoulli(n) / factorial(n), ops) for n in range(2, len(powers.each), 2)}
    return _summed({0: 1, **even}, powers, ops)


def share_of_older(powers: Powers, older: Number, ops: ArrayArithmetic) -> Linear:
    """Return (e^X - e^((1-d) X))/(e^X - 1). An arithmetic of enclosures includes the remainder of the series."""
    off = older - 0.5
    square = off * off
    squares: list[Number] = [1]
    while 2 * len(squares) <= len(powers.each):
        squares.append(times(squares[-1], square) if len(squares) > 1 else square)
    coefficients: dict[int, Number] = {0: older}
    for n in range(1, len(powers.each)):
        even, odd = _in_offset(n + 1)
        value = _polynomial(even, squares, ops)
        if any(odd):
            value = add(value, times(off, _polynomial(odd, squares, ops)))
        coefficients[n] = value
    return _summed(coefficients, powers, ops)


def _summed(coefficients: dict[int, Number], powers: Powers, ops: ArrayArithmetic) -> Linear:
    """Return the sum of coefficients times powers, plus a bound of the remainder."""
    constant: Number = 0
    slope: Number = 0
    for n, factor in coefficients.items():
        u, v = powers.each[n]
        constant, slope = add(constant, times(u, factor)), add(slope, times(v, factor))
    rest = ops.within(_rest(len(powers.each), powers.radius))
    return Linear(constant + rest, slope + rest)


def _polynomial(coefficients: Sequence[Fraction], powers: Sequence[Number], ops: ArrayArithmetic) -> Number:
    total: Number = 0
    for coefficient, power in zip(coefficients, powers, strict=False):
        if coefficient:
            total = add(total, times(power, _coefficient(coefficient, ops)))
    return total


def _coefficient(exact: Fraction, ops: ArrayArithmetic) -> Number:
    """Return a coefficient as a number. An arithmetic of enclosures includes the rounding error of the double."""
    rounded = float(exact)
    return rounded + ops.within(2.0**-52 * abs(rounded))


def _rest(count: int, radius: float) -> float:
    """Return a bound of the remainder of either series after the given number of powers, for constant and slope."""
    x = radius / (2 * pi)
    return COEFFICIENT * count * x ** (count - 1) / (1 - x) ** 2 * RAISED


@cache
def _in_offset(n: int) -> tuple[tuple[Fraction, ...], tuple[Fraction, ...]]:
    """Return the coefficients of w_n(1/2 + h) with respect to the even and to the odd powers of h."""
    half = Fraction(1, 2)
    centred = [comb(n, j) * _bernoulli_polynomial(n - j, half) * (-1) ** j for j in range(n + 1)]
    found = [-each / factorial(n) for each in centred]
    found[0] += _bernoulli_polynomial(n, Fraction(1)) / factorial(n)
    return tuple(found[::2]), tuple(found[1::2])


def _bernoulli_polynomial(n: int, x: Fraction) -> Fraction:
    return sum((comb(n, j) * bernoulli(n - j) * x**j for j in range(n + 1)), Fraction(0))
