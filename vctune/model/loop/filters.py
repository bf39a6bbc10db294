"""Evaluate the non-ideal parts of a device at a frequency, and write low-passes as rates of states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import times
from vctune.model.parts import ForceSensor, VelocityEstimate


@dataclass(frozen=True, slots=True)
class FilterResponse:
    """The response H = re - j omega lag of a filter with unit gain at omega = 0, at one or more frequencies."""

    re: Number  # real part of H, 1 at omega = 0
    loss: Number  # (1 - re)/omega^2, s^2, computed without a subtraction from 1
    lag: Number  # -Im(H)/omega, s

    def times(self, other: FilterResponse, omega2: Number) -> FilterResponse:
        """Return the response of this filter and another one in series."""
        one, two = self, other
        crossed = one.loss * two.loss * omega2
        return FilterResponse(
            one.re * two.re - omega2 * (one.lag * two.lag),
            one.loss + two.loss + one.lag * two.lag - crossed,  # 1 - re of the product, from 1 - re of both
            one.lag * two.re + one.re * two.lag,
        )


def low_pass(bandwidth_hz: Number, order: int, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return the response of a continuous low-pass at s = j omega."""
    time = 1 / (2 * ops.pi * bandwidth_hz)  # 1/w
    x, time2 = omega * time, time * time
    x2 = x * x
    if order == 1:
        size2 = 1 / (1 + x2)  # |H|^2
        return FilterResponse(size2, time2 * size2, time * size2)
    size2 = 1 / (1 + x2 * x2)
    return FilterResponse((1 - x2) * size2, time2 * (1 + x2) * size2, ops.sqrt(2 * time2) * size2)


def pure_delay(delay: Number, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return the response e^(-s delay) of a delay at s = j omega."""
    angle = omega * delay
    half_sinc = ops.sinc(angle / 2)
    return FilterResponse(ops.cos(angle), delay * delay / 2 * (half_sinc * half_sinc), delay * ops.sinc(angle))


def interpolation(sample_time: Number, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return (1 + e^(-s T))/2 at s = j omega, the filter between a held velocity and an interpolated position."""
    half = sample_time / 2
    cos, sinc = ops.cos(omega * half), ops.sinc(omega * half)
    return FilterResponse(cos * cos, half * half * (sinc * sinc), half * (cos * sinc))


def low_pass_coefficients(filter_hz: Number, sample_time: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return the coefficients of the firmware's low-pass of the velocity, y += a (x - y) at each sample."""
    x = 2 * ops.pi * filter_hz * sample_time  # 1 - e^-x = x phi_1(x)
    return x * ops.phi_1(x), ops.exp(-x)


def velocity_estimate(
    estimate: VelocityEstimate, sample_time: Number, omega: Number, ops: Arithmetic
) -> FilterResponse | None:
    """Return F, the response of the firmware's velocity estimate to the velocity of the motor, at z = e^(j omega T)."""
    theta, T, response = omega * sample_time, sample_time, None
    half_sinc = ops.sinc(theta / 2)
    if estimate.source == "difference":
        # sinc_curvature(x) = (1 - sinc x)/x^2
        response = FilterResponse(ops.sinc(theta), T * T * ops.sinc_curvature(theta), T / 2 * (half_sinc * half_sinc))
    stage = firmware_low_pass(estimate, T, omega, ops)
    if stage is not None:
        for _ in range(estimate.filter_order):
            response = stage if response is None else response.times(stage, omega * omega)
    return response


def firmware_low_pass(
    estimate: VelocityEstimate, sample_time: Number, omega: Number, ops: Arithmetic
) -> FilterResponse | None:
    """Return the response of one of the firmware's low-passes of the velocity, a/(1 - p/z), at z = e^(j omega T)."""
    if estimate.filter_hz is None:
        return None
    return one_pole(*low_pass_coefficients(estimate.filter_hz, sample_time, ops), sample_time, omega, ops)


def one_pole(a: Number, p: Number, sample_time: Number, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return the response a/(1 - p/z), p = 1 - a, of the firmware's filter y += a (x - y), at z = e^(j omega T)."""
    theta, T = omega * sample_time, sample_time
    half_sinc = ops.sinc(theta / 2)
    chord2 = half_sinc * half_sinc * (theta * theta)  # |1 - e^(-j theta)|^2
    reciprocal = 1 / (a * a + p * chord2)  # 1/|1 - p/z|^2
    return FilterResponse(
        a * (a + p * chord2 / 2) * reciprocal,
        p * (1 + p) / 2 * (T * T) * (half_sinc * half_sinc) * reciprocal,
        a * p * T * ops.sinc(theta) * reciprocal,
    )


def sensor_response(sensor: ForceSensor, sample_time: Number, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return F_s, the response of the sensed force to the hand's force, at s = j omega, with the filter of its
    samples."""
    response = None
    if sensor.bandwidth_hz is not None:
        response = low_pass(sensor.bandwidth_hz, sensor.order, omega, ops)
    if not ops.is_zero(sensor.delay):
        delay = pure_delay(sensor.delay, omega, ops)
        response = delay if response is None else response.times(delay, omega * omega)
    if sensor.filter_coefficient is not None:
        passed = one_pole(sensor.filter_coefficient, 1 - sensor.filter_coefficient, sample_time, omega, ops)
        response = passed if response is None else response.times(passed, omega * omega)
    return response


def low_pass_rates(
    rows: dict[str, dict[str, Number]], states: tuple[str, str], cycles_per_sample: Number, order: int, ops: Arithmetic
) -> Number:
    """Write the low-pass of `low_pass` into the rates of a system, in states that suit models which invert f(X)."""
    corner, (out, rate) = 2 * ops.pi * cycles_per_sample, states  # w T
    if order == 1:
        rows[out][out] = -corner
        return corner
    # 0 * corner + 0.5 is 1/2 as a number of the arithmetic; the square root of corner^2/2 would be wide for an
    # uncertain corner
    a = corner * ops.sqrt(0 * corner + 0.5)
    rows[out][out], rows[out][rate] = -a, a
    rows[rate][out], rows[rate][rate] = -a, -a
    return 2 * a


def plain_low_pass_rates(
    rows: dict[str, dict[str, Number]], states: tuple[str, str], cycles_per_sample: Number, order: int, ops: Arithmetic
) -> Number:
    """Write the low-pass of `low_pass` into the rates of a system, in the states y and, for order 2, y'/w."""
    if order == 1:
        return low_pass_rates(rows, states, cycles_per_sample, order, ops)
    corner, (out, rate) = 2 * ops.pi * cycles_per_sample, states
    rows[out][rate] = corner
    rows[rate][out], rows[rate][rate] = -corner, -ops.sqrt(2 * (corner * corner))
    return corner


COMMAND = "command"  # Name of the held command's column in the rates of a system
Rows = dict[str, dict[str, Number]]  # Rates of the states, by the names of the states or inputs that drive them
# Type of a function that writes a low-pass into the rates, such as `low_pass_rates`
LowPassRows = Callable[[Rows, tuple[str, str], Number, int, Arithmetic], Number]


def drive_states(device: Device) -> tuple[str, ...]:
    """Return the names of the drive's states; the tuple is empty if the motor's force is the command."""
    return () if device.actuator is None else ("force", "rate")[: device.actuator.order]


def drive_response(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return A, the response of the force on the motor to the held command, at s = j omega."""
    actuator = device.actuator
    return None if actuator is None else low_pass(actuator.bandwidth_hz, actuator.order, omega, ops)


def drive_rows(
    rows: Rows, device: Device, ops: Arithmetic, low_pass_rows: LowPassRows = low_pass_rates
) -> dict[str, Number]:
    """Write the rates of the drive's states, and return the motor's force as a linear combination of states and
    command."""
    actuator = device.actuator
    if actuator is None:
        return {COMMAND: 1}
    corner = low_pass_rows(rows, ("force", "rate"), actuator.bandwidth_hz * device.sample_time, actuator.order, ops)
    rows[drive_states(device)[-1]][COMMAND] = corner
    return {"force": 1}


def drive_at_rest(device: Device) -> dict[str, float]:
    """Return the drive's states under a steady command of 1, by name. States that are 0 are absent."""
    return {} if device.actuator is None else {"force": 1.0}


def pushed(force: dict[str, Number], share: Number) -> dict[str, Number]:
    """Return a force times a share."""
    return {name: share if type(part) is int and part == 1 else times(part, share) for name, part in force.items()}
