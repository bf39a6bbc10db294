"""Single numbers as Arb balls of 128 bits. Every ball contains the true value; if it excludes 0, the sign is proved.
The tests hold formulas against them."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

from flint import arb

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Arithmetic, Number, by_conjugate, sinc_curvature_series
from vctune.proof.enclosures.elementary import UNIT
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure

PRECISION = 128  # Working precision, bits
SMALL = 0.1  # Argument below which the code computes (1 - sinc x)/x^2 by its series with an enclosed remainder


class _BallArithmetic:
    """Arithmetic of balls."""

    precision = 2.0**-PRECISION
    arrays = None
    reciprocal = staticmethod(by_conjugate)

    @property
    def pi(self) -> Number:
        return arb.pi()

    @staticmethod
    def is_zero(x: Number) -> bool:
        return bool(x == 0)

    @staticmethod
    def sqrt(x: Number) -> Number:
        return x.sqrt()

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        return (re * re + im * im).sqrt()

    @staticmethod
    def exp(x: Number) -> Number:
        return x.exp()

    @staticmethod
    def sin(x: Number) -> Number:
        return x.sin()

    @staticmethod
    def cos(x: Number) -> Number:
        return x.cos()

    @staticmethod
    def sinc(x: Number) -> Number:
        return x.sinc()

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        size = abs(x).upper()
        if not size < SMALL:
            return (1 - x.sin() / x) / (x * x)
        return sinc_curvature_series(x * x) + arb(0, 2 * size**14 / factorial(17))

    @staticmethod
    def phi_1(x: Number) -> Number:
        return -(-x).expm1() / x if x != 0 else arb(1)

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        return yes() if x > 0 else no()

    @staticmethod
    def interpolated(x: Number, table: tuple[tuple[float, float], ...]) -> Number:
        over = ENCLOSURES.interpolated(Enclosure(float(x.mid()), float(x.rad()) + UNIT * abs(float(x.mid()))), table)
        return arb(float(over.mid), float(over.rad))

    @staticmethod
    def within(radius: Number) -> Number:
        return arb(0, radius)

    @staticmethod
    def middle(x: Number) -> Number:
        return x

    @staticmethod
    def magnitude(x: Number) -> float:
        return float(abs(arb(x)).upper()) * (1 + 1e-15)


BALLS: Arithmetic = _BallArithmetic()


def ball(decimal: float) -> arb:
    """Return a ball around the decimal that a float prints as: 0.4 means 2/5."""
    return arb(repr(float(decimal)))


def device_ball(device: Device) -> Device:
    """Return the device with its decimals enclosed."""
    return device.converted(ball)
