"""Complex numbers of any arithmetic, and the functions of angles on a ray: of the curve of a damping ratio
(model/README.md, section 21)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vctune.model.numbers.arithmetic import Arithmetic, Number, by_conjugate
from vctune.model.numbers.pair import Pair


class Complex:
    """The complex number re + j im. A real number may be plain."""

    __slots__ = ("im", "re")
    __array_ufunc__ = None  # a NumPy array times a complex number calls __rmul__ once

    def __init__(self, re: Number, im: Number) -> None:
        self.re, self.im = re, im

    def __add__(self, other: Any) -> Complex:
        if isinstance(other, Complex):
            return Complex(self.re + other.re, self.im + other.im)
        return Complex(self.re + other, self.im)

    def __neg__(self) -> Complex:
        return Complex(-self.re, -self.im)

    def __sub__(self, other: Any) -> Complex:
        return self + -other

    def __rsub__(self, other: Any) -> Complex:
        return -self + other

    def __mul__(self, other: Any) -> Complex:
        if isinstance(other, Complex):
            return Complex(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)
        return Complex(self.re * other, self.im * other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> Complex:
        return self * Complex(*by_conjugate(other.re, other.im)) if isinstance(other, Complex) else self * (1 / other)

    def __rtruediv__(self, other: Any) -> Complex:
        return Complex(*by_conjugate(self.re, self.im)) * other

    def conjugate(self) -> Complex:
        """Return re - j im."""
        return Complex(self.re, -self.im)

    def turned(self) -> Complex:
        """Return this number times j."""
        return Complex(-self.im, self.re)


def as_one(pair: Pair) -> Complex:
    """Return re + j im of two complex numbers: a formula for the unit circle, continued to other angles."""
    re, im = (part if isinstance(part, Complex) else Complex(part, 0 * part) for part in (pair.re, pair.im))
    return re + im.turned()


@dataclass(frozen=True, slots=True)
class Ray:
    """The arithmetic of the complex angles a (1 + j slope) with a >= 0, which are `Complex`; of the numbers that do not
    depend on an angle it is that of their own."""

    ops: Arithmetic
    slope: Number

    @property
    def pi(self) -> Number:
        """pi."""
        return self.ops.pi

    @property
    def precision(self) -> float:
        """Relative rounding error of a number."""
        return self.ops.precision

    @property
    def arrays(self) -> None:
        """None: a complex number is none of the arrays that can be stacked."""

    def angle(self, along: Number) -> Complex:
        """Return the angle with a real part."""
        return Complex(along, along * self.slope)

    def _grown(self, angle: Complex) -> tuple[Number, Number]:
        """Return cosh and sinh(x)/x of the imaginary part x of an angle."""
        up = angle.re * self.slope
        grown = self.ops.exp(up)
        return 0.5 * (grown + 1 / grown), grown * self.ops.phi_1(2 * up)

    def sin(self, x: Complex) -> Complex:
        """Return the sine of an angle."""
        cosh, shc = self._grown(x)
        return Complex(self.ops.sin(x.re) * cosh, self.ops.cos(x.re) * (x.re * self.slope * shc))

    def cos(self, x: Complex) -> Complex:
        """Return the cosine of an angle."""
        cosh, shc = self._grown(x)
        return Complex(self.ops.cos(x.re) * cosh, -(self.ops.sin(x.re) * (x.re * self.slope * shc)))

    def sinc(self, x: Complex) -> Complex:
        """Return sin(x)/x of an angle, continued by 1 at 0."""
        cosh, shc = self._grown(x)
        over = Complex(self.ops.sinc(x.re) * cosh, self.slope * (self.ops.cos(x.re) * shc))
        return over / Complex(1 + 0 * self.slope, self.slope)

    def reciprocal(self, re: Number, im: Number) -> tuple[Number, Number]:
        """Return 1/(re + j im) of a formula for the unit circle, whose parts may be complex here."""
        return by_conjugate(re, im)

    def is_zero(self, x: Number) -> bool:
        """Return whether a number is certainly 0."""
        return not isinstance(x, Complex) and self.ops.is_zero(x)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.ops, name)  # functions of numbers that do not depend on the angle
