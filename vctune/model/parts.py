"""The parts of a device, and the table of their numbers, units, names and limits (model/README.md, section 12).

A part is a record of this module, its entry in `PARTS`, a field of `Device` and a table of the problem file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import degrees
from types import MappingProxyType
from typing import Any, Literal

from vctune.model.display import DisplayName
from vctune.model.hands import LeastOperator
from vctune.model.numbers.arithmetic import Number


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


Quantity = Literal["mass", "damping", "stiffness", "time", "rate", "ratio"]
"""What a number of a device counts: each has a unit of its own."""


@dataclass(frozen=True, slots=True)
class PartNumber:
    """A number of a device.

    Attributes
    ----------
    name : its key in the table of its part
    quantity : what it counts
    label : name in a report, for a linear device
    better : what changing it for the better means, for a linear device: more of a rate, less of a delay; empty for any
        other
    order : key of the order of the low-pass whose corner it is, where a file may leave out the corner
    sampled : whether the firmware makes it of samples, so that it is below the Nyquist frequency
    certain : whether the firmware computes with it, so that it is never uncertain
    """

    name: str
    quantity: Quantity
    label: str = ""
    better: str = ""
    order: str = ""
    sampled: bool = False
    certain: bool = False


@dataclass(frozen=True, slots=True)
class Part:
    """A table of [device] that says what an ideal device has not.

    Attributes
    ----------
    record : type of the field of `Device`
    label : name of the part, for a linear device
    stated : what a device with it has
    numbers : those of its record that may be any real number of a range
    idle : the record that does nothing, which a device does not keep; None where there is none
    lacking : why a kind of display has no such part
    """

    record: type
    label: str
    numbers: tuple[PartNumber, ...]
    idle: Any = None
    lacking: Mapping[DisplayName, str] = field(default_factory=dict)
    named: str = ""

    @property
    def stated(self) -> str:
        """What a device that has it is said to have."""
        return self.named or self.label


OWN_NUMBERS = (
    PartNumber("mass", "mass", "mass m"),
    PartNumber("damping", "damping", "damping b"),
    PartNumber("sample_time", "time", "sample time T", certain=True),
    PartNumber("delay", "time", "delay"),
)
"""The numbers of [device] itself."""
PARTS: Mapping[str, Part] = MappingProxyType(
    {
        "velocity": Part(
            VelocityEstimate,
            "velocity estimate",
            (
                PartNumber(
                    "filter_hz",
                    "rate",
                    "velocity estimate: low-pass",
                    "a faster filter of the velocity",
                    order="filter_order",
                    sampled=True,
                ),
            ),
            idle=VelocityEstimate(),
            lacking={"servo": "no gain of this file acts on its velocity"},
        ),
        "actuator": Part(
            Actuator,
            "actuator",
            (PartNumber("bandwidth_hz", "rate", "actuator: bandwidth", "a faster actuator"),),
            lacking={"servo": "its lag is device.servo.bandwidth_hz and order"},
        ),
        "force_sensor": Part(
            ForceSensor,
            "force sensor",
            (
                PartNumber("bandwidth_hz", "rate", "force sensor: bandwidth", "a faster force sensor", order="order"),
                PartNumber("delay", "time", "force sensor: delay", "less delay of the force sensor"),
                PartNumber("filter_coefficient", "ratio", certain=True),
            ),
            idle=ForceSensor(),
            lacking={"impedance": "it senses no force"},
        ),
        "structure": Part(
            Structure,
            "structure",
            (
                PartNumber("handle_mass", "mass", "structure: mass of the handle"),
                PartNumber("frequency_hz", "rate", "structure: resonance", "a stiffer handle"),
                PartNumber("damping_ratio", "ratio", "structure: damping ratio"),
            ),
            lacking={"servo": "a spring behind its loop is not modelled"},
            named="handle on a spring",
        ),
        "servo": Part(
            Servo,
            "servo",
            (
                PartNumber("delay", "time", "servo: delay"),
                PartNumber("bandwidth_hz", "rate", "servo: bandwidth", "a faster servo"),
                PartNumber("stiffness", "stiffness", certain=True),
            ),
        ),
    }
)
"""The parts of a device by their keys."""
ENTRIES: Mapping[str, PartNumber] = MappingProxyType(
    {each.name: each for each in OWN_NUMBERS}
    | {f"{key}.{each.name}": each for key, part in PARTS.items() for each in part.numbers}
)
"""The numbers of a device by their keys in its table."""
OF_FIRMWARE = tuple(key for key, each in ENTRIES.items() if each.certain and "." in key)
"""Those of its parts that the firmware computes with: they are known."""
NUMBERS = tuple(key for key in ENTRIES if key not in OF_FIRMWARE)
"""All others."""
UNCERTAIN = tuple(key for key, each in ENTRIES.items() if not each.certain)
"""Those that may be uncertain: all but the firmware's own."""
INERT = ("mass", "damping", "delay")
"""Those that a servo does not have: nothing depends on their values then."""
LOOP_DELAYS = ("delay", "servo.delay")
"""The delay of a loop, by the kind of display."""
DELAYS = (
    *LOOP_DELAYS,
    *(key for key in UNCERTAIN if ENTRIES[key].quantity == "time" and key not in LOOP_DELAYS),
)
"""The delays that add up between a command and the force that is sensed of it."""
PERTURBATION = ("unmodelled.share", "unmodelled.phase")
"""What tells apart the responses of one device."""
