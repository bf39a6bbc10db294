"""Define the parts of a device, which are the tables of a problem file, and list their parameters (model/README.md,
section 12)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import degrees
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import AfterValidator, Field

from vctune.model.fields import Internal, Key, NotNegative, Order, Portion, Positive, Real, record
from vctune.model.hands import LeastOperator
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.sections import MOST_SECTIONS, SectionRows, faults_of_rows


def _as_rows(part: VelocityEstimate | ForceSensor) -> None:
    """Keep sections that a program states as lists or as SciPy's array as tuples, which a device can be compared by."""
    rows: Any = part.sections
    if isinstance(rows, list) or hasattr(rows, "tolist"):
        kept = (row.tolist() if hasattr(row, "tolist") else row for row in rows)
        object.__setattr__(part, "sections", tuple(tuple(row) if isinstance(row, list) else row for row in kept))


def _checked(rows: SectionRows) -> SectionRows:
    for fault in faults_of_rows(rows):
        raise ValueError(fault)
    return rows


Sections = Annotated[tuple[tuple[Real, ...], ...], AfterValidator(_checked)]
SECTIONS = (
    "Second-order sections [b0, b1, b2, a0, a1, a2], as SciPy writes them, with which the firmware filters the {}, "
    f"after its low-pass if there is one: stable, with the gain 1 at rest, at most {MOST_SECTIONS}. Default: none."
)


@record
class VelocityEstimate:
    """How the firmware obtains the velocity of the motor."""

    source: Annotated[
        Literal["measured", "difference"] | None,
        Field(alias="from"),
        Key(
            "Source of the velocity: a sensor, or the backward difference of the sampled position. Default: measured; "
            "for an impedance display the difference. An impedance display with a measured velocity is a wall, "
            "environment.stiffness = inf, in the hands of [operator]."
        ),
    ] = None
    filter_hz: Annotated[
        Positive | None,
        Key(
            "Corner frequency f, Hz, of the firmware's low-pass y += a (x - y), where a = 1 - e^(-2 pi f T). Default: "
            "no low-pass.",
            "rate",
            "velocity estimate: low-pass",
            "a faster filter of the velocity",
            order_key="filter_order",
            sampled=True,
        ),
    ] = None
    filter_order: Annotated[
        Order, Key("Number of low-passes of `filter_hz` or `filter_coefficient` in series, 1 or 2.")
    ] = 1
    resolution: Annotated[
        Positive | None,
        Key(
            "Resolution of the position that is differenced, m; one count of the encoder. The report states the force "
            "of a count and what it makes the handle do at rest. Default: not stated."
        ),
    ] = None
    filter_coefficient: Annotated[
        Portion | None,
        Key(
            "Coefficient a of the firmware's low-pass y += a (x - y), 0 < a <= 1, in place of `filter_hz`. Default: no "
            "low-pass.",
            "ratio",
            certain=True,
        ),
    ] = None
    sections: Annotated[Sections | None, Key(SECTIONS.format("velocity"))] = None

    at: Annotated[
        Literal["motor", "handle"],
        Key(
            "Where the sensor of position and velocity sits: on the motor, or at the handle behind the springs of "
            "[[device.structure]], which is proved in the hands of [operator]."
        ),
    ] = "motor"

    def __post_init__(self) -> None:
        _as_rows(self)


@record
class Actuator:
    """The response of the motor's force to its command."""

    bandwidth_hz: Annotated[
        Positive,
        Key("Bandwidth of the force (current) loop, Hz.", "rate", "actuator: bandwidth", "a faster actuator"),
    ]
    order: Annotated[
        Order, Key("Order: 1 is w/(s + w), 2 is w^2/(s^2 + sqrt(2) w s + w^2), with w = 2 pi bandwidth_hz.")
    ] = 1


@record
class ForceSensor:
    """The sensor of the hand's force, and the firmware's filter of its samples."""

    bandwidth_hz: Annotated[
        Positive | None,
        Key(
            "Bandwidth of sensor and filter, Hz, as for the actuator. Default: no low-pass.",
            "rate",
            "force sensor: bandwidth",
            "a faster force sensor",
            order_key="order",
        ),
    ] = None
    order: Annotated[Order, Key("Order of the low-pass, 1 or 2.")] = 1
    delay: Annotated[
        NotNegative,
        Key(
            "Delay until the firmware receives the sample, s; at most 200 sample times.",
            "time",
            "force sensor: delay",
            "less delay of the force sensor",
        ),
    ] = 0.0
    filter_coefficient: Annotated[
        Portion | None,
        Key(
            "Coefficient a of the firmware's filter of the sensed samples, y += a (x - y), 0 < a <= 1. Default: no "
            "filter.",
            "ratio",
            certain=True,
        ),
    ] = None
    resolution: Annotated[
        Positive | None,
        Key(
            "Resolution of the sensed force, N. The report states what its steps make the handle do. Default: not "
            "stated."
        ),
    ] = None
    noise: Annotated[
        Positive | None,
        Key(
            "Noise of a sensed sample, root mean square, N. The report states what it makes the command of a servo do. "
            "Default: not stated."
        ),
    ] = None
    sections: Annotated[Sections | None, Key(SECTIONS.format("sensed force"))] = None

    def __post_init__(self) -> None:
        _as_rows(self)


@record
class Servo:
    """A closed loop that follows a command with a delay, such as a robot under its vendor's controller."""

    delay: Annotated[
        NotNegative,
        Key(
            "Delay between sampling and motion, s, without the delay of the hold; at most 200 sample times, "
            "uncertainty included. Without `bandwidth_hz`, the whole latency of the servo.",
            "time",
            "servo: delay",
        ),
    ]
    bandwidth_hz: Annotated[
        Positive | None,
        Key(
            "Bandwidth of the servo as a low-pass after the delay, Hz. Default: unknown. The claims then hold for each "
            "division of the latency `delay` into a delay and a lag, from half of it each to a lag of half a "
            "sample time, and for this lag after the later delay, less than a sample later, at which the samples "
            "show the hand's mass most.",
            "rate",
            "servo: bandwidth",
            "a faster servo",
        ),
    ] = None
    order: Annotated[Order, Key("Order of the low-pass of `bandwidth_hz`, 1 or 2, as for the actuator.")] = 1
    command: Annotated[
        Literal["velocity", "position"],
        Key("Kind of command: a velocity, which is held over a sample, or a position, which is interpolated."),
    ] = "velocity"
    stiffness: Annotated[
        Positive | None,
        Key(
            "Stiffness of the firmware's spring between the measured position and its reference, N/m. The force of "
            "this spring does not pass through the force sensor. Default: no spring.",
            "stiffness",
            certain=True,
        ),
    ] = None
    max_acceleration: Annotated[
        Positive | None,
        Key(
            "Greatest acceleration that a force of 1 N from rest may command, m/s2: solve looks for no lighter mass, "
            "and vctune warns of a design that commands more. Default: not stated."
        ),
    ] = None
    radii: Internal[tuple[tuple[float, float], ...]] = ()  # disc of unmodelled dynamics, (Hz, radius)
    latency: Internal[Number | None] = None  # delay + lag, s, if only their sum is known: then without bandwidth_hz

    def bandwidth(self, ops: Arithmetic) -> Number:
        """Return the bandwidth, Hz: `bandwidth_hz`, or that of the part of the latency which is no delay."""
        if self.latency is None:
            return self.bandwidth_hz
        lag = self.latency - self.delay
        return (1 if self.order == 1 else ops.sqrt(2 + 0 * lag)) / (2 * ops.pi * lag)


@record
class Structure:
    """A spring behind the motor, or behind the spring before it, and the mass behind this spring."""

    # the position sensor and all damping of the device are on the motor's side of all springs
    handle_mass: Annotated[
        Positive,
        Key(
            "Part of device.mass behind this spring and before the next one, kg; behind the last one, the handle.",
            "mass",
            "structure: mass of the handle",
        ),
    ]
    frequency_hz: Annotated[
        Positive | None,
        Key(
            "Frequency at which the two sides of this spring resonate without a hand, each as one mass, Hz. It or "
            "`stiffness` must be stated.",
            "rate",
            "structure: resonance",
            "a stiffer handle",
        ),
    ] = None
    damping_ratio: Annotated[
        NotNegative,
        Key("Damping ratio of this resonance. Default: 0, a spring without loss.", "ratio", "structure: damping ratio"),
    ] = 0.0
    stiffness: Annotated[
        Positive | None,
        Key(
            "Stiffness of this spring, N/m, in place of `frequency_hz`.",
            "stiffness",
            "structure: stiffness",
            "a stiffer spring",
        ),
    ] = None
    # mass and damping that move rigidly with the handle; frequency and damping ratio are those without them
    load: Internal[LeastOperator | None] = None


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """A response in the uncertainty set: the nominal one times 1 + share r(omega) e^(j phase) (model/README.md, section
    13)."""

    radii: tuple[tuple[float, float], ...]  # points (frequency in Hz, radius), increasing in frequency
    share: Number = 0.0  # the factor `share`, which multiplies the radius r, 0 <= share <= 1
    phase: Number = 0.0  # direction of the deviation, rad

    def __str__(self) -> str:
        return f"response off by {self.share:.3g} r at {degrees(self.phase):.4g} deg"


@dataclass(frozen=True, slots=True)
class DevicePart:
    """A table of [device] that describes a non-ideal part."""

    record: type  # type of the field of `Device`
    stated: str  # phrase for a linear device that has this part
    ideal: Any = None  # the record of an ideal part, which a device does not store; None if no record is ideal
    which: str = ""  # text that tells a part from others of its kind

    @property
    def numbers(self) -> tuple[Key, ...]:
        """The real numbers of the part."""
        hints, which = get_type_hints(self.record, include_extras=True), self.which
        keys = (replace(k, name=n) for n, hint in hints.items() for k in hint.__metadata__ if isinstance(k, Key))
        return tuple(replace(key, label=key.label.replace(":", f"{which}:")) for key in keys if key.quantity)


# Descriptions of the parameters in the [device] table itself
DEVICE_NUMBERS = (
    Key("", "mass", "mass m", name="mass"),
    Key("", "damping", "damping b", name="damping"),
    Key("", "time", "sample time T", certain=True, name="sample_time"),
    Key("", "time", "delay", name="delay"),
)
# The parts of a device, by their keys
PARTS: Mapping[str, DevicePart] = MappingProxyType(
    {
        "velocity": DevicePart(VelocityEstimate, "velocity estimate", VelocityEstimate()),
        "actuator": DevicePart(Actuator, "actuator"),
        "force_sensor": DevicePart(ForceSensor, "force sensor", ForceSensor()),
        "structure": DevicePart(Structure, "handle on a spring"),
        "structure_2": DevicePart(Structure, "second spring", which=" 2"),
        "structure_3": DevicePart(Structure, "third spring", which=" 3"),
        "servo": DevicePart(Servo, "servo"),
    }
)
# Descriptions of all parameters of a device, by their keys in its table
PART_NUMBERS: Mapping[str, Key] = MappingProxyType(
    {each.name: each for each in DEVICE_NUMBERS}
    | {f"{key}.{each.name}": each for key, part in PARTS.items() for each in part.numbers}
)
# Keys of the parameters of parts that are known exactly, because the firmware computes with these values
OF_FIRMWARE = tuple(key for key, each in PART_NUMBERS.items() if each.certain and "." in key)
# Keys of all other parameters of a device, without those of the unmodelled response
NUMBERS = tuple(key for key in PART_NUMBERS if key not in OF_FIRMWARE)
# Keys of the parameters that may be uncertain
UNCERTAIN = tuple(key for key, each in PART_NUMBERS.items() if not each.certain)
MAY_BE_ZERO = tuple(key for key in UNCERTAIN if PART_NUMBERS[key].quantity in ("damping", "time", "ratio"))
INERT = ("mass", "damping", "delay")  # Keys of the parameters of [device] that a servo does not have
LOOP_DELAYS = ("delay", "servo.delay")  # Keys of the delay of a loop, one for each kind of display
# Keys of the delays between a command and the sensed force that it causes
DELAYS = (
    *LOOP_DELAYS,
    *(key for key in UNCERTAIN if PART_NUMBERS[key].quantity == "time" and key not in LOOP_DELAYS),
)
LATENCY = "servo.latency"  # Key of the latency of a servo whose bandwidth is unknown
# Keys of the parameters that select one response of the uncertainty set
UNMODELLED_KEYS = ("unmodelled.share", "unmodelled.phase")
