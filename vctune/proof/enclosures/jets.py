"""Enclosures with derivatives, and the elementary functions of both: the arithmetic of proofs on arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.arithmetic import FLOATS, ArrayArithmetic, Number, by_conjugate
from vctune.proof.enclosures.array_intervals import TINY, UNIT, Enclosure, between, matmul, raised, selected, stacked

# Bound on the error of NumPy's sin, cos, exp and expm1 in double precision: 8 units in the last place
LIBRARY_ERROR = 8 * UNIT
PHI_ERROR = 1e-13  # Bound on the relative error of `FLOATS.phi_1`, `phi_2` and `sinc_curvature` for 0 <= x <= 1e100
EXPONENT_ERROR = 1e-12  # Bound on the relative error of exp of a rounded sum, if exp does not overflow
SMALL = 0.5  # Argument below which the code encloses the derivative of sinc by its series

Slopes = tuple[Enclosure | None, ...]
Table = tuple[tuple[float, float], ...]


class Jet:
    """A number that depends on several variables: an enclosure of its values and of each of its derivatives."""

    __slots__ = ("slopes", "value")
    __array_ufunc__ = None

    def __init__(self, value: Enclosure, slopes: Slopes) -> None:
        self.value = value
        self.slopes = slopes

    def __add__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, _sums(self.slopes, other.slopes))
        return Jet(self.value + other, self.slopes)

    def __neg__(self) -> Jet:
        return Jet(-self.value, tuple(None if slope is None else -slope for slope in self.slopes))

    def __sub__(self, other: Any) -> Jet:
        return self + -other

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __mul__(self, other: Any) -> Jet:
        if other is self:
            return self.mapped(self.value * self.value, 2 * self.value)
        if isinstance(other, Jet):
            slopes = _sums(_scaled(self.slopes, other.value), _scaled(other.slopes, self.value))
            return Jet(self.value * other.value, slopes)
        return self.mapped(self.value * other, other)

    __radd__, __rmul__ = __add__, __mul__

    def __getitem__(self, at: Any) -> Jet:
        return Jet(self.value[at], tuple(None if slope is None else slope[at] for slope in self.slopes))

    def __truediv__(self, other: Any) -> Jet:
        return self * _reciprocal(other) if isinstance(other, Jet) else self * (1 / other)

    def __rtruediv__(self, other: Any) -> Jet:
        return _reciprocal(self) * other

    def mapped(self, value: Enclosure, derivative: Any) -> Jet:
        """Return f(x) of this number x by the chain rule."""
        return Jet(value, _scaled(self.slopes, derivative))


def variables(values: Sequence[Enclosure], varied: Sequence[bool]) -> list[Enclosure | Jet]:
    """Return the variables of a box as jets. Each jet has the slope 1 in its own variable and 0 in the others."""
    order = {index: place for place, index in enumerate(i for i, varies in enumerate(varied) if varies)}
    one = Enclosure(1.0)

    def jet(index: int, value: Enclosure) -> Jet:
        return Jet(value, tuple(one if place == order[index] else None for place in range(len(order))))

    return [jet(i, value) if varied[i] else value for i, value in enumerate(values)]


def _scaled(slopes: Slopes, factor: Any) -> Slopes:
    return tuple(None if slope is None else slope * factor for slope in slopes)


def _sums(left: Slopes, right: Slopes) -> Slopes:
    return tuple(a if b is None else b if a is None else a + b for a, b in zip_longest(left, right))


def _reciprocal(x: Jet) -> Jet:
    inverse = x.value.reciprocal()
    return x.mapped(inverse, -(inverse * inverse))


def _sin(x: Enclosure) -> Enclosure:
    return Enclosure(np.sin(x.mid), np.abs(np.cos(x.mid)) * x.rad + 0.5 * np.square(x.rad) + 2 * LIBRARY_ERROR)


def _cos(x: Enclosure) -> Enclosure:
    return Enclosure(np.cos(x.mid), np.abs(np.sin(x.mid)) * x.rad + 0.5 * np.square(x.rad) + 2 * LIBRARY_ERROR)


def _sinc(x: Enclosure) -> Enclosure:
    """Return sin(x)/x."""
    size, least = np.abs(x.mid), np.maximum(np.abs(x.mid) - x.rad, 1.0)
    value = FLOATS.sinc(x.mid)
    slope = np.minimum((size + x.rad) / 3, 0.5)
    tangent = np.where(size > SMALL, np.abs(np.cos(x.mid) - value) / np.maximum(size, SMALL) + 8 * LIBRARY_ERROR, slope)
    curved = tangent + np.minimum(1 / 3, (1 + (2 + 2 / least) / least) / least) * x.rad / 2
    return Enclosure(value, np.minimum(slope, curved) * x.rad * (1 + 16 * UNIT) + 3 * LIBRARY_ERROR)


def _sinc_slope(x: Enclosure) -> Enclosure:
    """Return (cos x - sinc x)/x; for small x it is -x/3 (1 - t x^2/10) with t between 0 and 1."""
    direct = (_cos(x) - _sinc(x)) / x
    small = np.asarray(np.abs(x.mid) + x.rad < SMALL)
    series = (x / -3) * (1 - (x * x) * Enclosure(0.05, 0.05 + UNIT))
    return selected(small, series, direct)


def _curvature(x: Enclosure) -> Enclosure:
    """Return (1 - sinc x)/x^2. This function falls for x >= 0, because x sinc' + 2 (1 - sinc x) > 0."""
    return _falling(FLOATS.sinc_curvature, x)


def _curvature_slope(x: Enclosure) -> Enclosure:
    """Return the derivative of (1 - sinc x)/x^2; for small x it is -x/60 (1 - t x^2/21) with t between 0 and 1."""
    direct = (_sinc_slope(x) + 2 * (x * _curvature(x))) / -(x * x)
    small = np.asarray(np.abs(x.mid) + x.rad < SMALL)
    series = (x / -60) * (1 - (x * x) * between(np.float64(0.0), np.float64(1 / 21) * (1 + UNIT)))
    return selected(small, series, direct)


class _EnclosureArithmetic:
    """Arithmetic of enclosures, and of jets for derivatives."""

    pi = Enclosure(np.pi, UNIT * np.pi)
    precision = UNIT

    @property
    def arrays(self) -> ArrayArithmetic:
        return self

    @staticmethod
    def stacked(numbers: Sequence[Number]) -> Number:
        values = [x.value if isinstance(x, Jet) else x for x in numbers]
        count = max((len(x.slopes) for x in numbers if isinstance(x, Jet)), default=0)
        value = stacked(values)
        if not count:
            return value
        zero = Enclosure(np.zeros(value.mid.shape[1:]))

        def slope(place: int) -> Enclosure | None:
            each = [x.slopes[place] if isinstance(x, Jet) and place < len(x.slopes) else None for x in numbers]
            if all(x is None for x in each):
                return None
            return stacked([zero, *(zero if x is None else x for x in each)])[1:]

        return Jet(value, tuple(map(slope, range(count))))

    @staticmethod
    def matmul(a: Number, b: Number) -> Number:
        values = [x.value if isinstance(x, Jet) else x for x in (a, b)]
        left = tuple(None if s is None else matmul(s, values[1]) for s in a.slopes) if isinstance(a, Jet) else ()
        right = tuple(None if s is None else matmul(values[0], s) for s in b.slopes) if isinstance(b, Jet) else ()
        value = matmul(*values)
        return Jet(value, _sums(left, right)) if left or right else value

    @staticmethod
    def is_zero(x: Number) -> bool:
        if isinstance(x, Jet):
            return False
        return bool(np.all(x.mid == 0) and np.all(x.rad == 0)) if isinstance(x, Enclosure) else bool(x == 0)

    @staticmethod
    def sqrt(x: Number) -> Number:
        if isinstance(x, Enclosure):
            return x.sqrt()
        root = x.value.sqrt()
        return x.mapped(root, 0.5 / root)

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        parts = [x.value if isinstance(x, Jet) else x for x in (re, im)]
        size = (parts[0] * parts[0] + parts[1] * parts[1]).sqrt()
        slopes: Slopes = ()
        for x, part in zip((re, im), parts, strict=True):
            if isinstance(x, Jet):
                slopes = _sums(slopes, _scaled(x.slopes, _cosine(part / size)))
        return Jet(size, slopes) if slopes else size

    @staticmethod
    def reciprocal(re: Number, im: Number) -> tuple[Number, Number]:
        parts = [x.value if isinstance(x, Jet) else x for x in (re, im)]
        a, b = reciprocal_over(*parts)
        if not isinstance(re, Jet) and not isinstance(im, Jet):
            return a, b
        along, across = b * b - a * a, -2 * (a * b)  # -1/x^2
        real: Slopes = ()
        imaginary: Slopes = ()
        if isinstance(re, Jet):
            real, imaginary = _scaled(re.slopes, along), _scaled(re.slopes, across)
        if isinstance(im, Jet):
            real, imaginary = _sums(real, _scaled(im.slopes, -across)), _sums(imaginary, _scaled(im.slopes, along))
        return Jet(a, real), Jet(b, imaginary)

    @staticmethod
    def exp(x: Number) -> Number:
        if isinstance(x, Jet):
            value = ENCLOSURES.exp(x.value)
            return x.mapped(value, value)
        mid = np.exp(x.mid)
        rad = (mid + TINY) * (np.expm1(x.rad) + LIBRARY_ERROR) * (1 + LIBRARY_ERROR) + TINY
        greatest = np.exp(x.mid + x.rad) * (1 + EXPONENT_ERROR) + TINY  # for a large radius expm1 would overflow
        return Enclosure(mid, np.where(np.asarray(x.rad) < 1, rad, greatest))

    @staticmethod
    def sin(x: Number) -> Number:
        return x.mapped(_sin(x.value), _cos(x.value)) if isinstance(x, Jet) else _sin(x)

    @staticmethod
    def cos(x: Number) -> Number:
        return x.mapped(_cos(x.value), -_sin(x.value)) if isinstance(x, Jet) else _cos(x)

    @staticmethod
    def sinc(x: Number) -> Number:
        return x.mapped(_sinc(x.value), _sinc_slope(x.value)) if isinstance(x, Jet) else _sinc(x)

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        return x.mapped(_curvature(x.value), _curvature_slope(x.value)) if isinstance(x, Jet) else _curvature(x)

    @staticmethod
    def phi_1(x: Number) -> Number:
        """Return phi_1. Its derivative is phi_2 - phi_1, which is minus the mean of t e^-xt over 0 <= t <= 1."""
        if not isinstance(x, Jet):
            return _falling(FLOATS.phi_1, x)
        mean = _falling(FLOATS.phi_1, x.value)
        return x.mapped(mean, _falling(FLOATS.phi_2, x.value) - mean)

    @staticmethod
    def phi_2(x: Number) -> Number:
        """Return phi_2."""
        if not isinstance(x, Jet):
            return _falling(FLOATS.phi_2, x)
        least = np.exp(-(x.value.mid + x.value.rad)) * (1 - PHI_ERROR)
        return x.mapped(_falling(FLOATS.phi_2, x.value), between(least, 1.0) / -6)

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        sure = (x.value if isinstance(x, Jet) else x).positive()
        return yes() if sure.all() else _chosen(sure, yes(), no())

    @staticmethod
    def interpolated(x: Number, table: Table) -> Number:
        if not isinstance(x, Jet):
            return interpolated_over(x, table)
        value, slope = interpolated_over(x.value, table), _exponents(x.value, table) / x.value
        return x.mapped(value, selected(_beyond(x.value, table), Enclosure(0.0), value * slope))

    @staticmethod
    def within(radius: Number) -> Number:
        return Enclosure(0.0, radius)

    @staticmethod
    def middle(x: Number) -> Number:
        value = x.value if isinstance(x, Jet) else x
        return Enclosure(value.mid) if isinstance(value, Enclosure) else value

    @staticmethod
    def magnitude(x: Number) -> float:
        value = x.value if isinstance(x, Jet) else x
        if not isinstance(value, Enclosure):
            return abs(float(value))
        return float(np.max(np.abs(value.mid) + value.rad)) * (1 + UNIT)


ENCLOSURES: ArrayArithmetic = _EnclosureArithmetic()


def reciprocal_over(re: Enclosure, im: Enclosure) -> tuple[Enclosure, Enclosure]:
    """Return 1/x of complex numbers x. The relative width of the result is about that of x."""
    a, b = by_conjugate(*(np.asarray(part.mid, float) for part in (re, im)))
    one, other = Enclosure(a), Enclosure(b)
    off = ENCLOSURES.modulus(re * one - im * other - 1, re * other + im * one)
    most = (off.mid + off.rad) * (1 + 4 * UNIT)
    rad = raised(np.hypot(a, b) * most / np.where(most < 1, 1 - most, np.nan), 1)
    return Enclosure(a, rad), Enclosure(b, rad)


def interpolated_over(x: Enclosure, table: Table) -> Enclosure:
    """Return an enclosure of a table's values over x, interpolated linearly in the logarithms of both."""
    low, high = np.maximum(x.mid - x.rad, TINY), x.mid + x.rad
    ends = [FLOATS.interpolated(edge, table) for edge in (low, high)]
    least, greatest = np.minimum(*ends), np.maximum(*ends)
    for at, value in table:
        inside = (low <= at) & (at <= high)
        least = np.where(inside, np.minimum(least, value), least)
        greatest = np.where(inside, np.maximum(greatest, value), greatest)
    return between(least * (1 - EXPONENT_ERROR), greatest * (1 + EXPONENT_ERROR))


def _exponents(x: Enclosure, table: Table) -> Enclosure:
    """Return the slopes of a table on logarithmic axes over x. They bound the slope of the interpolated table, because
    the table is continuous."""
    low, high = x.mid - x.rad, x.mid + x.rad
    edges = [0.0, *(at for at, _ in table), np.inf]
    slopes = [0.0, *(np.log(d / b) / np.log(c / a) for (a, b), (c, d) in pairwise(table)), 0.0]
    least, greatest = np.full(np.shape(low), np.inf), np.full(np.shape(low), -np.inf)
    for slope, start, stop in zip(slopes, edges[:-1], edges[1:], strict=True):
        touched = (low * (1 - PHI_ERROR) <= stop) & (start <= high * (1 + PHI_ERROR))
        least, greatest = (
            np.where(touched, np.minimum(least, slope), least),
            np.where(touched, np.maximum(greatest, slope), greatest),
        )
    return between(least - EXPONENT_ERROR, greatest + EXPONENT_ERROR)


def _beyond(x: Enclosure, table: Table) -> NDArray[np.bool_]:
    """Return where x certainly lies outside the range of a table; x = 0 does."""
    first, last = table[0][0] * (1 - PHI_ERROR), table[-1][0] * (1 + PHI_ERROR)
    return np.asarray((x.mid + x.rad < first) | (x.mid - x.rad > last))


def _cosine(x: Enclosure) -> Enclosure:
    """Return an enclosure of a cosine, clipped to [-1, 1]. Where the enclosure is nan, the result is [-1, 1]."""
    return between(np.fmax(x.mid - x.rad, -1.0), np.fmin(x.mid + x.rad, 1.0))


def _falling(f: Callable[[Any], Any], x: Enclosure) -> Enclosure:
    """Return an enclosure of a positive function that falls for x >= 0, from its values at both ends of x."""
    low, high = np.maximum(x.mid - x.rad, 0.0), x.mid + x.rad
    return between(f(np.asarray(high)) * (1 - PHI_ERROR), f(np.asarray(low)) * (1 + PHI_ERROR))


def _chosen(where: NDArray[np.bool_], yes: Number, no: Number) -> Number:
    if not isinstance(yes, Jet):
        return selected(where, yes, no)
    zero = Enclosure(0.0)
    slopes = tuple(
        None if a is None and b is None else selected(where, zero if a is None else a, zero if b is None else b)
        for a, b in zip_longest(yes.slopes, no.slopes)
    )
    return Jet(selected(where, yes.value, no.value), slopes)
