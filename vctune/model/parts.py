"""Define the parts of a device, and the table of their parameters with units, names and limits (model/README.md,
section 12)."""

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
    """The firmware's source of the velocity (model/README.md, section 12).

    Attributes
    ----------
    source : Literal['measured', 'difference']
        "measured" by a velocity sensor, or "difference", the backward difference of the sampled position.
    filter_hz : Number, optional
        Corner frequency f, Hz, of the velocity's low-pass y += a (x - y) with a = 1 - e^(-2 pi f T); None
        without a low-pass.
    filter_order : int
        Number of such low-passes in series, 1 or 2; without effect without a low-pass.
    """

    source: Literal["measured", "difference"] = "measured"
    filter_hz: Number | None = None
    filter_order: int = 1


@dataclass(frozen=True, slots=True)
class Actuator:
    """The actuator's response to its command: a low-pass of order 1, or of order 2 with damping ratio 1/sqrt(2)
    (model/README.md, section 12).

    Attributes
    ----------
    bandwidth_hz : Number
        -3 dB frequency, Hz, > 0.
    order : int
        Order of the low-pass, 1 or 2.
    """

    bandwidth_hz: Number
    order: int = 1


@dataclass(frozen=True, slots=True)
class ForceSensor:
    """The sensor of the hand's force: a delay and a low-pass of the same kind as the actuator's (model/README.md,
    section 12).

    Attributes
    ----------
    bandwidth_hz : Number, optional
        -3 dB frequency, Hz, > 0; None without a low-pass.
    order : int
        Order of the low-pass, 1 or 2; without effect without a low-pass.
    delay : Number
        Delay of the sensed force, s, >= 0.
    filter_coefficient : Number, optional
        A of the firmware's filter y += a (x - y) of the samples, 0 < a <= 1; None without a filter. Only a
        servo may have it.
    """

    bandwidth_hz: Number | None = None
    order: int = 1
    delay: Number = 0.0
    filter_coefficient: Number | None = None


@dataclass(frozen=True, slots=True)
class Servo:
    """A closed loop that follows a velocity or position command with a delay. The hand cannot push it (model/README.md,
    section 17)."""

    delay: Number  # delay from sampling to motion in addition to the hold, s, >= 0
    bandwidth_hz: Number  # -3 dB frequency of the low-pass from the delayed command to the motion, Hz, > 0
    order: int = 1  # order of that low-pass, 1, or 2 with damping ratio 1/sqrt(2)
    command: Literal["velocity", "position"] = "velocity"
    stiffness: Number | None = None
    radii: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Structure:
    """A handle on a spring, which splits the device's mass in two. The position sensor is on the motor's part
    (model/README.md, section 12).

    Attributes
    ----------
    handle_mass : Number
        Mass of the handle, kg, > 0, less than the device's mass.
    frequency_hz : Number
        Frequency of the free resonance of both masses, Hz, > 0.
    damping_ratio : Number
        Damping ratio of that resonance, >= 0.
    load : LeastOperator, optional
        Mass and damping that move rigidly with the handle; None without a load. Frequency and damping ratio
        describe the structure without the load.
    """

    handle_mass: Number
    frequency_hz: Number
    damping_ratio: Number
    load: LeastOperator | None = None


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """A response in the uncertainty set: the nominal one times 1 + share r(omega) e^(j phase) (model/README.md, section
    13)."""

    radii: tuple[tuple[float, float], ...]  # points (frequency in Hz, radius), increasing in frequency
    share: Number = 0.0  # the factor `share`, which multiplies the radius r, 0 <= share <= 1
    phase: Number = 0.0  # direction of the deviation, rad

    def __str__(self) -> str:
        return f"response off by {self.share:.3g} r at {degrees(self.phase):.4g} deg"


Quantity = Literal["mass", "damping", "stiffness", "time", "rate", "ratio"]  # Quantity of a device's parameter


@dataclass(frozen=True, slots=True)
class PartNumber:
    """The description of one parameter of a device."""

    name: str  # key of the number in the table of its part
    quantity: Quantity  # physical quantity
    label: str = ""  # name in a report, for a linear device; "" for a number that no report names
    better: str = ""  # phrase that describes a linear device with a better value, such as "a faster actuator"
    order_key: str = ""  # key of the low-pass's order, if the number is a corner frequency that a file may omit
    sampled: bool = False
    certain: bool = False  # whether the number is known exactly, so that no file may call it uncertain


@dataclass(frozen=True, slots=True)
class Part:
    """A table of [device] that describes a non-ideal part."""

    record: type  # type of the field of `Device`
    label: str  # name of the part, for a linear device
    numbers: tuple[PartNumber, ...]  # the real numbers of the record
    ideal: Any = None  # the record of an ideal part, which a device does not store; None if no record is ideal
    refused_by: Mapping[DisplayName, str] = field(default_factory=dict)
    named: str = ""  # name of the part in a list of a device's parts; "" if that name is `label`

    @property
    def stated(self) -> str:
        """Phrase for a device that has this part."""
        return self.named or self.label


# Descriptions of the parameters in the [device] table itself
DEVICE_NUMBERS = (
    PartNumber("mass", "mass", "mass m"),
    PartNumber("damping", "damping", "damping b"),
    PartNumber("sample_time", "time", "sample time T", certain=True),
    PartNumber("delay", "time", "delay"),
)
# Descriptions of the parts of a device, by their keys
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
                    order_key="filter_order",
                    sampled=True,
                ),
            ),
            ideal=VelocityEstimate(),
            refused_by={"servo": "no gain of this file acts on its velocity"},
        ),
        "actuator": Part(
            Actuator,
            "actuator",
            (PartNumber("bandwidth_hz", "rate", "actuator: bandwidth", "a faster actuator"),),
            refused_by={"servo": "its lag is device.servo.bandwidth_hz and order"},
        ),
        "force_sensor": Part(
            ForceSensor,
            "force sensor",
            (
                PartNumber(
                    "bandwidth_hz", "rate", "force sensor: bandwidth", "a faster force sensor", order_key="order"
                ),
                PartNumber("delay", "time", "force sensor: delay", "less delay of the force sensor"),
                PartNumber("filter_coefficient", "ratio", certain=True),
            ),
            ideal=ForceSensor(),
            refused_by={"impedance": "it senses no force"},
        ),
        "structure": Part(
            Structure,
            "structure",
            (
                PartNumber("handle_mass", "mass", "structure: mass of the handle"),
                PartNumber("frequency_hz", "rate", "structure: resonance", "a stiffer handle"),
                PartNumber("damping_ratio", "ratio", "structure: damping ratio"),
            ),
            refused_by={"servo": "a spring behind its loop is not modelled"},
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
# Descriptions of all parameters of a device, by their keys in its table
PART_NUMBERS: Mapping[str, PartNumber] = MappingProxyType(
    {each.name: each for each in DEVICE_NUMBERS}
    | {f"{key}.{each.name}": each for key, part in PARTS.items() for each in part.numbers}
)
# Keys of the parameters of parts that are known exactly, because the firmware computes with these values
OF_FIRMWARE = tuple(key for key, each in PART_NUMBERS.items() if each.certain and "." in key)
# Keys of all other parameters of a device, without those of the unmodelled response
NUMBERS = tuple(key for key in PART_NUMBERS if key not in OF_FIRMWARE)
# Keys of the parameters that may be uncertain
UNCERTAIN = tuple(key for key, each in PART_NUMBERS.items() if not each.certain)
INERT = ("mass", "damping", "delay")  # Keys of the parameters of [device] that a servo does not have
LOOP_DELAYS = ("delay", "servo.delay")  # Keys of the delay of a loop, one for each kind of display
# Keys of the delays between a command and the sensed force that it causes
DELAYS = (
    *LOOP_DELAYS,
    *(key for key in UNCERTAIN if PART_NUMBERS[key].quantity == "time" and key not in LOOP_DELAYS),
)
# Keys of the parameters that select one response of the uncertainty set
UNMODELLED_KEYS = ("unmodelled.share", "unmodelled.phase")
