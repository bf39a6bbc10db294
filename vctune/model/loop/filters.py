"""Evaluate the non-ideal parts of a device at a frequency, and write low-passes as rates of states.

The parts are the velocity estimate, the actuator and the force sensor (model/README.md, section 12). The sampled models
use the rates.

Each part has unit gain at omega = 0. The code computes 1 - H directly instead of subtracting H from 1, so that no
digits cancel.
"""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.parts import ForceSensor, VelocityEstimate


@dataclass(frozen=True, slots=True)
class FilterResponse:
    """A transfer function re - j omega lag with unit gain at omega = 0.

    `re` and `lag` are even functions of omega, and smooth at omega = 0.

    Attributes
    ----------
    re : real part, 1 at omega = 0; that of a low-pass vanishes far above the corner
    curvature : (1 - Re)/omega^2, s^2
    lag : -Im/omega, s
    """

    re: Number
    curvature: Number
    lag: Number

    def times(self, other: FilterResponse, omega2: Number) -> FilterResponse:
        """Return the product of two filters at a frequency.

        Parameters
        ----------
        other : the second filter, at the same frequency
        omega2 : omega^2 there, (rad/s)^2

        Returns
        -------
        FilterResponse
            The product. The function computes its curvature from the factors' curvatures, not from 1 - Re, so that no
            digits cancel.
        """
        one, two = self, other
        crossed = one.curvature * two.curvature * omega2
        return FilterResponse(
            one.re * two.re - omega2 * (one.lag * two.lag),
            one.curvature + two.curvature + one.lag * two.lag - crossed,
            one.lag * two.re + one.re * two.lag,
        )


def low_pass(bandwidth_hz: Number, order: int, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return a low-pass at s = j omega: 1/(1 + s/w) of order 1, or w^2/(s^2 + sqrt(2) w s + w^2) of order 2
    (Butterworth).

    Parameters
    ----------
    bandwidth_hz : the -3 dB frequency w/(2 pi), Hz, > 0
    order : order of the low-pass, 1 or 2
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of bandwidth and omega

    Returns
    -------
    FilterResponse
        The result has the shape of omega.
    """
    time = 1 / (2 * ops.pi * bandwidth_hz)
    x, time2 = omega * time, time * time
    x2 = x * x
    if order == 1:
        reciprocal = 1 / (1 + x2)
        return FilterResponse(reciprocal, time2 * reciprocal, time * reciprocal)
    reciprocal = 1 / (1 + x2 * x2)
    return FilterResponse((1 - x2) * reciprocal, time2 * (1 + x2) * reciprocal, ops.sqrt(2 * time2) * reciprocal)


def pure_delay(delay: Number, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return e^(-s delay) at s = j omega.

    Parameters
    ----------
    delay : duration of the delay, s, >= 0
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of delay and omega

    Returns
    -------
    FilterResponse
        The result has the shape of omega.
    """
    turn = omega * delay
    half = ops.sinc(turn / 2)
    return FilterResponse(ops.cos(turn), delay * delay / 2 * (half * half), delay * ops.sinc(turn))


def interpolation(sample_time: Number, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return (1 + e^(-s T))/2 at s = j omega, the filter between a held velocity and an interpolated position.

    A servo that interpolates a position command over a sample acts like a servo with this filter after a held velocity
    command (model/README.md, section 17).

    Parameters
    ----------
    sample_time : T, s
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of T and omega

    Returns
    -------
    FilterResponse
        The result has the shape of omega.
    """
    half = sample_time / 2
    cos, sinc = ops.cos(omega * half), ops.sinc(omega * half)
    return FilterResponse(cos * cos, half * half * (sinc * sinc), half * (cos * sinc))


def low_pass_coefficients(filter_hz: Number, sample_time: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return the coefficients a and p of the firmware's low-pass y += a (x - y), that is, y = p y + a x.

    Here a = 1 - e^(-2 pi f T).

    Parameters
    ----------
    filter_hz : corner frequency f, Hz
    sample_time : T, s
    ops : arithmetic of both

    Returns
    -------
    a, p : a and p = 1 - a, dimensionless; each has its own formula, so that no digits cancel
    """
    x = 2 * ops.pi * filter_hz * sample_time
    return x * ops.phi_1(x), ops.exp(-x)


def velocity_estimate(
    estimate: VelocityEstimate, sample_time: Number, omega: Number, ops: Arithmetic
) -> FilterResponse | None:
    """Return F, the response of the firmware's velocity to the true velocity, at z = e^(j omega T).

    See model/README.md, section 12.

    A backward difference of the position gives the mean velocity of the last sample interval, (1 - e^(-sT))/(sT). The
    firmware's low-passes then filter this velocity.

    Parameters
    ----------
    estimate : source of the velocity, "difference" or "measured", and the low-passes
    sample_time : T, s
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of the other arguments

    Returns
    -------
    FilterResponse or None
        It has the shape of omega; None for a measured velocity without a low-pass.
    """
    theta, T, found = omega * sample_time, sample_time, None
    half = ops.sinc(theta / 2)
    if estimate.source == "difference":
        found = FilterResponse(ops.sinc(theta), T * T * ops.sinc_curvature(theta), T / 2 * (half * half))
    one = firmware_low_pass(estimate, T, omega, ops)
    if one is not None:
        for _ in range(estimate.filter_order):
            found = one if found is None else found.times(one, omega * omega)
    return found


def firmware_low_pass(
    estimate: VelocityEstimate, sample_time: Number, omega: Number, ops: Arithmetic
) -> FilterResponse | None:
    """Return one of the firmware's low-passes of the velocity, a/(1 - (1 - a)/z), at z = e^(j omega T).

    Parameters
    ----------
    estimate : velocity estimate; the function uses its corner frequency, and ignores its order because it returns one
        stage
    sample_time : T, s
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of the other arguments

    Returns
    -------
    FilterResponse or None
        It has the shape of omega; None if the firmware has no low-pass.
    """
    if estimate.filter_hz is None:
        return None
    theta, T = omega * sample_time, sample_time
    half = ops.sinc(theta / 2)
    a, p = low_pass_coefficients(estimate.filter_hz, T, ops)
    chord2 = half * half * (theta * theta)  # |1 - e^(-j theta)|^2
    reciprocal = 1 / (a * a + p * chord2)
    return FilterResponse(
        a * (a + p * chord2 / 2) * reciprocal,
        p * (1 + p) / 2 * (T * T) * (half * half) * reciprocal,
        a * p * T * ops.sinc(theta) * reciprocal,
    )


def sensor_response(sensor: ForceSensor, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return F_s, the response of the sensed force to the hand's force, at s = j omega.

    Parameters
    ----------
    sensor : force sensor with bandwidth, Hz, and order of its low-pass, and delay, s
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of the sensor's numbers and omega

    Returns
    -------
    FilterResponse or None
        It has the shape of omega; None if the sensor is ideal.
    """
    found = None
    if sensor.bandwidth_hz is not None:
        found = low_pass(sensor.bandwidth_hz, sensor.order, omega, ops)
    if not ops.is_zero(sensor.delay):
        delay = pure_delay(sensor.delay, omega, ops)
        found = delay if found is None else found.times(delay, omega * omega)
    return found


def low_pass_rates(
    rows: dict[str, dict[str, Number]], states: tuple[str, str], samples: Number, order: int, ops: Arithmetic
) -> Number:
    """Write a low-pass of order 1, or of order 2 with damping ratio 1/sqrt(2), into the rates of a system.

    The states of order 2 are y and y + y'/a with 2 a^2 = w^2, not y and y'. The function serves models that invert f(X)
    with X = A E^-1 (model/README.md, section 14). For a fast low-pass f(X) is about half of |X|, and `matrices.inverse`
    divides by its diagonal. With the states y and y' the diagonal would be close to 0.

    Parameters
    ----------
    rows : rates of each state by the names of the states, with T = 1; the function adds the rates of the low-pass
    states : names of the output y and of the second state, which exists for order 2 only
    samples : bandwidth times T, that is, the -3 dB frequency in units of the sampling frequency
    order : order of the low-pass, 1 or 2
    ops : arithmetic of the rates

    Returns
    -------
    Number
        Rate at which the input drives the low-pass's last state, per sample.
    """
    corner, (out, rate) = 2 * ops.pi * samples, states
    if order == 1:
        rows[out][out] = -corner
        return corner
    a = corner * ops.sqrt(0 * corner + 0.5)  # the square root of the square would be wide for an uncertain corner
    rows[out][out], rows[out][rate] = -a, a
    rows[rate][out], rows[rate][rate] = -a, -a
    return 2 * a


def plain_low_pass_rates(
    rows: dict[str, dict[str, Number]], states: tuple[str, str], samples: Number, order: int, ops: Arithmetic
) -> Number:
    """Write a low-pass into the rates of a system, with the states y and y'/w, for models that do not invert f(X).

    Parameters
    ----------
    rows, states, samples, order, ops : see `low_pass_rates`

    Returns
    -------
    Number
        Rate at which the input drives the low-pass's last state, per sample.
    """
    if order == 1:
        return low_pass_rates(rows, states, samples, order, ops)
    corner, (out, rate) = 2 * ops.pi * samples, states
    rows[out][rate] = corner
    rows[rate][out], rows[rate][rate] = -corner, -ops.sqrt(2 * (corner * corner))
    return corner
