"""Polynomials of order two in the rows of a box, with enclosed remainders, for many boxes at once.

A `Taylor` represents a number as a polynomial in e_1 ... e_k. Each e_i runs from -1 to 1, as row i of the box runs from
its lower to its upper end. A radius covers all terms of higher order and every rounding error (Taylor models: Makino
and Berz 2003). Unlike the slopes of a jet, the polynomial shows how rows act together. At a resonance, for example, the
number may hardly vary if mass and stiffness vary in proportion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, UNIT, Enclosure, Floats

SWOLLEN = 1 + 2.0**-44
"""Factor that covers 512 roundings of a radius; each rounding is at most u = 2^-53 of the radius. The remainder of a
product needs the most roundings. For 14 rows and 8-by-8 matrices there are 152: 105 for the coefficients of order
two, 14 for the rows, 2 for the constant, 15 for the remainders, 8 for the sum of the products, and 8 others. With
half its excess over 1, the factor would cover 256 roundings; with twice the excess, it would widen a radius by a
relative 1e-13."""
HIGHER_ERROR = 1e-13
"""Bound on the relative rounding error of f' and f''/2: 900 u with u = 2^-53. The reciprocal 1/m has one rounding. Its
f''/2 takes the most roundings: three for the cube of 1/m, and 2 for the library's cube. Its f' takes 3, two of them
from 1/m. For a square root, f''/2 takes 3: the root, its product with m, and the quotient. The parameter `error` covers
the errors of a library's exp, sin and cos, and all errors of sinc, whose slopes cancel. Half this bound would suffice,
and twice this bound would work as well."""

Times = Callable[[Floats, Floats], Floats]
"""Function that multiplies arrays of numbers or of matrices."""


class Taylor:
    """A number, or a matrix of numbers, over boxes of k rows.

    Attributes
    ----------
    rows : number k of rows
    poly : coefficients of 1, of each e_i and of each e_i e_j in the order (1, 1), (1, 2) ... (1, k), (2, 2) ..., for n
        boxes; shape (1 + k + k (k + 1)/2, ..., n), where a matrix has two axes before n
    rest : radius of the remainder for each row that causes it, and then the radius of all rounding errors; shape
        (k + 1, ..., n)
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
        """The magnitudes of the number's parts, from which products compute their remainder."""
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
        rest[-1] += (rad + UNIT * np.abs(mid)) * self.sizes.magnitude + TINY
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
        """Return the matrix products over the first two axes, which are the rows and columns of matrices."""
        return _product(self, other, _matrices, self.poly.shape[2])

    def enclosed(self) -> Enclosure:
        """Return an enclosure of all values of this number."""
        rad = self.sizes.slope + self.sizes.curve + self.rest.sum(axis=0)
        return Enclosure(self.poly[0], rad * SWOLLEN)

    def reciprocal(self) -> Taylor:
        """Return 1/x; its radius is infinite where x may be 0."""
        gap = np.abs(self.poly[0]) - self.enclosed().rad
        inverse, least_size = 1 / self.poly[0], np.where(gap > 0, gap, np.nan)
        # 1/(m + e) = 1/m - e/m^2 + e^2/m^3 - e^3/(m^3 (m + e))
        series = inverse, -inverse * inverse, inverse**3
        return self.mapped(series, 6 * np.abs(inverse) ** 3 / least_size, UNIT * np.abs(inverse))

    def mapped(self, series: tuple[Floats, Floats, Floats], third: Any, error: Any) -> Taylor:
        """Return f(x) of this number x, to second order with an enclosed remainder.

        Parameters
        ----------
        series : f, f' and f''/2 at the constant m of the polynomial
        third : bound of |f'''| over all values x = m + e, or of 6 |f(x) - series|/|e|^3
        error : absolute rounding error of the three numbers of `series`; f' and f''/2 may in addition have the relative
            error `HIGHER_ERROR`

        Returns
        -------
        Taylor
            A number over the same boxes.
        """
        value, first, second = series
        poly = self.poly.copy()
        poly[0] = 0.0
        off = Taylor(self.rows, poly, self.rest)
        found = (off * off) * second + off * first + value
        reach, rest = off.enclosed().rad, found.rest
        left_out, sizes = third / 6 * reach**3, off.sizes.linear + off.sizes.quad + off.rest[:-1]
        total = sizes.sum(axis=0)
        rest[:-1] += sizes * (left_out / np.maximum(total, TINY))
        rest[-1] += np.where(total > TINY, 0.0, left_out)
        rest[-1] += error * (1 + reach + reach**2)
        rest[-1] += HIGHER_ERROR * (np.abs(first) * reach + np.abs(second) * reach**2)
        return Taylor(self.rows, found.poly, rest * SWOLLEN)


class _Sizes:
    """The magnitudes of the parts of a number, from which products compute their remainder.

    Attributes
    ----------
    linear, quad : for each row, the magnitude of its e_i term, and that of its e_i^2 term with half of each mixed term
    slope, curve, magnitude : magnitude of all e_i terms, magnitude of all e_i e_j terms, and the sum of both magnitudes
        and the magnitude of the constant
    """

    __slots__ = ("curve", "linear", "magnitude", "quad", "slope")

    def __init__(self, x: Taylor) -> None:
        size, k = np.abs(x.poly), x.rows
        self.linear = size[1 : 1 + k]
        self.quad = (_halves(k) @ size[1 + k :].reshape(-1, size[0].size)).reshape(k, *size.shape[1:])
        self.slope, self.curve = self.linear.sum(axis=0), self.quad.sum(axis=0)
        self.magnitude = size[0] + self.slope + self.curve


@cache
def _halves(rows: int) -> Floats:
    """Return weights that give half of each e_i e_j, i <= j, to row i and half to row j, shape (rows, number of
    pairs)."""
    halves, pairs = np.zeros((rows, rows * (rows + 1) // 2)), np.triu_indices(rows)
    for row in pairs:
        np.add.at(halves, (row, np.arange(halves.shape[1])), 0.5)
    return halves


def variables(rows: Sequence[Enclosure], varied: Sequence[bool]) -> list[Taylor | Enclosure]:
    """Return the rows of n boxes as polynomials, each of degree 1 in its own variable e_i in [-1, 1].

    Parameters
    ----------
    rows : enclosures of each row's interval, for n boxes
    varied : for each row, whether it varies over some box; k rows vary

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
    """Return one `Taylor` whose new first axis runs over the given numbers.

    Parameters
    ----------
    numbers : at least one `Taylor`; the others may be enclosures or plain numbers
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
    """Return the middle and the radius of an enclosure or of a plain number."""
    return (x.mid, x.rad) if isinstance(x, Enclosure) else (x, 0.0)


def _product(a: Taylor, b: Taylor, times: Times, terms: int) -> Taylor:
    """Return the product a b.

    Parameters
    ----------
    times : function that multiplies arrays of numbers or matrices; either array or both may have a further first axis
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
    rest = times(a.rest, B.magnitude + b.rest.sum(axis=0)) + times(A.magnitude, b.rest)
    rest[:k] += times(A.linear + A.quad, 0.5 * B.curve) + times(0.5 * (A.slope + A.curve), B.quad)
    rest[:k] += times(A.quad, 0.5 * B.slope) + times(0.5 * A.curve, B.linear)
    rest[-1] += 4 * terms * UNIT * times(A.magnitude, B.magnitude) + TINY
    return Taylor(k, poly, rest * SWOLLEN)


def _matrices(x: Floats, y: Floats) -> Floats:
    """Return the matrix product for each box. A further first axis of x or y runs over coefficients."""
    many = ["c" * (part.ndim > 3) for part in (x, y)]
    return np.asarray(np.einsum(f"{many[0]}ijn,{many[1]}jkn->{max(many)}ikn", x, y))
