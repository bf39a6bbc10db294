"""Midpoint-radius intervals on NumPy arrays in double precision: many boxes at once, with all rounding errors
enclosed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.arithmetic import FLOATS, ArrayArithmetic, Number, by_conjugate
from vctune.proof.enclosures import elementary
from vctune.proof.enclosures.elementary import EXP_ERROR, PHI_ERROR, SINE_ERROR, UNIT, exponential

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

TINY = 1e-300  # Upper bound of the loss of a sum of products by underflow; the least normal number is 2e-308
SWELL = 1 + 2.0**-49  # Factor that covers 15 roundings of a radius; each rounding is at most u = 2^-53 of the radius


def raised(total: Floats, terms: int) -> Floats:
    """Return a rounded sum, increased so that it is at least the exact sum."""
    return total * (1 + (terms + 8) * UNIT)


def _enclosed(mid: Floats, rad: Floats) -> Enclosure:
    """Return an enclosure with a rounded midpoint. Its radius includes the rounding errors."""
    return Enclosure(mid, (rad + UNIT * np.abs(mid)) * SWELL + TINY)


class Enclosure:
    """All real numbers within `rad` of `mid`, elementwise."""

    __slots__ = ("mid", "rad")
    __array_ufunc__ = None  # array + enclosure then calls __radd__

    def __init__(self, mid: Any, rad: Any = 0.0) -> None:
        self.mid = mid
        self.rad = rad

    def __add__(self, other: Any) -> Enclosure:
        if isinstance(other, Enclosure):
            return _enclosed(self.mid + other.mid, self.rad + other.rad)
        return _enclosed(self.mid + other, self.rad) if _is_plain(other) else NotImplemented

    def __neg__(self) -> Enclosure:
        return Enclosure(-self.mid, self.rad)

    def __sub__(self, other: Any) -> Enclosure:
        if isinstance(other, Enclosure):
            return _enclosed(self.mid - other.mid, self.rad + other.rad)
        return _enclosed(self.mid - other, self.rad) if _is_plain(other) else NotImplemented

    def __rsub__(self, other: Any) -> Enclosure:
        return _enclosed(other - self.mid, self.rad) if _is_plain(other) else NotImplemented

    def __mul__(self, other: Any) -> Enclosure:
        if other is self:  # only here does the code know that both factors have the same value
            return self._square()
        if isinstance(other, Enclosure):
            rad = np.abs(self.mid) * other.rad + self.rad * (np.abs(other.mid) + other.rad)
            return _enclosed(self.mid * other.mid, rad)
        return _enclosed(self.mid * other, self.rad * np.abs(other)) if _is_plain(other) else NotImplemented

    __radd__, __rmul__ = __add__, __mul__

    def _square(self) -> Enclosure:
        """Return the square. Its enclosure contains no negative number beyond the allowance for rounding errors."""
        size = np.abs(self.mid)
        low, high = np.maximum(size - self.rad, 0.0) ** 2, (size + self.rad) ** 2  # each with at most 3 roundings
        return Enclosure(0.5 * (high + low), (0.5 * (high - low) + 4 * UNIT * high) * SWELL + TINY)

    def __truediv__(self, other: Any) -> Enclosure:
        if isinstance(other, Enclosure):
            return self * other.reciprocal()
        return _enclosed(self.mid / other, self.rad / np.abs(other)) if _is_plain(other) else NotImplemented

    def __rtruediv__(self, other: Any) -> Enclosure:
        return self.reciprocal() * other if _is_plain(other) else NotImplemented

    def reciprocal(self) -> Enclosure:
        """Return 1/x, or nan if the enclosure contains 0."""
        size = np.abs(self.mid)
        gap = np.where(size > self.rad, size - self.rad, np.nan)
        mid = self.mid / gap / (size + self.rad)  # 4 roundings, each of half a UNIT; 8 UNIT cover 16
        rad = self.rad / gap / (size + self.rad)
        return Enclosure(mid, (rad + 8 * UNIT * np.abs(mid)) * SWELL + TINY)

    def sqrt(self) -> Enclosure:
        """Return the square root of a number that is not negative, although its enclosure may contain negative
        numbers."""
        low = np.sqrt(np.maximum(self.mid - self.rad, 0.0))
        high = np.sqrt(self.mid + self.rad)
        return Enclosure(0.5 * (low + high), (0.5 * (high - low) + 4 * UNIT * high) * SWELL + TINY)

    def positive(self) -> Flags:
        """Return for each element whether all of its enclosed numbers are > 0."""
        return np.asarray(self.mid > self.rad)

    def negative(self) -> Flags:
        """Return for each element whether all of its enclosed numbers are < 0."""
        return np.asarray(self.mid < -np.asarray(self.rad))

    def __getitem__(self, at: Any) -> Enclosure:
        return Enclosure(self.mid[at], self.rad[at])

    def subset(self, at: Any) -> Enclosure:
        """Return the elements that an index selects, also if all elements have one radius."""
        return Enclosure(np.asarray(self.mid)[at], np.broadcast_to(self.rad, np.shape(self.mid))[at])


def _is_plain(x: Any) -> bool:
    return isinstance(x, int | float | np.ndarray)


def between(low: Any, high: Any) -> Enclosure:
    """Return an enclosure of the intervals [low, high], elementwise."""
    mid = 0.5 * (low + high)
    return Enclosure(mid, np.maximum(high - mid, mid - low) * SWELL)


def decimal(x: Any) -> Enclosure:
    """Return an enclosure of the decimals that floats print as: 0.4 means 2/5."""
    return Enclosure(x, UNIT * np.abs(x))


def decimal_or_inf(x: float) -> Number:
    """Return an enclosure of the decimal that a float prints as; inf stays a float."""
    return x if x == inf else decimal(x)


def surely_negative(x: Number) -> bool:
    """Return whether a single number is certainly negative."""
    return bool(negative(x))


def negative(x: Number) -> Flags:
    """Return where a number is certainly negative."""
    return np.asarray(x.negative() if isinstance(x, Enclosure) else x < 0)


def stacked(numbers: Sequence[Any]) -> Enclosure:
    """Return one enclosure whose new first axis runs over the given numbers."""
    found = [x if isinstance(x, Enclosure) else Enclosure(float(x)) for x in numbers]
    parts = np.broadcast_arrays(*(part for x in found for part in (x.mid, x.rad)))
    return Enclosure(np.stack(parts[::2]), np.stack(parts[1::2]))


def matmul(a: Enclosure, b: Enclosure) -> Enclosure:
    """Return enclosures of the matrix products A B, one for each index of the further axes."""
    size_a, size_b = np.abs(a.mid), np.abs(b.mid)
    rad = _products(size_a, b.rad + len(b.mid) * UNIT * size_b) + _products(a.rad, size_b + b.rad)
    # a sum of at most 60 products takes some 65 roundings; SWELL covers 15 roundings, its eighth power 127
    return Enclosure(_products(a.mid, b.mid), rad * SWELL**8 + TINY)


def _products(a: Any, b: Any) -> Any:
    return FLOATS.matmul(a, b)


def selected(where: Flags, yes: Enclosure, no: Enclosure) -> Enclosure:
    """Return `yes` where a condition holds and `no` elsewhere, elementwise."""
    return Enclosure(np.where(where, yes.mid, no.mid), np.where(where, yes.rad, no.rad))


EXPONENT_ERROR = 1e-12  # Bound on the relative error of exp of a rounded sum, if exp does not overflow
LEAST_MODULUS = 1e-150  # Upper bound of sqrt(a^2 + b^2) where the squares underflow
SMALL = 0.5  # Argument below which the code encloses the derivative of sinc by its series

Table = tuple[tuple[float, float], ...]


def _falling(f: Callable[[Any], Any], x: Enclosure) -> Enclosure:
    """Return an enclosure of a positive function that falls for x >= 0, from its values at both ends of x."""
    low, high = np.maximum(x.mid - x.rad, 0.0), x.mid + x.rad
    return between(f(np.asarray(high)) * (1 - PHI_ERROR), f(np.asarray(low)) * (1 + PHI_ERROR))


class _EnclosureArithmetic:
    """Arithmetic of enclosures."""

    pi = Enclosure(np.pi, UNIT * np.pi)
    precision = UNIT
    stacked = staticmethod(stacked)

    @staticmethod
    def shape(x: Number) -> tuple[int, ...]:
        return np.shape(x.mid) if isinstance(x, Enclosure) else np.shape(x)

    matmul = staticmethod(matmul)

    @property
    def arrays(self) -> ArrayArithmetic:
        return self

    @staticmethod
    def is_zero(x: Number) -> bool:
        return bool(np.all(x.mid == 0) and np.all(x.rad == 0)) if isinstance(x, Enclosure) else bool(x == 0)

    @staticmethod
    def sqrt(x: Number) -> Number:
        return x.sqrt()

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        return (re * re + im * im).sqrt()

    @staticmethod
    def reciprocal(re: Number, im: Number) -> tuple[Number, Number]:
        """Return 1/x of complex numbers x. The relative width of the result is about that of x."""
        a, b = by_conjugate(*(np.asarray(part.mid, float) for part in (re, im)))
        one, other = Enclosure(a), Enclosure(b)
        off = ENCLOSURES.modulus(re * one - im * other - 1, re * other + im * one)
        most = (off.mid + off.rad) * (1 + 4 * UNIT)
        rad = raised((np.sqrt(a * a + b * b) + LEAST_MODULUS) * most / np.where(most < 1, 1 - most, np.nan), 1)
        return Enclosure(a, rad), Enclosure(b, rad)

    @staticmethod
    def exp(x: Number) -> Number:
        mid, away = exponential(x.mid), np.asarray(x.rad)
        rad = (mid + TINY) * (away + away * away + EXP_ERROR) * (1 + 2 * EXP_ERROR) + TINY  # e^r - 1 <= r + r^2, r <= 1
        greatest = exponential(x.mid + away) * (1 + EXPONENT_ERROR) + TINY
        return Enclosure(mid, np.where(away < 1, rad, greatest))

    @staticmethod
    def sin(x: Number) -> Number:
        sine, cosine = elementary.sine_and_cosine(x.mid)
        return Enclosure(sine, np.abs(cosine) * x.rad + 0.5 * np.square(x.rad) + 2 * SINE_ERROR)

    @staticmethod
    def cos(x: Number) -> Number:
        sine, cosine = elementary.sine_and_cosine(x.mid)
        return Enclosure(cosine, np.abs(sine) * x.rad + 0.5 * np.square(x.rad) + 2 * SINE_ERROR)

    @staticmethod
    def sinc(x: Number) -> Number:
        size, least = np.abs(x.mid), np.maximum(np.abs(x.mid) - x.rad, 1.0)
        value = elementary.sinc(x.mid)
        slope = np.minimum((size + x.rad) / 3, 0.5)
        tangent = np.where(
            size > SMALL, np.abs(elementary.cosine(x.mid) - value) / np.maximum(size, SMALL) + 8 * SINE_ERROR, slope
        )
        curved = tangent + np.minimum(1 / 3, (1 + (2 + 2 / least) / least) / least) * x.rad / 2
        return Enclosure(value, np.minimum(slope, curved) * x.rad * (1 + 16 * UNIT) + 3 * SINE_ERROR)

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        """Return (1 - sinc x)/x^2. This function falls for x >= 0, because x sinc' + 2 (1 - sinc x) > 0."""
        return _falling(elementary.sinc_curvature, x)

    @staticmethod
    def phi_1(x: Number) -> Number:
        return _falling(elementary.phi_1, x)

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        sure = x.positive()
        return yes() if sure.all() else selected(sure, yes(), no())

    @staticmethod
    def interpolated(x: Number, table: Table) -> Number:
        """Return a table's values over x, interpolated linearly in the logarithms of both."""
        low, high = np.maximum(x.mid - x.rad, TINY), x.mid + x.rad
        ends = [elementary.interpolated(edge, table) for edge in (low, high)]
        least, greatest = np.minimum(*ends), np.maximum(*ends)
        for at, value in table:
            inside = (low <= at) & (at <= high)
            least = np.where(inside, np.minimum(least, value), least)
            greatest = np.where(inside, np.maximum(greatest, value), greatest)
        return between(least * (1 - EXPONENT_ERROR), greatest * (1 + EXPONENT_ERROR))

    @staticmethod
    def within(radius: Number) -> Number:
        return Enclosure(0.0, radius)

    @staticmethod
    def middle(x: Number) -> Number:
        return Enclosure(x.mid) if isinstance(x, Enclosure) else x

    @staticmethod
    def magnitude(x: Number) -> float:
        if not isinstance(x, Enclosure):
            return abs(float(x))
        return float(np.max(np.abs(x.mid) + x.rad)) * (1 + UNIT)


ENCLOSURES: ArrayArithmetic = _EnclosureArithmetic()
