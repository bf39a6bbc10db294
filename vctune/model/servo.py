"""A device that follows its command late: a vendor's closed loop, which the hand cannot push (model/README.md, section 17).

SI units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from vctune.model.device import ForceSensor
from vctune.model.numbers.arithmetic import Arithmetic, Number

Command = Literal["velocity", "position"]
"""What the loop is sent: a velocity that is held over a sample, or a position that is interpolated over it."""


@dataclass(frozen=True, slots=True)
class Servo:
    """How a velocity or position loop follows what it is sent.

    Attributes
    ----------
    delay : from sampling to motion beyond the hold, s, >= 0
    bandwidth_hz : of the low-pass H from the late command to the velocity, Hz, > 0
    order : of H, 1 or 2 with damping ratio 1/sqrt(2)
    command : what it is sent
    """

    delay: Number
    bandwidth_hz: Number
    order: int = 1
    command: Command = "velocity"


NUMBERS = ("servo.delay", "servo.bandwidth_hz", "force_sensor.bandwidth_hz", "force_sensor.delay")
"""The numbers of a servo device that may be uncertain, by their keys in a problem file's table of the device."""
DELAYS = ("servo.delay", "force_sensor.delay")


@dataclass(frozen=True, slots=True)
class ServoDevice:
    """A servo, and a force sensor between its flange and the hand.

    Attributes
    ----------
    sample_time : T, of the firmware that commands it, s, > 0
    servo : how it follows
    force_sensor : None for one that is ideal
    """

    sample_time: Number
    servo: Servo
    force_sensor: ForceSensor | None = None

    def number(self, key: str) -> Number:
        """Return one of `NUMBERS`; None where it has not got that."""
        part, name = key.split(".")
        of: Any = getattr(self, part)
        return None if of is None else getattr(of, name)

    def with_numbers(self, numbers: Mapping[str, Number]) -> ServoDevice:
        """Return the device with other numbers in place of some of `NUMBERS` that it has."""
        found = self
        for key, number in numbers.items():
            part, name = key.split(".")
            changed: Any = {part: replace(getattr(found, part), **{name: number})}
            found = replace(found, **changed)
        return found

    def converted(self, number: Callable[[Number], Number]) -> ServoDevice:
        """Return the device in numbers of another arithmetic."""
        own = {key: number(value) for key in NUMBERS if (value := self.number(key)) is not None}
        return replace(self.with_numbers(own), sample_time=number(self.sample_time))

    @property
    def sensed_delay(self) -> Number:
        """Delay from a command to what the sensor says of its motion, s: where the two are does not matter."""
        sensor = self.force_sensor
        return self.servo.delay if sensor is None else self.servo.delay + sensor.delay

    @property
    def sensed_force_jumps(self) -> bool:
        """Whether the force of a hand's mass jumps with the command: H of order 1, and no low-pass in the sensor."""
        filtered = self.force_sensor is not None and self.force_sensor.bandwidth_hz is not None
        return self.servo.order == 1 and not filtered


@dataclass(frozen=True, slots=True)
class Latency:
    """The parts of L, by which the force of a spring is late at rest: the drag must be at least K L. All in s.

    Attributes
    ----------
    hold : T/2
    interpolation : T/2 of a position command
    delay : of the servo
    lag : of its low-pass
    sensor : delay and lag of the force sensor
    """

    hold: Number
    interpolation: Number
    delay: Number
    lag: Number
    sensor: Number

    @property
    def total(self) -> Number:
        """L."""
        return self.hold + self.interpolation + self.delay + self.lag + self.sensor


def latency(device: ServoDevice, ops: Arithmetic) -> Latency:
    """Return what the force of a spring is late by at rest, part by part.

    Parameters
    ----------
    device : its numbers in the arithmetic
    ops : the arithmetic
    """
    servo, sensor, half = device.servo, device.force_sensor, device.sample_time / 2
    late = 0 * half
    if sensor is not None:
        late = late + sensor.delay
        if sensor.bandwidth_hz is not None:
            late = late + _lag(sensor.bandwidth_hz, sensor.order, ops)
    return Latency(
        hold=half,
        interpolation=half if servo.command == "position" else 0 * half,
        delay=servo.delay,
        lag=_lag(servo.bandwidth_hz, servo.order, ops),
        sensor=late,
    )


def _lag(bandwidth_hz: Number, order: int, ops: Arithmetic) -> Number:
    """Return -d(phase)/d(omega) of a low-pass at rest, s."""
    corner = 2 * ops.pi * bandwidth_hz
    return 1 / corner if order == 1 else ops.sqrt(2 + 0 * corner) / corner
