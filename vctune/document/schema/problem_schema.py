"""The problem file as written: types, ranges and documentation of every key (document/README.md, section 1).

`vctune schema` prints the JSON Schema made from it.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from vctune.document.schema.experiment_schema import ExperimentTable
from vctune.document.schema.fields import (
    Edge,
    NotNegative,
    NotNegativeOrInf,
    Portion,
    Positive,
    PositiveOrInf,
    Share,
    Table,
    Text,
)
from vctune.model.display import DisplayName
from vctune.model.numbers.units import UnitSystem


class PositiveRange(Table):
    """Bounds of a free variable that cannot be 0."""

    min: Positive
    max: Positive


class NotNegativeRange(Table):
    """Bounds of a free variable that may be 0."""

    min: NotNegative
    max: NotNegative


def _form(value: Any) -> str:
    return "<range>" if isinstance(value, dict | Table) else "<number>"


PositiveVariable = Annotated[
    Annotated[Positive, Tag("<number>")] | Annotated[PositiveRange, Tag("<range>")], Discriminator(_form)
]
Variable = Annotated[
    Annotated[NotNegative, Tag("<number>")] | Annotated[NotNegativeRange, Tag("<range>")], Discriminator(_form)
]
Damping = Annotated[
    Annotated[NotNegativeOrInf, Tag("<number>")] | Annotated[NotNegativeRange, Tag("<range>")], Discriminator(_form)
]


Order = Annotated[int, Field(strict=True, ge=1, le=2)]


class VelocityTable(Table):
    """How the firmware knows the velocity of the motor."""

    source: Literal["measured", "difference"] | None = Field(
        None,
        alias="from",
        description="A sensor of its own, or the backward difference of the sampled position. Default: measured, of an "
        "impedance display the difference, which is what it has.",
    )
    filter_hz: Positive | None = Field(
        None,
        description="Corner f of the firmware's low-pass y += a (x - y), a = 1 - e^(-2 pi f T), Hz. Default: none.",
    )
    filter_order: Order = Field(1, description="How many such low-passes follow one another, 1 or 2.")


class ActuatorTable(Table):
    """What the motor makes of its command."""

    bandwidth_hz: Positive = Field(description="Bandwidth of the force (current) loop, Hz.")
    order: Order = Field(1, description="1: w/(s + w); 2: w^2/(s^2 + sqrt(2) w s + w^2), with w = 2 pi bandwidth_hz.")


class ForceSensorTable(Table):
    """What is sensed of the hand's force."""

    bandwidth_hz: Positive | None = Field(
        None, description="Bandwidth of sensor and filter, Hz, as the actuator's. Default: none."
    )
    order: Order = Field(1, description="Of the low-pass, 1 or 2.")
    delay: NotNegative = Field(0.0, description="Until the firmware has the sample, s; at most 200 sample times.")


class StructureTable(Table):
    """A handle on a spring: the motor's part, with all of the device's damping, is measured and driven."""

    handle_mass: Positive = Field(description="Of device.mass, what is on the handle's side of the spring, kg.")
    frequency_hz: Positive = Field(description="Of the free resonance, both parts against each other, Hz.")
    damping_ratio: NotNegative = Field(description="Of that resonance.")


class ServoTable(Table):
    """A closed loop that follows a command late, such as a robot's under its vendor's controller."""

    command: Literal["velocity", "position"] = Field(
        "velocity", description="What it is sent: a velocity, held over a sample, or a position, interpolated over it."
    )
    delay: NotNegative = Field(
        description="From sampling to motion beyond the hold, s; at most 200 sample times, an uncertain one too."
    )
    bandwidth_hz: Positive = Field(description="Bandwidth of the motion that follows the late command, Hz.")
    order: Order = Field(1, description="Order of that low-pass, 1 or 2, as the actuator's.")
    stiffness: Positive | None = Field(
        None,
        description="Of the firmware's spring between the measured position and its reference, N/m; no force sensor is "
        "in its way. Default: none.",
    )


class ServoSensorTable(ForceSensorTable):
    """What is sensed of the hand's force, and filtered by the admittance controller."""

    filter_coefficient: Portion | None = Field(
        None, description="a of the controller's filter y += a (x - y) of the samples, 0 < a <= 1. Default: no filter."
    )


class ServoDeviceTable(Table):
    """A device that follows its command late, and which the hand cannot push."""

    units: Literal["linear", "rotary"] = Field("linear", description="How it moves, as of any other device.")
    sample_time: Positive = Field(description="Sample time of the admittance controller, s.")
    servo: ServoTable
    force_sensor: ServoSensorTable | None = Field(None, description="Default: the force is sensed at once.")


class DeviceTable(Table):
    """The mechanism: Z_d = mass s + damping."""

    display: Literal["admittance", "impedance"] = Field(
        "admittance",
        description="What it makes of what: a velocity of the sensed force, or a force of the measured motion.",
    )
    units: Literal["linear", "rotary"] = Field(
        "linear",
        description="How the handle moves. Of a rotary device, a wheel or a knob, every kg, m and N of this file is a "
        "kg m2, a rad and an N m, and mass is the moment of inertia: keys keep their names.",
    )
    mass: Positive = Field(description="Moving mass, kg.")
    damping: NotNegative = Field(description="Viscous damping, N s/m.")
    sample_time: Positive = Field(description="Sample time of the velocity loop, s.")
    hold: Literal["zoh", "lag"] = Field(
        "zoh", description="Hold: exact zero-order hold, or the paper's first-order lag 2/(2+sT)."
    )
    delay: NotNegative = Field(
        0.0,
        description="Delay from sampling to actuation beyond the hold, s; at most 200 sample times, the longest of an "
        "uncertain one too.",
    )
    velocity: VelocityTable | None = Field(None, description="Default: measured, at once.")
    actuator: ActuatorTable | None = Field(None, description="Default: the force follows the command at once.")
    force_sensor: ForceSensorTable | None = Field(None, description="Default: the force is sensed at once.")
    structure: StructureTable | None = Field(None, description="Default: rigid.")


def _device_form(value: Any) -> str:
    servo = "servo" in value if isinstance(value, dict) else isinstance(value, ServoDeviceTable)
    return "<servo>" if servo else "<mechanism>"


AnyDeviceTable = Annotated[
    Annotated[DeviceTable, Tag("<mechanism>")] | Annotated[ServoDeviceTable, Tag("<servo>")],
    Discriminator(_device_form),
]


class OperatorTable(Table):
    """The hands at the handle, mass s + damping + stiffness/s. { min, max } is a range, a number its least.

    The least mass and damping are those of what is always there, a grip or a tool, which the passive criterion counts;
    the ranges are the hands of the criterion "hands". Of a rotary device, where they depend on how far from the axis it
    is held, they have no defaults.
    """

    # a plain number is the least of a range whose greatest is a human hand's (`defaults.resolve`), so that the 0.0 of a
    # key that is left out means { min = 0, max = 0.5 } for the mass, as its description says
    mass: Variable = Field(0.0, description="M, kg. Default { min = 0, max = 0.5 }.")
    damping: Variable = Field(0.0, description="B, N s/m. Default { min = 0, max = 30 }.")
    stiffness: Variable = Field(0.0, description="K, N/m. Default { min = 0, max = 3000 }.")


class WorldMassTable(Table):
    """Their mass, kg."""

    min: NotNegative = Field(0.0, description="The least, kg.")
    max: NotNegativeOrInf | None = Field(None, description="The greatest, kg. Default inf, no limit.")


class WorldDampingTable(Table):
    """Their damping, N s/m, which has no upper limit."""

    min: NotNegative = Field(0.0, description="The least, N s/m.")


class WorldStiffnessTable(Table):
    """Their stiffness, N/m."""

    min: NotNegative = Field(0.0, description="The least, N/m.")
    max: NotNegativeOrInf | None = Field(None, description="The greatest, N/m. Default inf, no limit.")


class WorldsTable(Table):
    """The environments that are rendered, mass s + damping + stiffness/s by the trapezoidal rule.

    Every one of the box is met in every hand of [operator]. Without this table it is every environment that is passive
    as it runs, tools of a gram and walls of any stiffness among them.
    """

    mass: WorldMassTable = Field(default_factory=WorldMassTable)
    damping: WorldDampingTable = Field(default_factory=WorldDampingTable)
    stiffness: WorldStiffnessTable = Field(default_factory=WorldStiffnessTable)
    walls: bool = Field(
        False,
        strict=True,
        description="Whether springs may be walls: a force that depends on the position alone and rises with slopes of "
        "the range of stiffness, one-sided or piecewise linear, anywhere. They do not move; no damper is one-sided.",
    )
    corner_hz: Positive | None = Field(
        None, description="Corner of the multiplier that proves the walls, Hz. Default: the one with the most room."
    )


class GainsTable(Table):
    """The velocity loop's law K_v + K_p/s. A number fixes a gain, { min, max } frees it."""

    velocity: Variable | None = Field(
        None,
        description="K_v, N s/m. Default { min = 1e-8 mass/sample_time, max = 2 Z } with Z = mass/tau + damping and "
        "tau = sample_time/2 + delay and the lags of actuator and velocity estimate; min is at most 1e-5 Z.",
    )
    position: Variable | None = Field(None, description="K_p, N/m. Default { min = 0, max = 2 Z/tau }.")


class CouplingTable(Table):
    """The virtual coupling Z_c = drag + damping and mass in series, of an impedance display damping + stiffness/s."""

    damping: Damping | None = Field(
        None,
        description="b_c, N s/m. Default { min = 1e-6 Z_0, max = 1e6 Z_0 }, of an impedance display from 0, which no "
        "other has. inf makes the coupling of a servo rigid: mass and drag alone, the usual admittance law of robots.",
    )
    mass: PositiveVariable | None = Field(
        None,
        description="m_c, kg. Default { min = 1e-6 M, max = 1e6 M } with M = Z_0/(2 pi f) and f the middle of the "
        "transparency band on a log scale.",
    )
    drag: Variable | None = Field(
        None,
        description="b_0, N s/m. Default { min = 0, max = Z_0 } where hands are to be met, since a stiff and hardly "
        'damped one needs some, and 0 with the criterion "passive" or where the other four numbers are fixed.',
    )
    stiffness: PositiveVariable | None = Field(
        None,
        description="k_c of an impedance display, N/m. Default { min = 1e-6 K, max = 1e6 K } with K = 2 pi f Z_0 and f "
        "the middle of the transparency band.",
    )


class WeightsTable(Table):
    """Weights of the three terms of the error; a term with weight 0 is left out."""

    admittance: NotNegative = Field(1.0, description="Weight of Z_0 |G_hh|, of an impedance display of |1/G_hh|/Z_0.")
    tracking: NotNegative = Field(1.0, description="Weight of |1 - G_he|, of an impedance display of |1 - A H/N|.")
    coupling: NotNegative = Field(1.0, description="Weight of |Z_c|/Z_0, of an impedance display of Z_0 |1/Z_c|.")


class TransparencyTable(Table):
    """The objective: distance from G_hh = 0, G_he = 1, Z_c = 0 over a band."""

    band_hz: tuple[Positive, Positive] | None = Field(
        None, description="Band, Hz. Default [0.00025/tau, 0.015/tau]: 0.5 to 30 Hz at 1 kHz without delay."
    )
    reference_impedance: Positive | None = Field(
        None,
        description="Z_0, N s/m. Default mass 2 pi f: the device's own inertia at the middle f of the band on a log "
        "scale.",
    )
    norm: Literal["rms", "peak"] = Field("rms", description="Average over log frequency, or the greatest value.")
    weights: WeightsTable = Field(default_factory=WeightsTable)


class StabilityTable(Table):
    """The demands: stability in the hands of [operator], Llewellyn's conditions on a band, and a bound on |S|."""

    band_hz: tuple[Edge, Edge] | None = Field(
        None,
        description="Band, Hz. Default: the transparency band's lower edge to 0.05/tau, a tenth of the sampling rate "
        'without delay. The lower edge may be 0, the upper inf with hold "lag", no delay and an ideal device.',
    )
    safety_factor: Positive = Field(
        1.05, description="Least Re Z_c / R on the band, at least 1. Gains below it are refused; 1 asks for no reserve."
    )
    max_sensitivity: Positive = Field(
        2.0, description="Greatest |S| of the exact sampled loop, up to the Nyquist frequency."
    )
    criterion: Literal["passive", "hands", "both"] = Field(
        "both",
        description='"passive": any passive hand, on band_hz. "hands": every hand of [operator] with every passive '
        'environment, or every one of [environment], in the sampled loop at every frequency. Default "hands" of a '
        "servo and with [environment].",
    )


class UncertaintyTable(Table):
    """How far the device may be from its numbers: relative half-widths; the demands hold for every device within.

    A number of a part of the device is named in quotes, "actuator.bandwidth_hz" = 0.2.
    """

    mass: Share = Field(0.0, description="Of device.mass; 0.1 means plus or minus 10 %.")
    damping: Share = Field(0.0, description="Of device.damping.")
    delay: Share = Field(0.0, description="Of device.delay.")
    velocity_filter_hz: Share = Field(0.0, alias="velocity.filter_hz", description="Of device.velocity.filter_hz.")
    actuator_bandwidth_hz: Share = Field(
        0.0, alias="actuator.bandwidth_hz", description="Of device.actuator.bandwidth_hz."
    )
    force_sensor_bandwidth_hz: Share = Field(
        0.0, alias="force_sensor.bandwidth_hz", description="Of device.force_sensor.bandwidth_hz."
    )
    force_sensor_delay: Share = Field(0.0, alias="force_sensor.delay", description="Of device.force_sensor.delay.")
    structure_handle_mass: Share = Field(
        0.0, alias="structure.handle_mass", description="Of device.structure.handle_mass."
    )
    structure_frequency_hz: Share = Field(
        0.0, alias="structure.frequency_hz", description="Of device.structure.frequency_hz."
    )
    structure_damping_ratio: Share = Field(
        0.0, alias="structure.damping_ratio", description="Of device.structure.damping_ratio."
    )
    servo_delay: Share = Field(0.0, alias="servo.delay", description="Of device.servo.delay.")
    servo_bandwidth_hz: Share = Field(0.0, alias="servo.bandwidth_hz", description="Of device.servo.bandwidth_hz.")
    unmodelled: list[tuple[Positive, Positive]] = Field(
        default_factory=list,
        description="What is not modelled: [[Hz, radius], ...], a disc around 1 by which the device's response may be "
        "multiplied; straight between the frequencies on logarithmic axes, constant beyond.",
    )
    objective: Literal["nominal", "worst"] = Field(
        "nominal", description="Whose error is least: the device's own, or the greatest at the corners of the box."
    )


class AxisTable(Table):
    """One of several axes that do not couple: a problem of the file's tables and of these, which override them."""

    name: Text = Field(description='Name of the axis and of its folder, such as "x".')
    device: dict[str, Any] = Field(default_factory=dict, description="Keys of [device] that this axis has otherwise.")
    operator: dict[str, Any] = Field(default_factory=dict, description="Keys of [operator], likewise.")
    gains: dict[str, Any] = Field(default_factory=dict, description="Keys of [gains], likewise.")
    coupling: dict[str, Any] = Field(default_factory=dict, description="Keys of [coupling], likewise.")
    transparency: dict[str, Any] = Field(default_factory=dict, description="Keys of [transparency], likewise.")
    stability: dict[str, Any] = Field(default_factory=dict, description="Keys of [stability], likewise.")
    uncertainty: dict[str, Any] = Field(default_factory=dict, description="Keys of [uncertainty], likewise.")


class ProblemDocument(Table):
    """A vctune problem file. Only [device] mass, damping and sample_time are required, or sample_time and servo."""

    name: Text | None = Field(
        None,
        min_length=1,
        max_length=200,
        description="Name of the design and of its folder. Default: the file's stem.",
    )
    description: Text = Field("", description="Free text for the reader.")
    device: AnyDeviceTable
    operator: OperatorTable | None = Field(None, description="Default: a human hand, from none to a firm grip.")
    environment: WorldsTable | None = Field(
        None, description="Default: every environment that is passive as the firmware runs it."
    )
    gains: GainsTable = Field(default_factory=GainsTable)
    coupling: CouplingTable = Field(default_factory=CouplingTable)
    transparency: TransparencyTable = Field(default_factory=TransparencyTable)
    stability: StabilityTable = Field(default_factory=StabilityTable)
    uncertainty: UncertaintyTable = Field(default_factory=UncertaintyTable)
    experiment: list[ExperimentTable] = Field(
        default_factory=list, description="Experiments for `vctune simulate`; designing does not look at them."
    )
    axis: list[AxisTable] = Field(
        default_factory=list, description="Several axes that do not couple, each of which is designed by itself."
    )


class FixedGainsTable(Table):
    """Gains of a gains file."""

    velocity: NotNegative = Field(description="K_v, N s/m.")
    position: NotNegative = Field(description="K_p, N/m.")


class FixedCouplingTable(Table):
    """Coupling of a gains file."""

    damping: PositiveOrInf = Field(description="b_c, N s/m; inf for mass and drag alone.")
    mass: Positive = Field(description="m_c, kg.")
    drag: NotNegative = Field(0.0, description="b_0, N s/m.")


class OriginTable(Table):
    """Where gains come from, and for which kind of device they are; any other key is a remark."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Text] = Field(init=False)

    display: DisplayName | None = Field(
        None, description="Display that the gains are for. Default: told from [coupling]."
    )
    units: UnitSystem | None = Field(None, description="Units that the gains are in. Default: those of the problem.")
    sha256: Text | None = Field(
        None,
        description="Digest of what the problem means: resolved, without comments, name, description and experiments.",
    )
    numbers: Text | None = Field(None, description="The design's numbers as they were solved, in their order.")
    corner_hz: Positive | None = Field(None, description="Corner of the multiplier that proved its walls, Hz.")


class GainsDocument(Table):
    """A vctune gains file: a design as plain numbers, and where it comes from."""

    gains: FixedGainsTable
    coupling: FixedCouplingTable
    design: OriginTable = Field(default_factory=OriginTable)


class ServoGainsDocument(Table):
    """A vctune gains file of a servo, which has no gains but a coupling."""

    coupling: FixedCouplingTable
    design: OriginTable = Field(default_factory=OriginTable)


class FixedVelocityTable(Table):
    """Gains of a gains file of an impedance display."""

    velocity: NotNegative = Field(0.0, description="K_v, N s/m.")


class FixedSpringTable(Table):
    """Coupling of a gains file of an impedance display."""

    damping: NotNegative = Field(description="b_c, N s/m.")
    stiffness: Positive = Field(description="k_c, N/m.")


class SpringGainsDocument(Table):
    """A vctune gains file of an impedance display."""

    gains: FixedVelocityTable = Field(default_factory=FixedVelocityTable)
    coupling: FixedSpringTable
    design: OriginTable = Field(default_factory=OriginTable)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the problem file."""
    return schema_of(ProblemDocument, "vctune problem")


def schema_of(document: type[BaseModel], title: str) -> dict[str, Any]:
    """Return the JSON Schema of a document, without what pydantic says of keys that may be left out.

    Parameters
    ----------
    document : its class
    title : of the schema
    """
    schema = document.model_json_schema()
    definitions = schema.pop("$defs")
    for table in (schema, *definitions.values()):
        for key in table.get("properties", {}).values():
            if key.get("default", ...) is None:
                del key["default"]
                key.update(next(form for form in key.pop("anyOf") if form.get("type") != "null"))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": title,
        "$defs": definitions,
    }
