"""Define the schema of log.toml: the columns of a log, their units, and the known parameters of the device."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, GetPydanticSchema, Tag
from pydantic_core.core_schema import literal_schema

from vctune.document.schema.problem_schema import Table
from vctune.model.fields import MOST, Flag, NotNegative, Positive, Text
from vctune.model.parts import Actuator, ForceSensor, VelocityEstimate

# Units of a column by name, each in SI units
UNITS: dict[str, float] = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6,
    "m": 1.0, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295,
    "m/s": 1.0, "mm/s": 1e-3, "rad/s": 1.0, "deg/s": 0.017453292519943295,
    "N": 1.0, "mN": 1e-3, "kN": 1e3, "Nm": 1.0, "mNm": 1e-3,
    "Hz": 1.0, "dB": 1.0,
}  # fmt: skip
Unit = Annotated[str, GetPydanticSchema(lambda *_: literal_schema([*UNITS]))]


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("0 makes every sample the same; write SI units per unit of the column")
    return value


class ColumnTable(Table):
    """A column as a table, instead of its header alone: with a unit, a scale, a resolution or a limit."""

    column: Text = Field(description="Header of the column in the CSV file.")
    unit: Unit | None = Field(
        None, description="Unit of the column. Default: the end of its header, as in position_mm."
    )
    scale: Annotated[float, Field(strict=True, ge=-MOST, le=MOST), AfterValidator(_not_zero)] | None = Field(
        None, description="SI units per unit of the column, instead of `unit`: a torque constant, metres per count."
    )
    quantum: Positive | None = Field(
        None, description="Resolution, in the column's unit. Default: the least step between two samples."
    )
    limit: Positive | None = Field(
        None, description="Value at which the column saturates, in its unit. Default: not known."
    )


Column = Annotated[
    Annotated[Text, Tag("<text>")] | Annotated[ColumnTable, Tag("<column>")],
    Discriminator(lambda value: "<text>" if isinstance(value, str) else "<column>"),
]


class ColumnsTable(Table):
    """The columns of the log, each as a header or as { column = ..., unit = ... }."""

    time: Column | None = Field(None, description="Time of the sample. Default: a column time_s, time_ms, ...")
    position: Column | None = Field(None, description="Position of the motor, from the encoder.")
    velocity: Column | None = Field(None, description="Velocity of the motor, if its position was not logged.")
    command: Column | None = Field(None, description="Commanded force, held until the next sample.")
    force: Column | None = Field(
        None,
        description="Measured force of the motor: current times its constant. It does not replace the command, which "
        "tells the delay.",
    )
    hand: Column | None = Field(None, description="Sensed force of the hand on the handle.")
    handle: Column | None = Field(None, description="Position of the handle behind a spring, if the log contains it.")
    velocity_command: Column | None = Field(
        None, description="Velocity command of a servo (--servo), held until the next sample."
    )
    position_command: Column | None = Field(
        None,
        description="Position command of a servo (--servo), instead of a velocity command; interpolated over a sample.",
    )
    frequency: Column | None = Field(None, description="Frequency of a measured response, instead of a time.")
    real: Column | None = Field(
        None, description="Real part of the response: velocity over command of a servo, position over force otherwise."
    )
    imag: Column | None = Field(None, description="Imaginary part of the response.")
    gain: Column | None = Field(None, description="Size of the response in dB, instead of both parts.")
    phase: Column | None = Field(None, description="Phase of the response, negative for a lag.")


class KnownDeviceTable(Table):
    """Known parameters of the device, which vctune copies to device.toml without identifying them."""

    display: Literal["admittance", "impedance"] = Field(
        "admittance", description="Kind of display, as in a problem file. A servo has none to state."
    )
    delay: NotNegative | None = Field(
        None, description="Delay between sampling and actuation, s, without the delay of the hold."
    )
    delay_uncertainty: NotNegative = Field(0.0, description="Half-width of a known delay, s.")
    velocity: VelocityEstimate | None = Field(
        None,
        description='Default: a difference. Without `velocity.from`, device.toml states "difference" as an assumption.',
    )
    actuator: Actuator | None = Field(None, description="Default: not known.")
    force_sensor: ForceSensor | None = Field(None, description="Default: not known.")


class LogDocument(Table):
    """The columns of a log. Without this file, their headers must be time_s, position_m, command_N and similar."""

    name: Text | None = Field(
        None,
        min_length=1,
        max_length=200,
        description="Name of the device and of its folder. Default: the first log's stem.",
    )
    description: Text = Field("", description="Free text for the reader.")
    rotary: Flag = Field(
        False,
        description='Whether kg, m and N stand for kg m2, rad and N m. If true, device.toml states units = "rotary".',
    )
    sample_time: Positive | None = Field(
        None,
        description="Sample time T of the loop, s; the log may have fewer rows. Default: the median step of the column "
        "`time`.",
    )
    columns: ColumnsTable = Field(default_factory=ColumnsTable)
    device: KnownDeviceTable = Field(default_factory=KnownDeviceTable)
