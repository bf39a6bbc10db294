"""The device and its parts. SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import Any, Literal

import numpy as np

from vctune.model.display import DISPLAYS, Display, DisplayName
from vctune.model.hands import LeastOperator
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import UnitSystem

Hold = Literal["zoh", "lag"]
Commanded = Literal["force", "velocity", "position"]
"""What a firmware commands: a motor's force, or the motion that a servo follows."""


@dataclass(frozen=True, slots=True)
class VelocityEstimate:
    """How the firmware knows the velocity (model/README.md, section 12).

    Attributes
    ----------
    source : "measured" by a sensor of its own, or the backward "difference" of the sampled position
    filter_hz : corner of the low-pass y += a (x - y), a = 1 - e^(-2 pi f T), after it, Hz; None for none
    filter_order : how many such filters follow one another
    """

    source: Literal["measured", "difference"] = "measured"
    filter_hz: Number | None = None
    filter_order: int = 1


@dataclass(frozen=True, slots=True)
class Actuator:
    """The actuator, from command to force: a low-pass of order 1, or of order 2 with damping ratio 1/sqrt(2).

    Attributes
    ----------
    bandwidth_hz : Hz, > 0
    order : 1 or 2
    """

    bandwidth_hz: Number
    order: int = 1


@dataclass(frozen=True, slots=True)
class ForceSensor:
    """The sensor of the hand's force: a delay, and a low-pass like the actuator's.

    Attributes
    ----------
    bandwidth_hz : Hz, > 0; None without a low-pass
    order : 1 or 2
    delay : s, >= 0
    filter_coefficient : a of the firmware's filter y += a (x - y) of the samples, in (0, 1); None without it. Of a
        servo alone
    """

    bandwidth_hz: Number | None = None
    order: int = 1
    delay: Number = 0.0
    filter_coefficient: Number | None = None


@dataclass(frozen=True, slots=True)
class Servo:
    """A closed loop that follows a velocity or position command late, and which the hand cannot push.

    Attributes
    ----------
    delay : from sampling to motion beyond the hold, s, >= 0
    bandwidth_hz : of the low-pass from the late command to the motion, Hz, > 0
    order : of that low-pass, 1 or 2 with damping ratio 1/sqrt(2)
    command : "velocity", held over a sample, or "position", interpolated linearly over it
    stiffness : of a spring by which the firmware pulls what it measures of the position to a reference, N/m; None
        without it. It passes no force sensor
    radii : (Hz, r) of a disc around 1 by which what is sensed of a command may be multiplied; straight between these on
        logarithmic axes, constant above the last, and below the first as the frequency: at rest a servo is where it was
        told to be. Empty where the response is known
    """

    delay: Number
    bandwidth_hz: Number
    order: int = 1
    command: Literal["velocity", "position"] = "velocity"
    stiffness: Number | None = None
    radii: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Structure:
    """A handle on a spring: it splits the device's mass in two; sensor and motor act on the motor's part.

    Attributes
    ----------
    handle_mass : kg, > 0, less than the device's
    frequency_hz : of the free resonance of both masses, Hz, > 0
    damping_ratio : of that resonance, >= 0
    load : what moves as one with the handle; None for nothing. Frequency and damping ratio are those without it
    """

    handle_mass: Number
    frequency_hz: Number
    damping_ratio: Number
    load: LeastOperator | None = None


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """A response that is not quite the device's: all of it times 1 + share r(omega) e^(j phase) (README, section 13).

    Attributes
    ----------
    radii : (frequency in Hz, radius), increasing in frequency: r is straight between them on logarithmic axes, and
        constant beyond
    share : of the radius, 0 <= share <= 1
    phase : rad
    """

    radii: tuple[tuple[float, float], ...]
    share: Number = 0.0
    phase: Number = 0.0

    def __str__(self) -> str:
        return f"response off by {self.share:.3g} r at {degrees(self.phase):.4g} deg"


PARTS = ("velocity", "actuator", "force_sensor", "structure", "servo")
"""The tables of a device that say what an ideal one has not."""
NUMBERS = (
    "mass",
    "damping",
    "sample_time",
    "delay",
    "velocity.filter_hz",
    "actuator.bandwidth_hz",
    "force_sensor.bandwidth_hz",
    "force_sensor.delay",
    "structure.handle_mass",
    "structure.frequency_hz",
    "structure.damping_ratio",
    "servo.delay",
    "servo.bandwidth_hz",
)
"""The numbers of a device by their keys in its table."""
OF_FIRMWARE = ("force_sensor.filter_coefficient", "servo.stiffness")
"""Those that the firmware computes with: they are known."""
INERT = ("mass", "damping", "delay")
"""Those that a servo does not have: nothing depends on their values then."""
PERTURBATION = ("unmodelled.share", "unmodelled.phase")
"""What tells apart the responses of one device."""


@dataclass(frozen=True, slots=True)
class Device:
    """A display: Z_d = mass s + damping, sampled and held (model/README.md, sections 1 and 15).

    Attributes
    ----------
    mass : kg, > 0; 1 for a servo, on which nothing depends
    damping : N s/m, >= 0; 0 for a servo
    sample_time : s, > 0
    delay : s, >= 0, from sampling to actuation, beyond the hold
    hold : "zoh", the exact (1-e^{-sT})/(sT), or "lag", the paper's 2/(2+sT)
    operator : what is always at the handle; None if nothing need be
    velocity, actuator, force_sensor, structure : what an ideal device has not; None each
    servo : the vendor's loop of a servo; None for any other display
    unmodelled : which of the responses that are as good as its own; None for its own
    display : name of its kind (`vctune.model.display`)
    units : whether its handle moves along a line or about an axis (`vctune.model.numbers.units`): mass is then inertia
    """

    mass: Number
    damping: Number
    sample_time: Number
    delay: Number = 0.0
    hold: Hold = "zoh"
    operator: LeastOperator | None = None
    velocity: VelocityEstimate | None = None
    actuator: Actuator | None = None
    force_sensor: ForceSensor | None = None
    structure: Structure | None = None
    unmodelled: Unmodelled | None = None
    display: DisplayName = "admittance"
    servo: Servo | None = None
    units: UnitSystem = "linear"

    @property
    def kind(self) -> Display:
        """The display: force in and motion out, motion in and force out, or a servo."""
        return DISPLAYS[self.display]

    @property
    def commanded(self) -> Commanded:
        """The quantity that the firmware commands."""
        return "force" if self.servo is None else self.servo.command

    @property
    def coupling_may_drive(self) -> bool:
        """Whether the coupling may have Re 1/Z_c < 0: that of an impedance display with two low-passes of the velocity.

        Where R is negative too, stability requires Re 1/Z_c > R itself, not a multiple of R.
        """
        known = self.velocity
        return self.kind.inverse and known is not None and known.filter_hz is not None and known.filter_order > 1

    @property
    def bare(self) -> Device:
        """The device when it is let go."""
        return replace(self, operator=None)

    @property
    def ideal(self) -> bool:
        """Whether it is rigid, and measures, pushes and feels at once."""
        late = self.velocity is not None or self.actuator is not None or self.force_sensor is not None
        return not late and self.structure is None and self.unmodelled is None

    @property
    def modelled(self) -> Device:
        """The device with its own response."""
        return self if self.unmodelled is None else replace(self, unmodelled=None)

    @property
    def with_operator(self) -> Device:
        """The device with its least operator at the handle, a part of it: W = Z_d + Z_h in place of Z_d if rigid."""
        if self.operator is None:
            return self
        if self.structure is not None:
            return replace(self, structure=replace(self.structure, load=self.operator), operator=None)
        mass, damping = self.mass + self.operator.mass, self.damping + self.operator.damping
        return replace(self, mass=mass, damping=damping, operator=None)

    @property
    def loops(self) -> tuple[Device, ...]:
        """The devices whose velocity loops must be stable by themselves; none for a servo."""
        if not self.kind.own_loop:
            return ()
        return (self,) if self.operator is None else (self.bare, self.with_operator)

    @property
    def motor_mass(self) -> Number:
        """The mass that the motor drives directly: all of a rigid device, kg."""
        return self.mass if self.structure is None else self.mass - self.structure.handle_mass

    @property
    def least_damping(self) -> Number:
        """b + b_h, of the device in the hand of its least operator, N s/m."""
        return self.damping if self.operator is None else self.damping + self.operator.damping

    def number(self, key: str) -> Number:
        """Return one of its numbers by its key; None where it has not got that."""
        of: Any = self
        for name in key.split("."):
            of = getattr(of, name) if of is not None else None
        return of

    def numbers(self) -> dict[str, Number]:
        """Return the numbers that it has, by their keys."""
        found = {key: self.number(key) for key in NUMBERS if self.servo is None or key not in INERT}
        return {key: number for key, number in found.items() if number is not None}

    def _varying(self) -> dict[str, Number]:
        """Return its numbers, those of its firmware, and which of its responses it has."""
        firmware = {key: number for key in OF_FIRMWARE if (number := self.number(key)) is not None}
        perturbed = {key: self.number(key) for key in PERTURBATION if self.unmodelled is not None}
        return self.numbers() | firmware | perturbed

    def with_numbers(self, numbers: Mapping[str, Number]) -> Device:
        """Return the device with other numbers in place of some that it has, by their keys."""
        parts: dict[str, dict[str, Number]] = {}
        own: dict[str, Any] = {}
        for key, number in numbers.items():
            part, _, name = key.rpartition(".")
            (parts.setdefault(part, {}) if part else own)[name] = number
        own |= {part: replace(getattr(self, part), **changed) for part, changed in parts.items()}
        return replace(self, **own)

    def converted(self, number: Callable[[Number], Number]) -> Device:
        """Return the device in numbers of another arithmetic."""
        same = self.with_numbers({key: number(value) for key, value in self._varying().items()})
        return same._with_hands(lambda hand: LeastOperator(number(hand.mass), number(hand.damping)))

    def in_units(self, impedance: Number, time: Number) -> Device:
        """Return the device in other units of impedance and time.

        Lengths keep their unit: a mass is counted in impedance times time, a stiffness in impedance over time.

        Parameters
        ----------
        impedance : the new unit of impedance, N s/m, > 0
        time : the new unit of time, s, > 0

        Returns
        -------
        Device
            The same parts, each number divided by its new unit; frequencies are cycles per unit of time.
        """
        units = {"mass": impedance * time, "damping": impedance, "delay": time, "sample_time": time}
        units |= {"handle_mass": impedance * time, "frequency_hz": 1 / time, "bandwidth_hz": 1 / time}
        units |= {"filter_hz": 1 / time, "damping_ratio": 1.0}
        scaled = {key: value / units[key.rpartition(".")[2]] for key, value in self.numbers().items()}
        if self.servo is not None and self.servo.stiffness is not None:
            scaled["servo.stiffness"] = self.servo.stiffness / (impedance / time)
        same = self.with_numbers(scaled)
        if same.servo is not None:
            radii = tuple((hz * time, radius) for hz, radius in same.servo.radii)
            same = replace(same, servo=replace(same.servo, radii=radii))
        if same.unmodelled is not None:
            radii = tuple((hz * time, radius) for hz, radius in same.unmodelled.radii)
            same = replace(same, unmodelled=replace(same.unmodelled, radii=radii))
        return same._with_hands(lambda hand: LeastOperator(hand.mass / units["mass"], hand.damping / impedance))

    def _with_hands(self, changed: Callable[[LeastOperator], LeastOperator]) -> Device:
        """Return the device with another operator and another load on its handle."""
        structure = self.structure
        if structure is not None and structure.load is not None:
            structure = replace(structure, load=changed(structure.load))
        return replace(self, structure=structure, operator=self.operator and changed(self.operator))

    @property
    def loop_lag(self) -> Number:
        """tau = T/2 + delay, the low-frequency lag of hold and delay, s."""
        return self.sample_time / 2 + self.latency

    @property
    def delay_key(self) -> str:
        """The key of `latency`."""
        return "delay" if self.servo is None else "servo.delay"

    @property
    def latency(self) -> Number:
        """The delay from sampling to actuation, beyond the hold, s."""
        return self.delay if self.servo is None else self.servo.delay


def stacked(devices: Sequence[Device]) -> Device:
    """Return devices as one whose numbers are arrays of shape (n,); plain where all have the same.

    Parameters
    ----------
    devices : n devices with the same parts
    """
    first, *others = devices
    if not others:
        return first
    columns = {key: [device.number(key) for device in devices] for key in first._varying()}
    return first.with_numbers({key: np.array(each) for key, each in columns.items() if len(set(each)) > 1})
