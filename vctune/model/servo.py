"""Split the latency of a servo into its parts (model/README.md, section 17). SI units."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, prod

from vctune.model.device import Device
from vctune.model.loop.filters import force_sections
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.parts import LATENCY
from vctune.model.sampled.circle import SNAP


@dataclass(frozen=True, slots=True)
class Latency:
    """The parts of L, the time by which a spring's force lags at rest, s."""

    hold: Number  # T/2, the lag of the hold
    interpolation: Number  # T/2 for a position command, else 0
    delay: Number  # delay of the servo
    lag: Number  # lag of the servo's low-pass
    sensor: Number  # delay and lag of the force sensor
    filter: Number  # lag of the firmware's filter of the sensed samples

    @property
    def total(self) -> Number:
        """The sum of the parts, L."""
        return self.hold + self.interpolation + self.delay + self.lag + self.sensor + self.filter


@dataclass(frozen=True, slots=True)
class LatencyPart:
    """The name of a part of L, and the parameter of the device that determines this part."""

    label: str  # name of the part
    key: str  # dotted key of the number or of the table that states the part, in a problem file
    quicker: str  # advice on how to shorten the part

    @classmethod
    def of(cls, label: str, key: str, change: str) -> LatencyPart:
        """Return the part that a change of the number with a given key shortens."""
        return cls(label, f"device.{key}", f"{change} device.{key}")


def latency_parts(device: Device) -> dict[str, LatencyPart]:
    """Return descriptions of the parts of `Latency`, by their field names."""
    sensor = device.sensing
    filtered = sensor.sections is not None and sensor.filter_coefficient is None
    return LATENCY_PARTS | {"filter": IN_SECTIONS} if filtered else LATENCY_PARTS


LATENCY_PARTS = {
    "hold": LatencyPart.of("hold", "sample_time", "shorten"),
    "interpolation": LatencyPart.of("interpolation", "sample_time", "shorten"),
    "delay": LatencyPart.of("delay", "servo.delay", "shorten"),
    "lag": LatencyPart.of("lag", "servo.bandwidth_hz", "raise"),
    "sensor": LatencyPart.of("force sensor", "force_sensor", "state a quicker"),
    "filter": LatencyPart.of("filter", "force_sensor.filter_coefficient", "raise"),
}
IN_SECTIONS = LatencyPart.of("filter", "force_sensor.sections", "quicken")


def latency(device: Device, ops: Arithmetic) -> Latency:
    """Return the parts of L, the time by which a servo's spring force lags at rest (model/README.md, section 17)."""
    servo, sensor, half = device.servo, device.sensing, device.sample_time / 2
    assert servo is not None
    late, smoothed = 0 * half + sensor.delay, 0 * half
    if sensor.bandwidth_hz is not None:
        late = late + _lag(sensor.bandwidth_hz, sensor.order, ops)
    for section in force_sections(device):
        smoothed = smoothed + device.sample_time * section.lag
    return Latency(
        hold=half,
        interpolation=half if device.interpolates else 0 * half,
        delay=servo.delay,
        lag=_lag(servo.bandwidth(ops), servo.order, ops),
        sensor=late,
        filter=smoothed,
    )


def _lag(bandwidth_hz: Number, order: int, ops: Arithmetic) -> Number:
    """Return the lag of a low-pass at omega = 0, -d(phase)/d(omega), s."""
    corner = 2 * ops.pi * bandwidth_hz
    return 1 / corner if order == 1 else ops.sqrt(2 + 0 * corner) / corner


LEAST_LAG = 0.5  # Least lag of a servo whose bandwidth is unknown, in samples


def delays_in_latency(latency: float, sample_time: float) -> tuple[float, float]:
    """Return the least and the greatest delay in a latency whose division into delay and lag is unknown, s."""
    return latency / 2, max(latency / 2, latency - LEAST_LAG * sample_time)


def numbers_to_state(device: Device) -> dict[str, Number]:
    """Return the numbers with which a file states a device; for one division of a latency also its bandwidth."""
    numbers = device.numbers()
    if device.servo is not None and device.divided:
        numbers |= {"servo.bandwidth_hz": float(device.servo.bandwidth(FLOATS))}
    return numbers


def with_least_lag(device: Device, off: float) -> Device:
    """Return a servo, of which only the latency is known, with the least lag after the next delay that is `off` samples
    from whole samples."""
    assert device.servo is not None and device.servo.latency is not None
    T, sensed = device.sample_time, device.sensing.delay
    whole = ceil(((device.servo.latency + sensed) / T - LEAST_LAG - off) * (1 - SNAP))
    delay = (whole + off) * T - sensed
    return device.with_numbers({device.delay_key: delay, LATENCY: delay + LEAST_LAG * T})


def lightest_mass(device: Device, drag: float) -> float:
    """Return the least mass of a rigid law with which a unit of sensed force from rest commands no more than the
    servo's greatest acceleration; 0 without one."""
    servo = device.servo
    if servo is None or servo.max_acceleration is None:
        return 0.0
    needed = prod(float(section.now) for section in force_sections(device)) / float(servo.max_acceleration)
    return needed if device.rule == "euler" else max(0.0, (needed - drag * float(device.sample_time)) / 2)
