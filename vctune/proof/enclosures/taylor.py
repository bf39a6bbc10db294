"""Polynomials of order two in a box's rows with enclosed remainders: many boxes at once.

A `Taylor` is a number as a polynomial in e_1 ... e_k, each between -1 and 1: the rows of a box from one end to the
other. A radius holds all that is of higher order and every rounding (Taylor models: Makino and Berz 2003). Unlike the
slopes of a jet it shows how rows act together: at a resonance mass and stiffness may change much, if only both do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, UNIT, Enclosure, Floats

SWOLLEN = 1 + 2.0**-44
"""Covers 512 roundings of a radius, each u = 2^-53 of it. For 14 rows and matrices of 8 the rest of a product takes
most: 105 coefficients of order two by rows, 14 rows, 2 for the constant, 15 rests, 8 products added up, and 8 more:
152. Half would cover 256; twice widens a radius by 1e-13 of itself."""
HIGHER_ERROR = 1e-13
"""Bound on the relative rounding of f' and f''/2: 900 units of u = 2^-53. For a reciprocal 1/m, rounded once, f''/2
takes most: three times that, and 2 for a library's cube make 5; f' takes 3, two of them from 1/m. For a root f''/2
takes 3: the root, its product with m, and the quotient. The errors of a library's exp, sin and cos are in `error`, and
so are all of sinc, whose slopes cancel. Half would do; twice is as well."""

Times = Callable[[Floats, Floats], Floats]


class Taylor:
    """A number over boxes of k rows, or a matrix of them.

    Attributes
    ----------
    rows : k
    poly : coefficients of 1, of each e_i and of each e_i e_j, i <= j; shape (1 + k + k (k + 1)/2, ..., n)
    rest : radius of the remainder, by the row that causes it, and last that of rounding; shape (k + 1, ..., n)
    """

    __slots__ = ("_sizes", "poly", "rest", "rows")
    __array_ufunc__ = None

    def __init__(self, rows: int, poly: Floats, rest: Floats) -> None:
        self.rows = rows
        self.poly = poly
        self.rest = rest
        self._sizes: _Sizes | None = None

    @property
    def sizes(self) -> _Sizes:
        """How large its parts are."""
        if self._sizes is None:
            self._sizes = _Sizes(self)
        return self._sizes

    def __add__(self, other: Any) -> Taylor:
        if isinstance(other, Taylor):
            poly, rest = self.poly + other.poly, self.rest + other.rest
            rest[-1] += UNIT * np.abs(poly).sum(axis=0) + TINY
            return Taylor(self.rows, poly, rest * SWOLLEN)
        mid, rad = _constant(other)
        poly, rest = self.poly.copy(), self.rest.copy()
        poly[0] += mid
        rest[-1] += rad + UNIT * np.abs(poly[0]) + TINY
        return Taylor(self.rows, poly, rest * SWOLLEN)

    def __neg__(self) -> Taylor:
        return Taylor(self.rows, -self.poly, self.rest)

    def __sub__(self, other: Any) -> Taylor:
        return self + -other

    def __rsub__(self, other: Any) -> Taylor:
        return -self + other

    def __mul__(self, other: Any) -> Taylor:
        if isinstance(other, Taylor):
            return _product(self, other, np.multiply, 1)
        mid, rad = _constant(other)
        poly, rest = self.poly * mid, self.rest * (np.abs(mid) + rad)
        rest[-1] += (rad + UNIT * np.abs(mid)) * self.sizes.known + TINY
        return Taylor(self.rows, poly, rest * SWOLLEN)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> Taylor:
        if isinstance(other, Taylor | Enclosure):
            return self * other.reciprocal()
        return self * Enclosure(other).reciprocal()

    def __rtruediv__(self, other: Any) -> Taylor:
        return self.reciprocal() * other

    def __getitem__(self, at: Any) -> Taylor:
        at = at if isinstance(at, tuple) else (at,)
        return Taylor(self.rows, self.poly[(slice(None), *at)], self.rest[(slice(None), *at)])

    def subset(self, at: Any) -> Taylor:
        """Return some of the boxes."""
        return Taylor(self.rows, self.poly[..., at], self.rest[..., at])

    def matmul(self, other: Taylor) -> Taylor:
        """Return the products of matrices whose rows and columns are the first two axes."""
        return _product(self, other, _matrices, self.poly.shape[2])

    def enclosed(self) -> Enclosure:
        """Return all its values."""
        rad = self.sizes.slope + self.sizes.curve + self.rest.sum(axis=0)
        return Enclosure(self.poly[0], rad * SWOLLEN)

    def reciprocal(self) -> Taylor:
        """Return 1/x; unbounded where x may be 0."""
        gap = np.abs(self.poly[0]) - self.enclosed().rad
        one, least = 1 / self.poly[0], np.where(gap > 0, gap, np.nan)
        # 1/(m + e) = 1/m - e/m^2 + e^2/m^3 - e^3/(m^3 (m + e))
        return self.mapped((one, -one * one, one**3), 6 * np.abs(one) ** 3 / least, UNIT * np.abs(one))

    def mapped(self, series: tuple[Floats, Floats, Floats], third: Any, error: Any) -> Taylor:
        """Return f(x) of this number x, to second order with an enclosed remainder.

        Parameters
        ----------
        series : f, f' and f''/2 at the middle of x
        third : bound of |f'''| over all values of x, or of six times what is left out over the cube of e
        error : absolute rounding error of the three numbers of `series`; the latter two may be off by `HIGHER_ERROR`
            relatively, too

        Returns
        -------
        Taylor
            Of the same boxes.
        """
        value, first, second = series
        poly = self.poly.copy()
        poly[0] = 0.0
        off = Taylor(self.rows, poly, self.rest)
        found = (off * off) * second + off * first + value
        reach, rest = off.enclosed().rad, found.rest
        left_out, shares = third / 6 * reach**3, off.sizes.linear + off.sizes.quad + off.rest[:-1]
        total = shares.sum(axis=0)
        rest[:-1] += shares * (left_out / np.maximum(total, TINY))
        rest[-1] += np.where(total > TINY, 0.0, left_out)
        rest[-1] += error * (1 + reach + reach**2)
        rest[-1] += HIGHER_ERROR * (np.abs(first) * reach + np.abs(second) * reach**2)
        return Taylor(self.rows, found.poly, rest * SWOLLEN)


class _Sizes:
    """How large the parts of a number are.

    Attributes
    ----------
    linear, quad : of e_i, and of e_i e_j by halves, for each row
    slope, curve, known : of all e_i, all e_i e_j, and these with the constant
    """

    __slots__ = ("curve", "known", "linear", "quad", "slope")

    def __init__(self, x: Taylor) -> None:
        size, k = np.abs(x.poly), x.rows
        self.linear = size[1 : 1 + k]
        self.quad = (_halves(k) @ size[1 + k :].reshape(-1, size[0].size)).reshape(k, *size.shape[1:])
        self.slope, self.curve = self.linear.sum(axis=0), self.quad.sum(axis=0)
        self.known = size[0] + self.slope + self.curve


@cache
def _halves(rows: int) -> Floats:
    """Return of each e_i e_j, i <= j, half for row i and half for row j, shape (rows, number of these)."""
    halves, pairs = np.zeros((rows, rows * (rows + 1) // 2)), np.triu_indices(rows)
    for row in pairs:
        np.add.at(halves, (row, np.arange(halves.shape[1])), 0.5)
    return halves


def variables(rows: Sequence[Enclosure], varied: Sequence[bool]) -> list[Taylor | Enclosure]:
    """Return the rows of n boxes as polynomials, each of degree 1 in its own variable e_i in [-1, 1].

    Parameters
    ----------
    rows : enclosures of each row's interval, for n boxes
    varied : for each row, whether it varies over some box; k rows do

    Returns
    -------
    list of Taylor or Enclosure
        Polynomials in k variables. A row that does not vary stays an enclosure.
    """
    k, n = sum(varied), max(np.size(row.mid) for row in rows)

    def alone(place: int, row: Enclosure) -> Taylor:
        # coefficients of 1, of each e_i, and of each e_i e_j with i <= j
        poly = np.zeros((1 + k + k * (k + 1) // 2, n))
        poly[0], poly[1 + place] = row.mid, row.rad
        return Taylor(k, poly, np.zeros((k + 1, n)))

    places = iter(range(k))
    return [alone(next(places), row) if varies else row for row, varies in zip(rows, varied, strict=True)]


def stacked(numbers: Sequence[Any]) -> Taylor:
    """Return numbers as one with another axis in front.

    Parameters
    ----------
    numbers : at least one `Taylor`; enclosures and plain numbers
    """
    one = next(x for x in numbers if isinstance(x, Taylor))
    poly, rest = (np.zeros((len(part), len(numbers), *part.shape[1:])) for part in (one.poly, one.rest))
    for place, x in enumerate(numbers):
        if isinstance(x, Taylor):
            poly[:, place], rest[:, place] = x.poly, x.rest
        else:
            poly[0, place], rest[-1, place] = _constant(x)
    return Taylor(one.rows, poly, rest)


def _constant(x: Any) -> tuple[Any, Any]:
    return (x.mid, x.rad) if isinstance(x, Enclosure) else (x, 0.0)


def _product(a: Taylor, b: Taylor, times: Times, terms: int) -> Taylor:
    """Return a b.

    Parameters
    ----------
    times : product of arrays of numbers or matrices; one, or both, may have another axis in front
    terms : number of products in the sum
    """
    k, A, B = a.rows, a.sizes, b.sizes
    poly = times(a.poly, b.poly[0])
    poly[1:] += times(a.poly[0], b.poly[1:])
    at, one, two = 1 + k, a.poly[1 : 1 + k], b.poly[1 : 1 + k]
    for i in range(k):
        poly[at : at + k - i] += times(one[i], two[i:])
        poly[at + 1 : at + k - i] += times(one[i + 1 :], two[i])
        at += k - i
    rest = times(a.rest, B.known + b.rest.sum(axis=0)) + times(A.known, b.rest)
    rest[:k] += times(A.linear + A.quad, 0.5 * B.curve) + times(0.5 * (A.slope + A.curve), B.quad)
    rest[:k] += times(A.quad, 0.5 * B.slope) + times(0.5 * A.curve, B.linear)
    rest[-1] += 4 * terms * UNIT * times(A.known, B.known) + TINY
    return Taylor(k, poly, rest * SWOLLEN)


def _matrices(x: Floats, y: Floats) -> Floats:
    many = ["c" * (part.ndim > 3) for part in (x, y)]
    return np.asarray(np.einsum(f"{many[0]}ijn,{many[1]}jkn->{max(many)}ikn", x, y))
