"""Polynomials of order two in the rows of a box, with enclosed remainders, for many boxes at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from vctune.proof.enclosures.elementary import UNIT
from vctune.proof.enclosures.intervals import TINY, Enclosure, Floats
from vctune.running import check_time

SWOLLEN = 1 + 2.0**-44  # Factor that covers 512 roundings of a radius; each rounding is at most u = 2^-53 of the radius
HIGHER_ERROR = 1e-13  # Bound on the relative rounding error of f' and f''/2: 900 u with u = 2^-53

REAL = int | float | np.ndarray | Enclosure  # numbers that a polynomial can be added to and multiplied with

Times = Callable[[Floats, Floats], Floats]  # Function that multiplies arrays of numbers, or of matrices, for each box


class Taylor:
    """A number, or a matrix of numbers, over n boxes, in which the same k rows vary."""

    __slots__ = ("_magnitudes", "coefficients", "radii", "row_count")
    __array_ufunc__ = None  # a NumPy array times a Taylor calls __rmul__ once, not for each element

    def __init__(self, row_count: int, coefficients: Floats, radii: Floats) -> None:
        self.row_count = row_count
        self.coefficients = coefficients
        self.radii = radii
        self._magnitudes: _Magnitudes | None = None

    @property
    def magnitudes(self) -> _Magnitudes:
        """The greatest magnitudes of the polynomial's parts, from which products compute their radii."""
        if self._magnitudes is None:
            self._magnitudes = _Magnitudes(self)
        return self._magnitudes

    def __add__(self, other: Any) -> Taylor:
        if isinstance(other, Taylor):
            coefficients, radii = self.coefficients + other.coefficients, self.radii + other.radii
            radii[-1] += UNIT * np.abs(coefficients).sum(axis=0) + TINY
            radii *= SWOLLEN
            return Taylor(self.row_count, coefficients, radii)
        if not isinstance(other, REAL):
            return NotImplemented
        mid, rad = _mid_and_rad(other)
        coefficients, radii = self.coefficients.copy(), self.radii.copy()
        coefficients[0] += mid
        radii[-1] += rad + UNIT * np.abs(coefficients[0]) + TINY
        return Taylor(self.row_count, coefficients, radii * SWOLLEN)

    def __neg__(self) -> Taylor:
        return Taylor(self.row_count, -self.coefficients, self.radii)

    def __sub__(self, other: Any) -> Taylor:
        return self + -other

    def __rsub__(self, other: Any) -> Taylor:
        return -self + other

    def __mul__(self, other: Any) -> Taylor:
        if isinstance(other, Taylor):
            return _product(self, other, np.multiply, 1)
        if not isinstance(other, REAL):
            return NotImplemented
        mid, rad = _mid_and_rad(other)
        coefficients, radii = self.coefficients * mid, self.radii * (np.abs(mid) + rad)
        radii[-1] += (rad + UNIT * np.abs(mid)) * np.abs(self.coefficients).sum(axis=0) + TINY
        return Taylor(self.row_count, coefficients, radii * SWOLLEN)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> Taylor:
        if isinstance(other, Taylor | Enclosure):
            return self * other.reciprocal()
        return self * Enclosure(other).reciprocal() if isinstance(other, REAL) else NotImplemented

    def __rtruediv__(self, other: Any) -> Taylor:
        return self.reciprocal() * other

    def __getitem__(self, at: Any) -> Taylor:
        at = at if isinstance(at, tuple) else (at,)  # an index of the matrix, behind the axis of the coefficients
        return Taylor(self.row_count, self.coefficients[(slice(None), *at)], self.radii[(slice(None), *at)])

    def subset(self, at: Any) -> Taylor:
        """Return the number over some of the boxes."""
        return Taylor(self.row_count, self.coefficients[..., at], self.radii[..., at])

    def matmul(self, other: Taylor) -> Taylor:
        """Return the matrix product of this matrix and another one, for each box."""
        columns = self.coefficients.shape[2]
        return _product(self, other, _matrix_product, columns)

    def enclosed(self) -> Enclosure:
        """Return an enclosure of all values of this number over each box."""
        rad = self.magnitudes.linear + self.magnitudes.quadratic + self.radii.sum(axis=0)
        return Enclosure(self.coefficients[0], rad * SWOLLEN)

    def reciprocal(self) -> Taylor:
        """Return 1/x. Where x may be 0, the sum of the result's radii is nan, so that the result proves nothing."""
        constant = self.coefficients[0]
        gap = np.abs(constant) - self.enclosed().rad
        inverse, least_size = 1 / constant, np.where(gap > 0, gap, np.nan)
        # 1/(m + e) = 1/m - e/m^2 + e^2/m^3 - e^3/(m^3 (m + e))
        series = inverse, -inverse * inverse, inverse**3
        return self.mapped(series, 6 * np.abs(inverse) ** 3 / least_size, UNIT * np.abs(inverse))

    def mapped(
        self, series: tuple[Floats, Floats, Floats], third_derivative: Any, error: Any, slope_error: Any = 0.0
    ) -> Taylor:
        """Return f(x) of this number x, to second order with an enclosed remainder.

        The rounding error of f is `error`; that of f' and of half of f'' is `HIGHER_ERROR` of each and `slope_error`.
        """
        value, first, second = series
        coefficients = self.coefficients.copy()
        coefficients[0] = 0.0
        deviation = Taylor(self.row_count, coefficients, self.radii)  # e = x - m
        result = (deviation * deviation) * second + deviation * first + value
        reach, radii = deviation.enclosed().rad, result.radii  # |e| <= reach
        # each row takes the share of the remainder f'''/6 e^3 that it has in e; rounding takes all of it if e has none
        remainder = third_derivative / 6 * reach**3
        by_row = deviation.magnitudes.linear_by_row + deviation.magnitudes.quadratic_by_row + deviation.radii[:-1]
        total = by_row.sum(axis=0)
        radii[:-1] += by_row * (remainder / np.maximum(total, TINY))
        radii[-1] += np.where(total > TINY, 0.0, remainder)
        radii[-1] += error + (HIGHER_ERROR * np.abs(first) + slope_error) * reach
        radii[-1] += (HIGHER_ERROR * np.abs(second) + slope_error) * reach**2
        return Taylor(self.row_count, result.coefficients, radii * SWOLLEN)


class _Magnitudes:
    """The greatest magnitudes that the parts of a polynomial have for |e_i| <= 1."""

    __slots__ = (
        "half_quadratic", "half_reach", "linear", "linear_by_row", "polynomial", "quadratic", "quadratic_by_row",
        "whole",
    )  # fmt: skip

    def __init__(self, x: Taylor) -> None:
        sizes, k = np.abs(x.coefficients), x.row_count
        self.linear_by_row = sizes[1 : 1 + k]
        pairs = sizes[1 + k :]
        self.quadratic_by_row = (_half_shares(k) @ pairs.reshape(-1, sizes[0].size)).reshape(k, *sizes.shape[1:])
        self.linear, self.quadratic = self.linear_by_row.sum(axis=0), self.quadratic_by_row.sum(axis=0)
        reach = self.linear + self.quadratic
        self.half_quadratic, self.half_reach = 0.5 * self.quadratic, 0.5 * reach
        self.polynomial = sizes[0] + reach
        self.whole = self.polynomial + x.radii.sum(axis=0)  # with the radii


@cache
def _half_shares(row_count: int) -> Floats:
    """Return the matrix that gives half of each e_i e_j, i <= j, to row i and half to row j. Row i thus gets all of
    e_i^2."""
    shares, pairs = np.zeros((row_count, row_count * (row_count + 1) // 2)), np.triu_indices(row_count)
    for row in pairs:
        np.add.at(shares, (row, np.arange(shares.shape[1])), 0.5)
    return shares


def variables(rows: Sequence[Enclosure], varied: Sequence[bool]) -> list[Taylor | Enclosure]:
    """Return the rows of n boxes as polynomials, each of degree 1 in its own variable e_i in [-1, 1]."""
    k, n = sum(varied), max(np.size(row.mid) for row in rows if isinstance(row, Enclosure))

    def linear_in(index: int, row: Enclosure) -> Taylor:
        # coefficients of 1, of each e_i, and of each e_i e_j with i <= j
        coefficients = np.zeros((1 + k + k * (k + 1) // 2, n))
        coefficients[0], coefficients[1 + index] = row.mid, row.rad
        return Taylor(k, coefficients, np.zeros((k + 1, n)))

    indices = iter(range(k))
    return [linear_in(next(indices), row) if varies else row for row, varies in zip(rows, varied, strict=True)]


def stacked(numbers: Sequence[Any]) -> Taylor:
    """Return one `Taylor` whose new first axis, behind the axis of the coefficients, runs over the given numbers."""
    model = next(x for x in numbers if isinstance(x, Taylor))
    coefficients, radii = (
        np.zeros((len(part), len(numbers), *part.shape[1:])) for part in (model.coefficients, model.radii)
    )
    for place, x in enumerate(numbers):
        if isinstance(x, Taylor):
            coefficients[:, place], radii[:, place] = x.coefficients, x.radii
        else:
            coefficients[0, place], radii[-1, place] = _mid_and_rad(x)
    return Taylor(model.row_count, coefficients, radii)


def _mid_and_rad(x: Any) -> tuple[Any, Any]:
    """Return the middle and the radius of an enclosure or of a plain number, whose radius is 0."""
    return (x.mid, x.rad) if isinstance(x, Enclosure) else (x, 0.0)


@cache
def _pairs(row_count: int) -> tuple[Any, ...]:
    """Return i and j of each pair i <= j, the places of those with i < j, and their i and j."""
    i, j = np.triu_indices(row_count)
    apart = np.flatnonzero(i < j)
    return i, j, apart, i[apart], j[apart]


def _product(a: Taylor, b: Taylor, times: Times, terms: int) -> Taylor:
    """Return the product a b. A proof consists of these products, so that here it meets its time limit."""
    check_time()
    k, A, B = a.row_count, a.magnitudes, b.magnitudes
    coefficients = times(a.coefficients, b.coefficients[0])
    coefficients[1:] += times(a.coefficients[0], b.coefficients[1:])
    linear_a, linear_b = a.coefficients[1 : 1 + k], b.coefficients[1 : 1 + k]
    (i, j, apart, i_apart, j_apart), quadratic = _pairs(k), coefficients[1 + k :]
    quadratic += times(linear_a[i], linear_b[j])
    if k > 1:
        quadratic[apart] += times(linear_a[j_apart], linear_b[i_apart])
    # With the linear part l, the quadratic part q and the radius r of each factor, the polynomial leaves out
    # r_a |b| + |a| r_b + r_a r_b and the terms of higher order, l_a q_b + q_a (l_b + q_b). Half of each counts for the
    # rows of its part of a, and half for the rows of its part of b.
    radii = times(a.radii, B.whole) + times(A.polynomial, b.radii)
    radii[:k] += times(A.linear_by_row, B.half_quadratic) + times(A.quadratic_by_row, B.half_reach)
    radii[:k] += times(A.half_quadratic, B.linear_by_row) + times(A.half_reach, B.quadratic_by_row)
    # A coefficient is the sum of at most four results of `times`. Each product of two numbers in it is thus rounded at
    # most terms + 3 <= 4 terms times.
    radii[-1] += 4 * terms * UNIT * times(A.polynomial, B.polynomial) + TINY
    radii *= SWOLLEN
    return Taylor(k, coefficients, radii)


def _matrix_product(x: Floats, y: Floats) -> Floats:
    """Return the matrix product for each box."""
    coefficient_axes = ["c" * (part.ndim > 3) for part in (x, y)]
    x_axis, y_axis = coefficient_axes
    return np.asarray(np.einsum(f"{x_axis}ijn,{y_axis}jkn->{max(coefficient_axes)}ikn", x, y))


SWEEPS = 4  # Number of times that the code moves each row of y to its best position
ROUNDING = 2.0**-43  # Rounding error of a bound, relative to the magnitudes in its sum: 1024 u with u = 2^-53


@dataclass(frozen=True, slots=True)
class LowerBound:
    """A lower bound for each of n boxes."""

    bound: Floats  # lower bound of all values over the box; -inf if no bound is known
    estimate: Floats  # approximate value of the polynomial at `at`
    at: Floats  # approximate position of the minimum, each row between -1 and 1, shape (k, n)
    cost: Floats  # amount by which each row lowers the bound, shape (k, n)


def least_over_boxes(number: Taylor) -> LowerBound:
    """Bound a polynomial from below over each of its boxes."""
    k, poly = number.row_count, number.coefficients
    known = np.isfinite(poly).all(axis=0) & np.isfinite(number.radii).all(axis=0)
    poly, rest = np.where(known, poly, 0.0), np.where(known, number.radii, np.inf)
    constant, slopes = poly[0], poly[1 : 1 + k]
    i, j = np.triu_indices(k)
    curved = np.zeros((poly.shape[1], k, k))
    curved[:, i, j] = 0.5 * poly[1 + k :].T
    curved += curved.transpose(0, 2, 1)
    values, vectors = np.linalg.eigh(curved)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    convex = np.moveaxis(roots @ roots.transpose(0, 2, 1), 0, -1)
    others = np.moveaxis(curved, 0, -1) - convex
    at = _nearly_least(slopes, convex)
    moved = np.einsum("ijn,jn->in", convex, at)
    lower = -np.abs(slopes + 2 * moved).sum(axis=0) - (at * moved).sum(axis=0)
    own = np.einsum("iin->in", others)
    lost = np.abs(others).sum(axis=1) - np.abs(own) + np.maximum(-own, 0.0)
    size = np.abs(poly).sum(axis=0) + k * np.einsum("iin->n", convex) + np.abs(others).sum(axis=(0, 1))
    bound = constant + lower - lost.sum(axis=0) - rest.sum(axis=0)
    estimate = constant + (slopes * at).sum(axis=0) + np.einsum("in,ijn,jn->n", at, convex + others, at)
    return LowerBound(np.where(known, bound - ROUNDING * size, -np.inf), estimate, at, lost + rest[:-1])


def _nearly_least(slopes: Floats, convex: Floats) -> Floats:
    """Return the approximate position of the minimum of g.e + e'S e. The function moves one row at a time."""
    at, moved = np.zeros_like(slopes), np.zeros_like(slopes)
    for _ in range(SWEEPS):
        for row, own in enumerate(np.einsum("iin->in", convex)):
            pull = 0.5 * slopes[row] + moved[row] - own * at[row]
            with np.errstate(all="ignore"):
                best = np.where(own > 0, -pull / own, -np.sign(pull))
            best = np.clip(np.where(np.isnan(best), 0.0, best), -1.0, 1.0)
            moved = moved + convex[:, row] * (best - at[row])
            at[row] = best
    return at
