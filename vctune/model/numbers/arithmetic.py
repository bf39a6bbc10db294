"""Define the operations beyond + - * / that the formulas need, for each kind of number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import pi
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Number = Any  # A float, a fraction, a NumPy array, a CasADi symbol, an `Enclosure` or a `Taylor`
Floats = NDArray[np.float64]  # An array of floats of any shape


class Arithmetic(Protocol):
    """Elementary functions of one kind of number."""

    @property
    def pi(self) -> Number: ...
    @property
    def precision(self) -> float:
        """Relative rounding error of a number."""

    @property
    def arrays(self) -> ArrayArithmetic | None:
        """This arithmetic if its numbers are arrays; None if they are single numbers."""

    def is_zero(self, x: Number) -> bool:
        """Return whether a number is certainly 0, so that a product with it can be omitted."""

    def sqrt(self, x: Number) -> Number: ...
    def modulus(self, re: Number, im: Number) -> Number:
        """Return |re + j im|. The derivatives of both parts bound the derivative of the result, even at 0."""

    def reciprocal(self, re: Number, im: Number) -> tuple[Number, Number]:
        """Return 1/(re + j im). The result and the number have about the same relative width."""

    def exp(self, x: Number) -> Number: ...
    def sin(self, x: Number) -> Number: ...
    def cos(self, x: Number) -> Number: ...
    def sinc(self, x: Number) -> Number:
        """Return sin(x)/x, continued by 1 at x = 0."""

    def sinc_curvature(self, x: Number) -> Number:
        """Return (1 - sin(x)/x)/x^2, continued by 1/6 at x = 0."""

    def phi_1(self, x: Number) -> Number:
        """Return (1 - e^-x)/x, the mean of e^-t over [0, x], continued by 1 at x = 0."""

    def where_positive(self, x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        """Return the value of yes() where x is certainly > 0, and the value of no() elsewhere."""

    def interpolated(self, x: Number, table: tuple[tuple[float, float], ...]) -> Number:
        """Return the value of a table at x, by linear interpolation on logarithmic axes."""

    def within(self, radius: Number) -> Number:
        """Return an enclosure of the numbers between -radius and radius. An arithmetic without enclosures returns 0."""

    def middle(self, x: Number) -> Number:
        """Return a number without width that lies within x."""

    def magnitude(self, x: Number) -> float:
        """Return an upper bound of |x| over all elements of x. For plain numbers it may have a rounding error."""


class ArrayArithmetic(Arithmetic, Protocol):
    """Elementary functions of arrays, and operations that only arrays have."""

    def stacked(self, numbers: Sequence[Number]) -> Number:
        """Return numbers stacked along a new first axis; some of them may be plain."""

    def shape(self, x: Number) -> tuple[int, ...]:
        """Return the shape of x; that of a plain number is empty."""

    def matmul(self, a: Number, b: Number) -> Number:
        """Return the matrix products A B, one for each index of the further axes."""


CURVATURE_BELOW = 0.5  # Magnitude of the argument at which sinc_curvature changes from its series to its formula


def sinc_curvature_series(x2: Number) -> Number:
    """Return 1/3! - x^2/5! + x^4/7! - ... + x^12/15!. The remainder lies between -x^14/17! and 0."""
    total: Number = 1
    for n in (14, 12, 10, 8, 6, 4):
        total = 1 - x2 * total / (n * (n + 1))
    return total / 6


def by_conjugate(re: Number, im: Number) -> tuple[Number, Number]:
    """Return 1/(re + j im) by the complex conjugate. For numbers without width, no other form is tighter."""
    square = re * re + im * im
    return re / square, -im / square


class _FloatArithmetic:
    """Double precision, elementwise on NumPy arrays."""

    pi = pi
    precision = 2.0**-53

    @property
    def arrays(self) -> ArrayArithmetic:
        return self

    @staticmethod
    def stacked(numbers: Sequence[Number]) -> Number:
        shape = np.broadcast_shapes(*(np.shape(x) for x in numbers))
        found = np.empty((len(numbers), *shape), np.result_type(*numbers))
        for place, x in enumerate(numbers):
            found[place] = x
        return found

    shape = staticmethod(np.shape)

    @staticmethod
    def matmul(a: Number, b: Number) -> Number:
        return np.einsum("ij...,jk...->ik...", a, b)

    @staticmethod
    def is_zero(x: Number) -> bool:
        return bool(np.all(x == 0))

    sqrt = staticmethod(np.sqrt)
    exp = staticmethod(np.exp)
    reciprocal = staticmethod(by_conjugate)

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        return np.sqrt(re * re + im * im)

    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)

    @staticmethod
    def sinc(x: Number) -> Number:
        return np.sin(x) / x if np.all(x) else np.where(x == 0, 1.0, np.sin(x) / np.where(x == 0, 1.0, x))

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        small = np.abs(x) < CURVATURE_BELOW
        safe = np.where(small, 1.0, x)
        return np.where(small, sinc_curvature_series(x * x), (1 - np.sin(safe) / safe) / safe**2)

    @staticmethod
    def phi_1(x: Number) -> Number:
        safe = np.where(x == 0, 1.0, x)
        return np.where(x == 0, 1.0, -np.expm1(-safe) / safe)

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(x > 0, yes(), no())

    @staticmethod
    def interpolated(x: Number, table: tuple[tuple[float, float], ...]) -> Number:
        at, value = np.log(np.array(table)).T
        with np.errstate(divide="ignore"):  # below the first point, and also at 0, the first point's value holds
            return np.exp(np.interp(np.log(x), at, value))

    @staticmethod
    def within(radius: Number) -> Number:
        return 0.0

    @staticmethod
    def middle(x: Number) -> Number:
        return x

    @staticmethod
    def magnitude(x: Number) -> float:
        return float(np.max(np.abs(x)))


FLOATS: ArrayArithmetic = _FloatArithmetic()
