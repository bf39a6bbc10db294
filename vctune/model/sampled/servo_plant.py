"""Sample a servo and its force sensor exactly (model/README.md, section 17)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

from vctune.model.device import Device
from vctune.model.loop.filters import force_sections, low_pass_rates
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import (
    LEFT_OUT,
    Matrix,
    Vector,
    add,
    added,
    applied,
    change_of_states,
    half_coth,
    identity,
    norm_of,
    product,
    scaled,
)
from vctune.model.parts import Servo
from vctune.model.sampled.circle import split_delay
from vctune.model.sections import Section

# Greatest product of |A| and half the width of an interval of times for which the code expands the exponential around
# the middle of the interval
FAR = 4.0


@dataclass(frozen=True, slots=True)
class ServoPlant:
    """The response of a servo to a held velocity command or an interpolated position command, in the letters of this
    module."""

    below: Matrix  # g, with the sensor's states first
    held: Vector  # h
    lags: Vector  # first rows of -A^-1 and of A g
    driven: Vector
    older: Number  # delta, the share of a sample for which the older command acts
    order: int  # order of the servo, the number of its states
    turns: float  # delay of Z_seen in samples: N + 1/2; N + 1 for a position command
    interpolated: bool  # whether the command is a trapezoidal sum, which adds the factor cos(theta/2) to all responses
    filters: tuple[Section, ...]  # the firmware's filter of the sensed samples
    sample_time: Number  # T, s
    pull: Pull | None = None  # the firmware's own spring; None without one
    radii: tuple[tuple[float, float], ...] = ()  # points (Hz, r) of a disc of responses, `Servo.radii`


@dataclass(frozen=True, slots=True)
class Pull:
    """A spring in the firmware between the measured position and a reference."""

    plant: ServoPlant  # the servo without its force sensor and without this spring
    stiffness: Number  # stiffness of the spring, N/m


@dataclass(frozen=True, slots=True)
class SensedDelay:
    """The whole samples in the sum of the servo's and the sensor's delay, and whether a fraction remains."""

    whole: int  # N, and whether delta > 0
    fractional: bool
    moved: SensedDelay | None = None  # the same numbers for the servo alone; None if they are equal


def sensed_delay(device: Device) -> SensedDelay:
    """Return the delays of a servo with plain numbers, in samples."""
    whole, left = split_delay(device.sensed_latency, device.sample_time)
    moved, rest = split_delay(device.latency, device.sample_time)
    return SensedDelay(whole, left > 0, SensedDelay(moved, rest > 0))


def servo_plant(device: Device, delay: SensedDelay, ops: Arithmetic) -> ServoPlant:
    """Sample a servo and its force sensor exactly (model/README.md, section 17)."""
    T, servo = device.sample_time, device.servo
    assert servo is not None
    rates, lags = servo_rates(device, ops)
    older = (device.sensed_latency - delay.whole * T) / T if delay.fractional else 0
    rounded = half_coth(rates, ops)
    interpolated = device.interpolates
    return ServoPlant(
        below=added(product(rounded, lags), scaled(identity(len(rates)), 0.5)),
        held=_decayed(rates, 1 - older, ops) if delay.fractional else _decayed_over_sample(rates, ops),
        lags=lags[0],
        driven=added(scaled(rates, 0.5), scaled(rounded, -1))[0],
        older=older,
        order=servo.order,
        turns=delay.whole + (1.0 if interpolated else 0.5),
        interpolated=interpolated,
        filters=force_sections(device),
        sample_time=T,
        pull=_pull(device, servo, delay, ops),
        radii=servo.radii,
    )


def _decayed_over_sample(rates: Matrix, ops: Arithmetic) -> Vector:
    """Return e^A (1, 1, ...)."""
    return tuple(1 + x for x in change_of_states(rates, (1,) * len(rates), ops))


def _decayed(rates: Matrix, time: Number, ops: Arithmetic) -> Vector:
    """Return e^(A t) (1, 1, ...) by a series around the middle of t, in which matrices of intervals stay tight."""
    middle = ops.middle(time)
    off = time - middle
    reach = norm_of(rates, ops) * ops.magnitude(off)
    if reach > FAR:
        return _decayed_over_sample(scaled(rates, time), ops)
    term = found = _decayed_over_sample(scaled(rates, middle), ops)
    size, order = max(map(ops.magnitude, found)), 0
    while size > ops.precision * LEFT_OUT:
        order += 1
        size *= reach / order
        term = tuple(x * (off / order) for x in applied(rates, term))
        found = tuple(map(add, found, term))
    # the omitted terms add up to less than e^FAR times the bound of the last term
    return tuple(x + ops.within(exp(FAR) * size) for x in found)


def _pull(device: Device, servo: Servo, delay: SensedDelay, ops: Arithmetic) -> Pull | None:
    if servo.stiffness is None:
        return None
    known = delay.moved is not None or ops.is_zero(device.sensing.delay)
    assert known, "the delay of the servo alone is not told"
    alone = replace(device.sensing_at_once, servo=replace(servo, stiffness=None))
    return Pull(servo_plant(alone, delay.moved or delay, ops), servo.stiffness)


def servo_rates(device: Device, ops: Arithmetic) -> tuple[Matrix, Matrix]:
    """Return A and -A^-1 of the states of sensor and servo, with T = 1."""
    T, servo, sensor = device.sample_time, device.servo, device.sensing
    assert servo is not None
    moved: tuple[str, ...] = ("moved", "moving")[: servo.order]
    felt: tuple[str, ...] = ()
    if sensor.bandwidth_hz is not None:
        felt = ("felt", "felt rate")[: sensor.order]
    rates: dict[str, dict[str, Number]] = {name: {} for name in (*felt, *moved)}
    lags: dict[str, dict[str, Number]] = {name: {} for name in (*felt, *moved)}
    cycles = servo.bandwidth(ops) * T
    low_pass_rates(rates, ("moved", "moving"), cycles, servo.order, ops)
    _write_lags(lags, moved, cycles, ops)
    if felt:
        corner = low_pass_rates(rates, ("felt", "felt rate"), sensor.bandwidth_hz * T, sensor.order, ops)
        rates[felt[-1]]["moved"] = corner
        _write_lags(lags, felt, sensor.bandwidth_hz * T, ops)
        for name in felt:
            lags[name] |= lags["moved"]
    return _rows_of(rates), _rows_of(lags)


def _write_lags(lags: dict[str, dict[str, Number]], states: tuple[str, ...], samples: Number, ops: Arithmetic) -> None:
    """Write the entries of -A^-1 of a low-pass, in the states of `low_pass_rates`, without forming A."""
    corner = 2 * ops.pi * samples
    if len(states) == 1:
        lags[states[0]][states[0]] = 1 / corner
        return
    half, (out, rate) = 1 / (ops.sqrt(2 + 0 * corner) * corner), states
    lags[out] |= {out: half, rate: half}
    lags[rate] |= {out: -half, rate: half}


def _rows_of(entries: dict[str, dict[str, Number]]) -> Matrix:
    return tuple(tuple(row.get(name, 0) for name in entries) for row in entries.values())
