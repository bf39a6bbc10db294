"""The elementary functions of `Taylor` numbers over many boxes, also of enclosures that depend on no row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial

import numpy as np

from vctune.model.numbers.arithmetic import ArrayArithmetic, Number, by_conjugate
from vctune.proof.enclosures import elementary
from vctune.proof.enclosures.elementary import EXP_ERROR, PHI_ERROR, SINE_ERROR, UNIT, exponential, sine_and_cosine
from vctune.proof.enclosures.intervals import ENCLOSURES, LEAST_MODULUS, TINY, Enclosure, Floats, Table
from vctune.proof.enclosures.taylor import SWOLLEN, Taylor, stacked

# Nodes and weights of Gauss and Legendre for means over 0 <= t <= 1
_NODES, _WEIGHTS = (0.5 * (1 + np.polynomial.legendre.leggauss(40)[0]), 0.5 * np.polynomial.legendre.leggauss(40)[1])
FAR, TURNS = 40.0, 12.0  # arguments up to which these means have their digits: of e^(-t x), and of cos(t x)
SINC_TERMS = 12  # Number of terms in the series of sinc' and sinc'' for arguments below 1
# Relative amount by which an interval may extend past a point of a table while the code still uses the power law of one
# side
ASTRIDE = 1e-12
# Bound on the relative error of a table's power and of its value, for each unit of the power and of the logarithm of
# the ratio of two points
POWER_ERROR = 8e-12


def _sinc(x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return sin(x)/x, its derivative, and half of its second derivative."""
    small = np.abs(x) < 1
    far, near = np.where(small, 1.0, x), np.where(small, x, 0.0)
    sine, cosine = sine_and_cosine(far)
    first = (cosine - sine / far) / far
    second = -0.5 * sine / far - first / far
    terms = [(2 * n, (-1) ** n / factorial(2 * n + 1)) for n in range(1, SINC_TERMS)]
    slope = sum(n * c * near ** (n - 1) for n, c in terms)
    curve = sum(n * (n - 1) / 2 * c * near ** (n - 2) for n, c in terms)
    return elementary.sinc(x), np.where(small, slope, first), np.where(small, curve, second)


def _falling(
    x: Floats, function: Callable[[Floats], Floats], weight: Callable[[Floats], Floats]
) -> tuple[Floats, Floats, Floats]:
    """Return a function that is the mean of weight(t) e^(-t x), its derivative, and half of its second derivative."""
    reach = np.minimum(1.0, FAR / np.maximum(x, FAR))  # beyond FAR/x what is left is below e^-FAR
    t = reach * _NODES[:, None]
    each = _WEIGHTS[:, None] * reach * weight(t) * exponential(-t * x)
    return function(x), -(t * each).sum(axis=0), 0.5 * (t * t * each).sum(axis=0)


def _sinc_curvature(x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return (1 - sinc x)/x^2, its derivative, and half of its second derivative."""
    near, far = np.clip(x, -TURNS, TURNS), np.where(np.abs(x) < TURNS, TURNS, x)
    each = _WEIGHTS[:, None] * 0.5 * (1 - _NODES[:, None]) ** 2
    turned = _NODES[:, None] * near
    sine, cosine = sine_and_cosine(turned)
    first = -(each * _NODES[:, None] * sine).sum(axis=0)
    second = -(each * _NODES[:, None] ** 2 * cosine).sum(axis=0)
    (_, slope, curve), value = _sinc(far), elementary.sinc_curvature(x)
    beyond = -(slope + 2 * far * value) / far**2
    curved = -(2 * curve + 2 * value + 4 * far * beyond) / far**2
    inside = np.abs(x) < TURNS
    return value, np.where(inside, first, beyond), 0.5 * np.where(inside, second, curved)


def _times_e_of(x: Taylor, bound: float) -> Floats:
    """Return a bound for x >= 0 times e^-x where x may be less; nan where the middle of x is below -1e-9."""
    over = x.enclosed()
    least = np.minimum(over.mid - over.rad, 0.0)
    return np.where(over.mid >= -1e-9, bound * exponential(-least) * (1 + 1e-6), np.nan)


def _ranged(x: Number) -> Number:
    return x.enclosed() if isinstance(x, Taylor) else x


def _narrower(x: Taylor, over: Enclosure, of: Taylor) -> Taylor:
    """Return a number where its remainder is narrower than the given range of its values; elsewhere return an enclosure
    of that range."""
    known = x.radii.sum(axis=0) <= over.rad
    shares = of.magnitudes.linear_by_row + of.magnitudes.quadratic_by_row + of.radii[:-1]
    total = shares.sum(axis=0)
    coefficients, radii = np.where(known, x.coefficients, 0.0), np.where(known, x.radii, 0.0)
    coefficients[0] = np.where(known, coefficients[0], over.mid)
    due = total > TINY
    radii[:-1] += np.where(known | ~due, 0.0, shares * (over.rad / np.maximum(total, TINY)))
    radii[-1] += np.where(known | due, 0.0, over.rad)
    return Taylor(x.row_count, coefficients, radii * SWOLLEN)


def _reciprocal(re: Number, im: Number) -> tuple[Taylor, Taylor]:
    """Return 1/x of a complex number x = (1 + e)/c, which is c (1 - e + e^2 - e^3/(1 + e))."""
    a, b = by_conjugate(*(x.coefficients[0] if isinstance(x, Taylor) else np.asarray(x.mid, float) for x in (re, im)))
    off_re, off_im = re * a - im * b - 1, re * b + im * a
    aside, up = (np.abs(off.enclosed().mid) + off.enclosed().rad for off in (off_re, off_im))
    most = (np.sqrt(aside * aside + up * up) + LEAST_MODULUS) * (1 + 8 * UNIT)
    left_out = most**3 / np.where(most < 1, 1 - most, np.nan) * (1 + 8 * UNIT)
    one, other = off_re * off_re - off_im * off_im - off_re + 1, 2 * (off_re * off_im) - off_im
    shares = sum(off.magnitudes.linear_by_row + off.magnitudes.quadratic_by_row for off in (off_re, off_im))
    total = shares.sum(axis=0)
    for part in (one, other):
        part.radii[:-1] += np.where(total > TINY, shares * (left_out / np.maximum(total, TINY)), 0.0) * SWOLLEN
        part.radii[-1] += np.where(total > TINY, 0.0, left_out)
    return one * a - other * b, one * b + other * a


def _power(x: Taylor, table: Table) -> Taylor:
    """Return a table's values over x by the power law between two points; unbounded where x spans several intervals."""
    mid, over = x.coefficients[0], x.enclosed()
    edges, values = map(np.array, zip(*table, strict=True))
    apart = np.diff(elementary.logarithm(edges))
    powers = np.array([0.0, *(np.diff(elementary.logarithm(values)) / apart), 0.0])
    place = np.searchsorted(edges, mid)
    low, high = (np.append(np.insert(edges, 0, 0.0), np.inf)[place + k] for k in (0, 1))
    least, most = over.mid - over.rad, over.mid + over.rad
    alone = (least > 0) & (least >= low * (1 - ASTRIDE)) & (most <= high * (1 + ASTRIDE))
    p, value = powers[place], elementary.interpolated(mid, table)
    third = np.abs(p * (p - 1) * (p - 2)) * np.maximum((least / mid) ** (p - 3), (most / mid) ** (p - 3))
    third = np.where(alone, third * value / mid**3 * (1 + POWER_ERROR), np.nan)
    error = POWER_ERROR * value * (1 + np.abs(powers).max()) / apart.min(initial=1.0)
    first, second = p * value / mid, 0.5 * p * (p - 1) * value / mid**2
    relative = error / value * np.maximum(np.abs(first), np.abs(second))
    return x.mapped((value, first, second), third, error, relative)


def _like(x: Number, one: Taylor) -> Taylor:
    """Return a matrix, which may be the same for all boxes, as a `Taylor` over the boxes of another matrix."""
    if isinstance(x, Taylor):
        return x
    shape = (*x.mid.shape[:2], one.coefficients.shape[-1])
    coefficients, radii = (np.zeros((len(part), *shape)) for part in (one.coefficients, one.radii))
    coefficients[0], radii[-1] = (part.reshape(*shape[:2], -1) for part in (x.mid, x.rad))
    return Taylor(one.row_count, coefficients, radii)


class _TaylorArithmetic:
    """Arithmetic of `Taylor` numbers. Operations that a loop rarely needs ignore how the number depends on the rows."""

    pi = ENCLOSURES.pi
    precision = UNIT
    within = staticmethod(ENCLOSURES.within)

    @property
    def arrays(self) -> ArrayArithmetic:
        return self

    @staticmethod
    def stacked(numbers: Sequence[Number]) -> Number:
        return stacked(numbers) if any(isinstance(x, Taylor) for x in numbers) else ENCLOSURES.stacked(numbers)

    @staticmethod
    def shape(x: Number) -> tuple[int, ...]:
        return x.coefficients.shape[1:] if isinstance(x, Taylor) else ENCLOSURES.shape(x)

    @staticmethod
    def matmul(a: Number, b: Number) -> Number:
        one = next((x for x in (a, b) if isinstance(x, Taylor)), None)
        return ENCLOSURES.matmul(a, b) if one is None else _like(a, one).matmul(_like(b, one))

    @staticmethod
    def is_zero(x: Number) -> bool:
        return not isinstance(x, Taylor) and ENCLOSURES.is_zero(x)

    @staticmethod
    def sqrt(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.sqrt(x)
        mid, least = x.coefficients[0], x.coefficients[0] - x.enclosed().rad
        root = np.sqrt(mid)
        third = 0.375 / np.where(least > 0, least, np.nan) ** 2.5
        found = x.mapped((root, 0.5 / root, -0.125 / (mid * root)), third, UNIT * root)
        return _narrower(found, ENCLOSURES.sqrt(x.enclosed()), x)

    @staticmethod
    def exp(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.exp(x)
        value, most = exponential(x.coefficients[0]), ENCLOSURES.exp(x.enclosed())
        return x.mapped((value, value, 0.5 * value), most.mid + most.rad, *(2 * EXP_ERROR * value,) * 2)

    @staticmethod
    def sin(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.sin(x)
        sin, cos = sine_and_cosine(x.coefficients[0])
        return x.mapped((sin, cos, -0.5 * sin), 1.0, *(2 * SINE_ERROR,) * 2)

    @staticmethod
    def cos(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.cos(x)
        sin, cos = sine_and_cosine(x.coefficients[0])
        return x.mapped((cos, -sin, -0.5 * cos), 1.0, *(2 * SINE_ERROR,) * 2)

    @staticmethod
    def sinc(x: Number) -> Number:
        """Return sinc x. It is the mean of cos(t x) over 0 <= t <= 1, so |sinc'''| is at most 1/4."""
        if not isinstance(x, Taylor):
            return ENCLOSURES.sinc(x)
        return x.mapped(_sinc(x.coefficients[0]), 0.25, *(8 * SINE_ERROR,) * 2)

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        over = ENCLOSURES.modulus(_ranged(re), _ranged(im))
        square = re * re + im * im
        return _narrower(TAYLOR.sqrt(square), over, square) if isinstance(square, Taylor) else over

    @staticmethod
    def reciprocal(re: Number, im: Number) -> tuple[Number, Number]:
        if not isinstance(re, Taylor) and not isinstance(im, Taylor):
            return ENCLOSURES.reciprocal(re, im)
        return _reciprocal(re, im)

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        """Return (1 - sinc x)/x^2, the mean of (1 - t)^2 cos(t x)/2 over 0 <= t <= 1; its third derivative is at most
        1/120."""
        if not isinstance(x, Taylor):
            return ENCLOSURES.sinc_curvature(x)
        return x.mapped(_sinc_curvature(x.coefficients[0]), 1 / 120, *(PHI_ERROR,) * 2)

    @staticmethod
    def phi_1(x: Number) -> Number:
        """Return the mean of e^(-t x) over 0 <= t <= 1. For x >= 0 its third derivative is at most 1/4."""
        if not isinstance(x, Taylor):
            return ENCLOSURES.phi_1(x)
        return x.mapped(
            _falling(x.coefficients[0], elementary.phi_1, lambda t: 1 + 0 * t), _times_e_of(x, 1 / 4), PHI_ERROR
        )

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        sure = _ranged(x).positive()
        if sure.all():
            return yes()
        one, other = yes(), no()
        form = next((number for number in (one, other) if isinstance(number, Taylor)), None)
        if form is None:
            return ENCLOSURES.where_positive(_ranged(x), lambda: one, lambda: other)
        one, other = (stacked([number, form])[0] for number in (one, other))
        parts = ((one.coefficients, other.coefficients), (one.radii, other.radii))
        return Taylor(form.row_count, *(np.where(sure, *pair) for pair in parts))

    @staticmethod
    def interpolated(x: Number, table: Table) -> Number:
        over = ENCLOSURES.interpolated(_ranged(x), table)
        return _narrower(_power(x, table), over, x) if isinstance(x, Taylor) else over

    @staticmethod
    def middle(x: Number) -> Number:
        return Enclosure(x.coefficients[0]) if isinstance(x, Taylor) else ENCLOSURES.middle(x)

    @staticmethod
    def magnitude(x: Number) -> float:
        return ENCLOSURES.magnitude(_ranged(x))


TAYLOR: ArrayArithmetic = _TaylorArithmetic()
