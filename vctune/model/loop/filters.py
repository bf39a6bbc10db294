"""Evaluate the non-ideal parts of a device at a frequency, and write low-passes as rates of states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

from vctune.model.device import Device
from vctune.model.mechanism import Combination, Rates
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import times
from vctune.model.sections import Section, SectionRows, sections_of_rows


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


def velocity_sections(device: Device, ops: Arithmetic) -> tuple[Section, ...]:
    """Return the firmware's filter of the velocity, without the difference of the position."""
    known = device.velocity
    if known is None:
        return ()
    a = known.filter_coefficient
    if known.filter_hz is not None:
        x = 2 * ops.pi * known.filter_hz * device.sample_time
        a = x * ops.phi_1(x)  # 1 - e^-x
    low_passes = () if a is None else (Section(a),) * known.filter_order
    return (*low_passes, *_in_arithmetic(known.sections, device))


def force_sections(device: Device) -> tuple[Section, ...]:
    """Return the firmware's filter of the sensed force."""
    sensor = device.sensing
    low_pass = () if sensor.filter_coefficient is None else (Section(sensor.filter_coefficient),)
    return (*low_pass, *_in_arithmetic(sensor.sections, device))


def _in_arithmetic(rows: SectionRows | None, device: Device) -> tuple[Section, ...]:
    """Return sections whose coefficients are numbers of the device's arithmetic, so that it encloses their sums."""
    zero = 0 * device.sample_time
    found = () if rows is None else sections_of_rows(rows)
    return tuple(section.mapped(lambda number: zero + number) for section in found)


def section_response(section: Section, sample_time: Number, omega: Number, ops: Arithmetic) -> FilterResponse:
    """Return the response of a section at z = e^(j omega T)."""
    theta, T = omega * sample_time, sample_time
    half_sinc = ops.sinc(theta / 2)
    chord = half_sinc * half_sinc
    square = chord * (theta * theta) / 4
    reciprocal = 1 / section.below2(square)
    return FilterResponse(
        section.along(square) * reciprocal,
        section.missed(square) * (T * T) * chord * reciprocal,
        section.across(square) * T * ops.sinc(theta) * reciprocal,
    )


def in_series(responses: Sequence[FilterResponse], omega: Number) -> FilterResponse | None:
    """Return the response of filters in series; None without one."""
    return reduce(lambda one, two: one.times(two, omega * omega), responses) if responses else None


def velocity_filter(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return the response of the firmware's filter of the velocity, at z = e^(j omega T)."""
    T = device.sample_time
    return in_series([section_response(each, T, omega, ops) for each in velocity_sections(device, ops)], omega)


def velocity_estimate(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return F, the response of the firmware's velocity estimate to the velocity of the motor, at z = e^(j omega T)."""
    T, passed = device.sample_time, velocity_filter(device, omega, ops)
    parts = [] if passed is None else [passed]
    if device.velocity is not None and device.differences:
        theta = omega * T
        half_sinc = ops.sinc(theta / 2)
        # sinc_curvature(x) = (1 - sinc x)/x^2
        curved, late = T * T * ops.sinc_curvature(theta), T / 2 * (half_sinc * half_sinc)
        parts.insert(0, FilterResponse(ops.sinc(theta), curved, late))
    return in_series(parts, omega)


def sensor_response(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return F_s, the response of the sensed force to the hand's force, at s = j omega, with the filter of its
    samples."""
    sensor, parts = device.sensing, []
    if sensor.bandwidth_hz is not None:
        parts.append(low_pass(sensor.bandwidth_hz, sensor.order, omega, ops))
    if not ops.is_zero(sensor.delay):
        parts.append(pure_delay(sensor.delay, omega, ops))
    parts += [section_response(each, device.sample_time, omega, ops) for each in force_sections(device)]
    return in_series(parts, omega)


def low_pass_rates(
    rows: Rates, states: tuple[str, str], cycles_per_sample: Number, order: int, ops: Arithmetic
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
    rows: Rates, states: tuple[str, str], cycles_per_sample: Number, order: int, ops: Arithmetic
) -> Number:
    """Write the low-pass of `low_pass` into the rates of a system, in the states y and, for order 2, y'/w."""
    if order == 1:
        return low_pass_rates(rows, states, cycles_per_sample, order, ops)
    corner, (out, rate) = 2 * ops.pi * cycles_per_sample, states
    rows[out][rate] = corner
    rows[rate][out], rows[rate][rate] = -corner, -ops.sqrt(2 * (corner * corner))
    return corner


COMMAND = "command"  # Name of the held command's column in the rates of a system
# Type of a function that writes a low-pass into the rates, such as `low_pass_rates`
LowPassRows = Callable[[Rates, tuple[str, str], Number, int, Arithmetic], Number]


def drive_states(device: Device) -> tuple[str, ...]:
    """Return the names of the drive's states; the tuple is empty if the motor's force is the command."""
    return () if device.actuator is None else ("force", "rate")[: device.actuator.order]


def drive_response(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return A, the response of the force on the motor to the held command, at s = j omega."""
    actuator = device.actuator
    return None if actuator is None else low_pass(actuator.bandwidth_hz, actuator.order, omega, ops)


def drive_rows(
    rows: Rates, device: Device, ops: Arithmetic, low_pass_rows: LowPassRows = low_pass_rates
) -> Combination:
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


def pushed(force: Combination, share: Number) -> Combination:
    """Return a force times a share."""
    return {name: share if type(part) is int and part == 1 else times(part, share) for name, part in force.items()}
