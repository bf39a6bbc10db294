"""Compute functions of a rigid device and hand over a sample in closed form (model/README.md, section 14).

The matrix X = A/E of two states satisfies X^2 = -c X - k with c = (b + B) T/(m + M) and k = K T^2/(m + M), so every
power of X, and every function of X, has the form u + v X. A sample needs two functions. The coefficients of their power
series are Bernoulli numbers and Bernoulli polynomials,

    (X/2) coth(X/2) = sum of B_n/n! X^n over even n,
    (e^X - e^((1-d) X))/(e^X - 1) = sum of w_n(d) X^(n-1) over n >= 1,

where w_n(d) = (B_n(1) - B_n(1 - d))/n!. The second function is the effect of an older force that acts for the share d
of a sample, relative to the effect of a force that acts throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from math import comb, factorial, pi, sqrt
from typing import NamedTuple

from vctune.model.numbers.arithmetic import ArrayArithmetic, Number
from vctune.model.numbers.matrices import LEFT_OUT, add, bernoulli, times

WITHIN = 2.0
"""Spectral radius of X up to which the code uses the series. The radius of convergence is 2 pi. With half this limit,
stiff hands at long sample times would need general matrix functions, which take ten times as long. With twice this
limit, the series would need twice as many terms."""
COEFFICIENT = 3.3
"""Upper bound of 2 zeta(2). If n >= 2 and x is between 0 and 1, |B_n(x)|/n! is at most 2 zeta(n)/(2 pi)^n."""
RAISED = 1 + 1e-9
"""Factor that covers the rounding errors in a bound. Half or twice the excess of this factor over 1 would also do."""


class Linear(NamedTuple):
    """The matrix constant + slope X, stored as its two coefficients."""

    constant: Number
    slope: Number


class Powers(NamedTuple):
    """The powers X^n = u + v X of a matrix with X^2 = -c X - k.

    Attributes
    ----------
    each : u and v for n = 0, 1, ...
    radius : upper bound of the magnitudes of the eigenvalues of X
    """

    each: tuple[Linear, ...]
    radius: float


def powers_of(c: Number, k: Number, ops: ArrayArithmetic) -> Powers | None:
    """Return as many powers of X as the two series need.

    Parameters
    ----------
    c, k : dimensionless numbers with X^2 = -c X - k
    ops : arithmetic of both

    Returns
    -------
    Powers or None
        None if an eigenvalue may exceed `WITHIN`.
    """
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
    """Return (X/2) coth(X/2). An arithmetic of enclosures includes the remainder of the series.

    Parameters
    ----------
    powers : powers of X
    ops : arithmetic of the powers
    """
    even = {n: _coefficient(bernoulli(n) / factorial(n), ops) for n in range(2, len(powers.each), 2)}
    return _summed({0: 1, **even}, powers, ops)


def share_of_older(powers: Powers, older: Number, ops: ArrayArithmetic) -> Linear:
    """Return (e^X - e^((1-d) X))/(e^X - 1). An arithmetic of enclosures includes the remainder of the series.

    Parameters
    ----------
    powers : powers of X
    older : d, share of the sample for which the older force acts, in [0, 1]
    ops : arithmetic of both
    """
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
    """Return a bound of the remainder of either series after the given number of powers, for constant and slope.

    With x = radius/(2 pi), u of X^n is at most (n - 1) radius^n and v at most n radius^(n-1). A coefficient is at most
    `COEFFICIENT`/(2 pi)^n in the first series, and 2 `COEFFICIENT`/(2 pi)^(n+1) in the second. The sum of n x^(n-1)
    from n = m on is at most m x^(m-1)/(1 - x)^2.
    """
    x = radius / (2 * pi)
    return COEFFICIENT * count * x ** (count - 1) / (1 - x) ** 2 * RAISED


@cache
def _in_offset(n: int) -> tuple[tuple[Fraction, ...], tuple[Fraction, ...]]:
    """Return the coefficients of w_n(1/2 + h) with respect to the even and to the odd powers of h.

    w_n(1/2 + h) equals (B_n(1) - B_n(1/2 - h))/n!.
    """
    half = Fraction(1, 2)
    centred = [comb(n, j) * _bernoulli_polynomial(n - j, half) * (-1) ** j for j in range(n + 1)]
    found = [-each / factorial(n) for each in centred]
    found[0] += _bernoulli_polynomial(n, Fraction(1)) / factorial(n)
    return tuple(found[::2]), tuple(found[1::2])


def _bernoulli_polynomial(n: int, x: Fraction) -> Fraction:
    return sum((comb(n, j) * bernoulli(n - j) * x**j for j in range(n + 1)), Fraction(0))
