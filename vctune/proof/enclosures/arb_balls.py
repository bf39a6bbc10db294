"""Single numbers as Arb balls of 128 bits. Every ball contains the true value; if it excludes 0, the sign is proved.
See proof/README.md, section 2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
from math import factorial, inf

from flint import acb, arb, arb_series

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.numbers.arithmetic import Arithmetic, Number, by_conjugate, sinc_curvature_series
from vctune.model.sampled.velocity_loop import SampledPlant, sampled_plant, split_delay
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.enclosures.intervals import ENCLOSURES, SWELL, TINY, UNIT, Enclosure

PRECISION = 128  # Working precision, bits
SMALL = 0.1  # Argument below which the code computes (1 - sinc x)/x^2 by its series with an enclosed remainder


class _BallArithmetic:
    """Arithmetic of balls, and of power series of balls for derivatives."""

    precision = 2.0**-PRECISION
    arrays = None
    reciprocal = staticmethod(by_conjugate)

    @property
    def pi(self) -> Number:
        return arb.pi()

    @staticmethod
    def is_zero(x: Number) -> bool:
        return len(x) == 0 if isinstance(x, arb_series) else bool(x == 0)

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
        return x.sinc() if isinstance(x, arb) else x.sin() / x

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        size = abs(constant(x)).upper() if not isinstance(x, acb) else x.abs_upper()
        if not size < SMALL:
            return (1 - x.sin() / x) / (x * x)
        # the remainder of the series, its derivative and half its second derivative
        rest = [arb(0, 2 * n * (size ** (14 - k)) / factorial(17)) for k, n in enumerate((1, 14, 91))]
        series = sinc_curvature_series(x * x)
        if not isinstance(x, arb_series):
            return series + rest[0]
        step = x - x[0]
        return series + rest[0] + rest[1] * step + rest[2] * (step * step)

    @staticmethod
    def phi_1(x: Number) -> Number:
        if isinstance(x, arb_series):
            return (1 - (-x).exp()) / x
        return -(-x).expm1() / x if x != 0 else arb(1)

    @staticmethod
    def phi_2(x: Number) -> Number:
        return (x + (-x).expm1()) / (x * x) if x != 0 else arb(1) / 2

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        return yes() if constant(x) > 0 else no()

    @staticmethod
    def interpolated(x: Number, table: tuple[tuple[float, float], ...]) -> Number:
        if not isinstance(x, arb):
            raise TypeError("a table has no power series; over boxes of frequencies, arrays take its slopes")
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


def constant(x: Number) -> arb:
    """Return a ball, or the constant coefficient of a power series."""
    return x[0] if isinstance(x, arb_series) else x


def ball(decimal: float) -> arb:
    """Return a ball around the decimal that a float prints as: 0.4 means 2/5."""
    return arb(repr(float(decimal)))


def ball_or_inf(decimal: float) -> Number:
    """Return a ball around the decimal that a float prints as; inf stays a float."""
    return decimal if decimal == inf else ball(decimal)


def as_series(constant: arb) -> arb_series:
    """Return a ball as a power series with three terms."""
    return arb_series([constant], 3)


def enclosure_of(x: arb | int) -> Number:
    """Return a ball as an enclosure in double precision. An integer stays an integer."""
    if isinstance(x, int):
        return x
    mid = float(x.mid())
    return Enclosure(mid, (float(x.rad()) + UNIT * abs(mid)) * SWELL + TINY)


def box(low: float, high: float) -> arb:
    """Return a ball that contains the interval [low, high]."""
    return arb(low).union(arb(high))


def device_ball(device: Device) -> Device:
    """Return the device with its decimals enclosed."""
    return device.converted(ball)


def exact_plant(device: Device) -> SampledPlant:
    """Return the sampled plant of a device with its decimals enclosed."""
    whole, fraction = split_delay(device.delay, device.sample_time)
    return sampled_plant(device_ball(device), whole, BALLS, fractional=fraction > 0)


def gains_ball(gains: Gains) -> Gains:
    """Return the gains with their decimals enclosed."""
    return Gains(ball(gains.velocity), ball(gains.position))


def coupling_ball(coupling: AnyCoupling) -> AnyCoupling:
    """Return the coupling with its decimals enclosed."""
    return type(coupling)(*map(ball_or_inf, astuple(coupling)))


def design_ball(design: Design) -> Design:
    """Return the design with its decimals enclosed."""
    return Design(device_ball(design.device), gains_ball(design.gains), coupling_ball(design.coupling))


def design_series(exact: Design) -> Design:
    """Return a design in balls as a design in constant power series."""
    gains, coupling = exact.gains, exact.series
    return Design(
        exact.device.converted(as_series),
        Gains(as_series(gains.velocity), as_series(gains.position)),
        Coupling(as_series(coupling.damping), as_series(coupling.mass), as_series(coupling.drag)),
    )
