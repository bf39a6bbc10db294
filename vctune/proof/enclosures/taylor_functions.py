"""The elementary functions of `Taylor`s over many boxes, and of enclosures that do not depend on a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial

import numpy as np

from vctune.model.numbers.arithmetic import FLOATS, ArrayArithmetic, Number
from vctune.proof.enclosures.array_intervals import UNIT, Floats
from vctune.proof.enclosures.jets import ENCLOSURES, LIBRARY_ERROR, Table
from vctune.proof.enclosures.taylor import Taylor, stacked

SINC_TERMS = 12
"""Terms of the series of sinc' and sinc'' below 1; their remainder is below 1e-20. Half leave 1e-9; twice are no
better."""


def _sinc(x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return sin(x)/x, its derivative and half of the second one."""
    small = np.abs(x) < 1
    far, near = np.where(small, 1.0, x), np.where(small, x, 0.0)
    first = (np.cos(far) - np.sin(far) / far) / far
    second = -0.5 * np.sin(far) / far - first / far
    terms = [(2 * n, (-1) ** n / factorial(2 * n + 1)) for n in range(1, SINC_TERMS)]
    slope = sum(n * c * near ** (n - 1) for n, c in terms)
    curve = sum(n * (n - 1) / 2 * c * near ** (n - 2) for n, c in terms)
    return FLOATS.sinc(x), np.where(small, slope, first), np.where(small, curve, second)


def _ranged(x: Number) -> Number:
    return x.enclosed() if isinstance(x, Taylor) else x


class _TaylorArithmetic:
    """Rare operations of a loop, evaluated on all values of a number without its dependence on others."""

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
    def matmul(a: Number, b: Number) -> Number:
        return a.matmul(b) if isinstance(a, Taylor) else ENCLOSURES.matmul(a, b)

    @staticmethod
    def is_zero(x: Number) -> bool:
        return not isinstance(x, Taylor) and ENCLOSURES.is_zero(x)

    @staticmethod
    def sqrt(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.sqrt(x)
        mid, least = x.poly[0], x.poly[0] - x.enclosed().rad
        root = np.sqrt(mid)
        third = 0.375 / np.where(least > 0, least, np.nan) ** 2.5
        return x.mapped((root, 0.5 / root, -0.125 / (mid * root)), third, UNIT * root)

    @staticmethod
    def exp(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.exp(x)
        value, most = np.exp(x.poly[0]), ENCLOSURES.exp(x.enclosed())
        return x.mapped((value, value, 0.5 * value), most.mid + most.rad, 2 * LIBRARY_ERROR * value)

    @staticmethod
    def sin(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.sin(x)
        sin, cos = np.sin(x.poly[0]), np.cos(x.poly[0])
        return x.mapped((sin, cos, -0.5 * sin), 1.0, 2 * LIBRARY_ERROR)

    @staticmethod
    def cos(x: Number) -> Number:
        if not isinstance(x, Taylor):
            return ENCLOSURES.cos(x)
        sin, cos = np.sin(x.poly[0]), np.cos(x.poly[0])
        return x.mapped((cos, -sin, -0.5 * cos), 1.0, 2 * LIBRARY_ERROR)

    @staticmethod
    def sinc(x: Number) -> Number:
        """sinc is the mean of cos(t x) over 0 <= t <= 1, so that |sinc'''| is at most 1/4."""
        return x.mapped(_sinc(x.poly[0]), 0.25, 8 * LIBRARY_ERROR) if isinstance(x, Taylor) else ENCLOSURES.sinc(x)

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        return ENCLOSURES.modulus(_ranged(re), _ranged(im))

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        return ENCLOSURES.sinc_curvature(_ranged(x))

    @staticmethod
    def phi_1(x: Number) -> Number:
        return ENCLOSURES.phi_1(_ranged(x))

    @staticmethod
    def phi_2(x: Number) -> Number:
        return ENCLOSURES.phi_2(_ranged(x))

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        return ENCLOSURES.where_positive(_ranged(x), lambda: _ranged(yes()), lambda: _ranged(no()))

    @staticmethod
    def interpolated(x: Number, table: Table) -> Number:
        return ENCLOSURES.interpolated(_ranged(x), table)

    @staticmethod
    def magnitude(x: Number) -> float:
        return ENCLOSURES.magnitude(_ranged(x))


TAYLOR: ArrayArithmetic = _TaylorArithmetic()
