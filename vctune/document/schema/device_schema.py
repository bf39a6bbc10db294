"""Define the schema of a device: type, range and documentation of the keys of [device] and [uncertainty]."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, create_model

from vctune.document.schema.fields import NotNegative, Portion, Positive, Share, Table
from vctune.model.parts import UNCERTAIN

Order = Annotated[int, Field(strict=True, ge=1, le=2)]


class VelocityTable(Table):
    """How the firmware obtains the velocity of the motor."""

    source: Literal["measured", "difference"] | None = Field(
        None,
        alias="from",
        description="Source of the velocity: a sensor, or the backward difference of the sampled position. Default: "
        "measured; for an impedance display the difference.",
    )
    filter_hz: Positive | None = Field(
        None,
        description="Corner frequency f, Hz, of the firmware's low-pass y += a (x - y), where a = 1 - e^(-2 pi f T). "
        "Default: no low-pass.",
    )
    filter_order: Order = Field(1, description="Number of low-passes of `filter_hz` in series, 1 or 2.")


class EncoderTable(VelocityTable):
    """How the firmware obtains the velocity of the motor."""

    resolution: Positive | None = Field(
        None,
        description="Resolution of the position that is differenced, m; one count of the encoder. The report states "
        "the force of a count; no claim depends on it. Default: not stated.",
    )


class ActuatorTable(Table):
    """The response of the motor's force to its command."""

    bandwidth_hz: Positive = Field(description="Bandwidth of the force (current) loop, Hz.")
    order: Order = Field(
        1, description="Order: 1 is w/(s + w), 2 is w^2/(s^2 + sqrt(2) w s + w^2), with w = 2 pi bandwidth_hz."
    )


class ForceSensorTable(Table):
    """The sensor of the hand's force."""

    bandwidth_hz: Positive | None = Field(
        None, description="Bandwidth of sensor and filter, Hz, as for the actuator. Default: no low-pass."
    )
    order: Order = Field(1, description="Order of the low-pass, 1 or 2.")
    delay: NotNegative = Field(
        0.0, description="Delay until the firmware receives the sample, s; at most 200 sample times."
    )


class StructureTable(Table):
    """A handle on a spring. The position sensor and all damping of the device are on the motor's side."""

    handle_mass: Positive = Field(description="Part of device.mass on the handle's side of the spring, kg.")
    frequency_hz: Positive = Field(description="Frequency at which the two parts resonate without a hand, Hz.")
    damping_ratio: NotNegative = Field(description="Damping ratio of the resonance at `frequency_hz`.")


class ServoTable(Table):
    """A closed loop that follows a command with a delay, such as a robot under its vendor's controller."""

    command: Literal["velocity", "position"] = Field(
        "velocity",
        description="Kind of command: a velocity, which is held over a sample, or a position, which is interpolated.",
    )
    delay: NotNegative = Field(
        description="Delay between sampling and motion, s, without the delay of the hold; at most 200 sample times, "
        "uncertainty included."
    )
    bandwidth_hz: Positive = Field(description="Bandwidth of the servo as a low-pass after the delay, Hz.")
    order: Order = Field(1, description="Order of the low-pass of `bandwidth_hz`, 1 or 2, as for the actuator.")
    stiffness: Positive | None = Field(
        None,
        description="Stiffness of the firmware's spring between the measured position and its reference, N/m. "
        "The force of this spring does not pass through the force sensor. Default: no spring.",
    )


class ServoSensorTable(ForceSensorTable):
    """The sensor of the hand's force, and the admittance controller's filter of its samples."""

    filter_coefficient: Portion | None = Field(
        None, description="Coefficient a of the controller's filter y += a (x - y), 0 < a <= 1. Default: no filter."
    )


class ServoDeviceTable(Table):
    """A device that follows its command with a delay and that the hand cannot push."""

    units: Literal["linear", "rotary"] = Field("linear", description="Kind of motion of the servo, linear or rotary.")
    sample_time: Positive = Field(description="Sample time of the admittance controller, s.")
    servo: ServoTable
    force_sensor: ServoSensorTable | None = Field(None, description="Default: the force is sensed without delay.")


class DeviceTable(Table):
    """The mechanism: Z_d = mass s + damping."""

    display: Literal["admittance", "impedance"] = Field(
        "admittance",
        description='Kind of display. "admittance": force in, velocity out. "impedance": motion in, force out.',
    )
    units: Literal["linear", "rotary"] = Field(
        "linear",
        description="Kind of motion of the handle. For a rotary device (a wheel, a knob, a joint), read kg m2, rad and "
        "N m for every kg, m and N of this file. The mass is then the moment of inertia. The keys keep their names.",
    )
    mass: Positive = Field(description="Moving mass, kg.")
    damping: NotNegative = Field(description="Viscous damping, N s/m.")
    sample_time: Positive = Field(description="Sample time of the velocity loop, s.")
    hold: Literal["zoh", "lag"] = Field(
        "zoh", description="Hold: exact zero-order hold, or the paper's first-order lag 2/(2+sT)."
    )
    delay: NotNegative = Field(
        0.0,
        description="Delay between sampling and actuation, s, without the delay of the hold; at most 200 sample "
        "times, uncertainty included.",
    )
    velocity: EncoderTable | None = Field(None, description="Default: measured without delay.")
    actuator: ActuatorTable | None = Field(None, description="Default: the force follows the command without lag.")
    force_sensor: ForceSensorTable | None = Field(None, description="Default: the force is sensed without delay.")
    structure: StructureTable | None = Field(None, description="Default: rigid.")


def _device_form(value: Any) -> str:
    servo = "servo" in value if isinstance(value, dict) else isinstance(value, ServoDeviceTable)
    return "<servo>" if servo else "<mechanism>"


AnyDeviceTable = Annotated[
    Annotated[DeviceTable, Tag("<mechanism>")] | Annotated[ServoDeviceTable, Tag("<servo>")],
    Discriminator(_device_form),
]


def _share(key: str) -> Any:
    meaning = "; 0.1 means plus or minus 10 %" if key == "mass" else ""
    return Share, Field(0.0, alias=key, description=f"Uncertainty of device.{key}{meaning}.")


# Table with a relative half-width for each parameter of a device that may be uncertain
SharesTable: Any = create_model(
    "SharesTable", __base__=Table, **{key.replace(".", "_"): _share(key) for key in UNCERTAIN}
)


class UncertaintyTable(SharesTable):
    """Relative half-widths of the intervals of the device's parameters.

    The constraints hold for every device whose parameters lie in these intervals.

    To state the uncertainty of a parameter in a sub-table of [device], quote its name,
    as in "actuator.bandwidth_hz" = 0.2.
    """

    unmodelled: list[tuple[Positive, Positive]] = Field(
        default_factory=list,
        description="Unmodelled dynamics, [[Hz, radius], ...]: a relative error of the device's response, at most the "
        "radius at each frequency. vctune interpolates the radius linearly on logarithmic axes, and keeps it constant "
        "below the first and above the last frequency.",
    )
    objective: Literal["nominal", "worst"] = Field(
        "nominal",
        description="Error to minimise: the error of the nominal device, or the greatest error at the vertices of the "
        "box.",
    )
