"""Define the schema of the problem file: type, range and documentation of every key (document/README.md, section 1)."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, create_model

from vctune.document.schema.validation import schema_of
from vctune.model.device import Device
from vctune.model.display import DisplayName
from vctune.model.experiment import Baseline, Environment, Friction, MovingHand, Sensors
from vctune.model.fields import (
    DampingRatio,
    Edge,
    Flag,
    Found,
    FoundPositive,
    NotNegative,
    NotNegativeOrInf,
    Positive,
    Share,
    Text,
)
from vctune.model.gains import Coupling, Gains, Rule, SpringDamper
from vctune.model.numbers.units import UnitSystem
from vctune.model.parts import MAY_BE_ZERO, UNCERTAIN, ForceSensor, Servo
from vctune.model.transparency import Terms


class Table(BaseModel):
    """A table that refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class ServoDeviceTable(Table):
    """A device that follows its command with a delay and that the hand cannot push."""

    units: Literal["linear", "rotary"] = Field("linear", description="Kind of motion of the servo, linear or rotary.")
    sample_time: Positive = Field(description="Sample time of the admittance controller, s.")
    servo: Servo
    force_sensor: ForceSensor | None = Field(None, description="Default: the force is sensed without delay.")


def _device_form(value: Any) -> str:
    servo = "servo" in value if isinstance(value, dict) else isinstance(value, ServoDeviceTable)
    return "<servo>" if servo else "<mechanism>"


AnyDeviceTable = Annotated[
    Annotated[Device, Tag("<mechanism>")] | Annotated[ServoDeviceTable, Tag("<servo>")],
    Discriminator(_device_form),
]


class PositiveRange(Table):
    """A range of a value that cannot be 0."""

    min: Positive = Field(description="Least value.")
    max: Positive = Field(description="Greatest value.")


class NotNegativeRange(Table):
    """A range of a value that may be 0."""

    min: NotNegative = Field(0.0, description="Least value.")
    max: NotNegative = Field(description="Greatest value.")


def _form(value: Any) -> str:
    return "<range>" if isinstance(value, dict | Table) else "<number>"


A = TypeVar("A")
B = TypeVar("B")
NumberOrRange = Annotated[Annotated[A, Tag("<number>")] | Annotated[B, Tag("<range>")], Discriminator(_form)]
PositiveVariable = NumberOrRange[Positive, PositiveRange]
Variable = NumberOrRange[NotNegative, NotNegativeRange]
Damping = NumberOrRange[NotNegativeOrInf, NotNegativeRange]


def _uncertain(key: str) -> Any:
    meaning = "; 0.1 means plus or minus 10 %, { min, max } a range of its values" if key == "mass" else ""
    range_ = NotNegativeRange if key in MAY_BE_ZERO else PositiveRange
    return NumberOrRange[Share, range_], Field(0.0, alias=key, description=f"Uncertainty of device.{key}{meaning}.")  # type: ignore[misc, valid-type]


# Table with a relative half-width, or a range, for each parameter of a device that may be uncertain
SharesTable: Any = create_model(
    "SharesTable", __base__=Table, **{key.replace(".", "_"): _uncertain(key) for key in UNCERTAIN}
)


class UncertaintyTable(SharesTable):
    """Intervals of the device's parameters: a number is a relative half-width, { min, max } a range of values.

    The constraints hold for every device whose parameters lie in these intervals. The value in [device] lies in its
    range, whose min is 0 by default if the parameter may be 0.

    To state the uncertainty of a parameter in a sub-table of [device], quote its name,
    as in "actuator.bandwidth_hz" = 0.2.
    """

    unmodelled: list[tuple[Positive, Positive]] = Field(
        default_factory=list,
        description="Unmodelled dynamics, [[Hz, radius], ...]: a relative error of the sampled response, from the held "
        "command to the samples of motion or force, at most the radius at each frequency up to Nyquist. What is "
        "unknown above Nyquist shows in it below. vctune interpolates the radius linearly on logarithmic axes, and "
        "keeps it constant above the last frequency and below the first; of a servo it is proportional to the "
        "frequency below the first.",
    )
    objective: Literal["nominal", "worst"] = Field(
        "nominal",
        description="Error to minimise: the error of the nominal device, or the greatest error at the vertices of the "
        "box.",
    )


class LimitTable(Table):
    """The limits of the motor."""

    limit: Positive | None = Field(None, description="Greatest force, N. Default: no limit.")


class ExperimentTable(Table):
    """An experiment for `vctune simulate`; the design does not depend on it."""

    name: Text = Field(
        min_length=1,
        max_length=100,
        pattern=r"^[A-Za-z0-9 _.,+-]*$",
        description="Unique name of the experiment: letters, digits, spaces and _ . , + -",
    )
    environment: Environment = Environment()
    operator: MovingHand = MovingHand()
    friction: Friction | None = None
    sensors: Sensors = Sensors()
    actuator: LimitTable = LimitTable()
    baseline: Baseline | None = None


class OperatorTable(Table):
    """The hands at the handle, mass s + damping + stiffness/s. { min, max } is a range; a number is that number.

    The criterion "hands" covers every hand within these ranges. The criterion "passive" uses only the least mass and
    damping: they describe a load that is always at the handle, such as a tool. A rotary device has no defaults, because
    the rotary inertia, damping and stiffness of a hand depend on its distance from the axis.
    """

    mass: Variable | None = Field(None, description="Mass M of the hand, kg. Default { min = 0, max = 0.5 }.")
    damping: Variable | None = Field(None, description="Damping B of the hand, N s/m. Default { min = 0, max = 30 }.")
    stiffness: Variable | None = Field(
        None, description="Stiffness K of the hand, N/m. Default { min = 0, max = 3000 }."
    )


class ToolTable(Table):
    """The tool beyond the force sensor or at the handle: a gripper, a load, a handle that is not part of the device.

    It is always there, so that every hand of [operator] includes it, and so does the hand of an experiment. A number
    is that number, { min, max } a range, such as that of a payload.
    """

    mass: Variable = Field(0.0, description="Mass of the tool, kg.")
    damping: Variable = Field(0.0, description="Damping of the tool against rest, N s/m.")


class WorldMassTable(Table):
    """Mass of the environments, kg."""

    min: NotNegative = Field(0.0, description="Least mass, kg.")
    max: NotNegativeOrInf | None = Field(None, description="Greatest mass, kg. Default inf, no limit.")


class WorldDampingTable(Table):
    """Damping of the environments, N s/m, at least `min`; it has no greatest value."""

    min: NotNegative = Field(0.0, description="Least damping, N s/m.")


class WorldStiffnessTable(Table):
    """Stiffness of the environments, N/m."""

    min: NotNegative = Field(0.0, description="Least stiffness, N/m.")
    max: NotNegativeOrInf | None = Field(None, description="Greatest stiffness, N/m. Default inf, no limit.")


class WorldsTable(Table):
    """The environments that the device renders, mass s + damping + stiffness/s.

    With this table, the claims hold for every environment within these ranges, in every hand of [operator]. Without
    this table, they hold for every environment that is passive as it runs in the firmware, including tools of a gram
    and walls of any stiffness.

    For an impedance display the only environment is `stiffness = inf`, a rigid world: the coupling is then a wall.
    """

    mass: NumberOrRange[NotNegative, WorldMassTable] = Field(
        default_factory=WorldMassTable, description="Mass of the environments, kg. A number is that number."
    )
    damping: WorldDampingTable = Field(default_factory=WorldDampingTable)
    stiffness: NumberOrRange[NotNegativeOrInf, WorldStiffnessTable] = Field(
        default_factory=WorldStiffnessTable,
        description="Stiffness of the environments, N/m. A number is that number; inf makes the coupling of an "
        "impedance display a wall of coupling.stiffness and coupling.damping.",
    )
    walls: Flag = Field(
        False,
        description="Whether springs may be walls. The force of a wall depends only on the position, and the "
        "slope of this force is everywhere within the range `stiffness`. A wall is one-sided or piecewise linear, at "
        "any position. A wall does not move, and its damper also acts outside the wall.",
    )
    corner_hz: Positive | None = Field(
        None,
        description="Corner frequency of the multiplier in the proof for walls, Hz. Default: vctune chooses the "
        "frequency with the greatest margin.",
    )


class GainsTable(Table):
    """The velocity loop's law K_v + K_p/s. A number fixes a gain; { min, max } frees it."""

    velocity: Variable | None = Field(
        None,
        description="K_v, N s/m. Default { min = 1e-8 mass/sample_time, max = 2 Z } with Z = mass/tau + damping. "
        "tau is the sum of sample_time/2, delay and the lags of actuator and velocity estimate. The default min "
        "never exceeds 1e-5 Z. For an impedance display K_v is 0 unless the file frees it.",
    )
    position: Variable | None = Field(
        None,
        description="K_p, N/m. Default { min = 0, max = 2 Z/tau } with Z = mass/tau + damping. tau is the sum of "
        "sample_time/2, delay and the lags of actuator and velocity estimate.",
    )


class CouplingTable(Table):
    """The virtual coupling Z_c: damping and mass in series, and a drag in parallel with them.

    For an impedance display, Z_c = damping + stiffness/s. With rule = "euler" it is the law of most robots,
    mass a + drag v = F.
    """

    damping: Damping | None = Field(
        None,
        description="b_c, N s/m. Default { min = 1e-6 Z_0, max = 1e6 Z_0 }. For an impedance display the default "
        "min is 0. For other displays the minimum must be above 0. For a servo, inf makes the coupling rigid, which "
        "is the default with nothing behind it ([environment]), so "
        "that only mass and drag remain, as in the usual admittance controller of a robot.",
    )
    mass: PositiveVariable | None = Field(
        None,
        description="m_c, kg. Default { min = 1e-6 M, max = 1e6 M } with M = Z_0/(2 pi f), where f is the middle of "
        "the transparency band on a log scale.",
    )
    drag: Variable | None = Field(
        None,
        description='b_0, N s/m. Default { min = 0, max = Z_0 } with the criteria "hands" and "both", because a stiff '
        'hand with little damping requires some drag. Default 0 with the criterion "passive", and if the file fixes '
        "gains.velocity, gains.position, coupling.damping and coupling.mass. For a servo, the default is "
        "{ min = 0, max = 1e3 Z_0 } with every criterion.",
    )
    rule: Rule = Field(
        "trapezoid",
        description='How the firmware of a servo integrates the coupling. "euler": v += sample_time (F - drag v)/mass, '
        "the law of most robots; mass and drag are the numbers of that law, without damping in series. A position "
        "command is x += sample_time v. "
        '"trapezoid": as exported by vctune.',
    )
    stiffness: PositiveVariable | None = Field(
        None,
        description="k_c of an impedance display, N/m. Default { min = 1e-6 K, max = 1e6 K } with K = 2 pi f Z_0, "
        "where f is the middle of the transparency band.",
    )


class TransparencyTable(Table):
    """The objective: the distance from G_hh = 0, G_he = 1, Z_c = 0 over a band."""

    band_hz: tuple[Positive, Positive] | None = Field(
        None,
        description="Band, Hz. Default [0.00025/tau, 0.015/tau]: 0.5 to 30 Hz at 1 kHz without delay. "
        "For a servo, [0.005/tau, 0.1/tau], where tau is the lag of hold, delay, low-pass and interpolation.",
    )
    reference_impedance: Positive | None = Field(
        None,
        description="Z_0, N s/m. Default 2 pi f mass, the impedance of the device's own mass at the middle f of the "
        "band on a log scale. For a servo, the greatest of stiffness tau, damping and mass/tau of the greatest hand.",
    )
    norm: Literal["rms", "peak"] = Field(
        "rms", description="Norm of the error: root mean square over log frequency, or the greatest value."
    )
    weights: Terms = Field(default_factory=Terms)


class StabilityTable(Table):
    """The constraints: stability in the hands of [operator], Llewellyn's conditions on a band, and a bound on |S|."""

    band_hz: tuple[Edge, Edge] | None = Field(
        None,
        description="Band, Hz. Default: from the lower edge of the transparency band to 0.05/tau, which is a tenth of "
        "the sampling rate if there is no delay; for an impedance display and for a servo, to the Nyquist frequency. "
        "The lower edge may be 0. The upper edge may be inf for an ideal "
        'device with hold "lag" and no delay.',
    )
    safety_factor: Positive = Field(
        1.05,
        description="Least permitted ratio Re Z_c / R, at least 1. A ratio of 1 leaves no reserve. vctune "
        "refuses gains with a smaller ratio.",
    )
    max_sensitivity: Positive = Field(
        2.0,
        description="Greatest permitted |S| of the exact sampled velocity loop, up to the Nyquist frequency; without "
        "effect on a servo, and on the loop that a wall closes.",
    )
    criterion: Literal["passive", "hands", "both"] = Field(
        "both",
        description='Set of hands for which vctune proves stability. "passive": any passive hand, on band_hz. '
        '"hands": every hand of [operator], in the sampled loop at every frequency. "both": both claims; on band_hz '
        'it also covers hands that change in a passive way, which "hands" alone does not. The default is "hands" for a '
        "servo and for a file with [environment]. The environment is any passive one or, if the file has "
        "[environment], any one in its box; of such boxes only that of nothing (mass.max = 0, stiffness.max = 0) "
        'allows "passive" and "both".',
    )
    rest: Flag = Field(
        False,
        description="Whether the device must rest wherever it stops: the force of one step of "
        "device.velocity.resolution may be at most twice device.friction. This limits coupling.stiffness of an "
        "impedance display and gains.position of an admittance display.",
    )
    calm: Flag = Field(
        False,
        description="Whether no kick may keep a wall moving: a fixed set of kicks is simulated, with device.friction "
        "and the steps of device.velocity.resolution. It is simulated, not proved.",
    )
    damping_ratio: DampingRatio | None = Field(
        None,
        description="Least damping ratio, up to 0.7, of every oscillation in the hands of [operator] with the "
        "environments of [environment], proved for a servo, and for a wall of an impedance display in its hands.",
    )


class ProblemDocument(Table):
    """A vctune problem file. Only mass, damping and sample_time in [device] are required.

    For a servo, only sample_time and servo are required.
    """

    name: Text | None = Field(
        None,
        min_length=1,
        max_length=200,
        description="Name of the design and of its folder. Default: the file's stem.",
    )
    description: Text = Field("", description="Free text for the reader.")
    device: AnyDeviceTable
    operator: OperatorTable | None = Field(None, description="Default: human hands, from no hand to a firm grip.")
    tool: ToolTable | None = Field(None, description="Default: no tool.")
    environment: WorldsTable | None = None
    gains: GainsTable = Field(default_factory=GainsTable)
    coupling: CouplingTable = Field(default_factory=CouplingTable)
    transparency: TransparencyTable = Field(default_factory=TransparencyTable)
    stability: StabilityTable = Field(default_factory=StabilityTable)
    uncertainty: UncertaintyTable = Field(default_factory=UncertaintyTable)
    experiment: list[ExperimentTable] = Field(
        default_factory=list, description="Experiments for `vctune simulate`; the design does not depend on them."
    )


class OriginTable(Table):
    """The origin of the gains, and the device that they are designed for. vctune treats any other key as a remark."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Text] = Field(init=False)

    display: DisplayName | None = Field(
        None, description="Kind of display that the gains are designed for. Default: derived from [coupling]."
    )
    units: UnitSystem | None = Field(None, description="Units of the gains. Default: the units of the problem.")
    sha256: Text | None = Field(
        None,
        description="Digest of the problem with all its defaults, without comments, name, description and experiments.",
    )
    numbers: Text | None = Field(None, description="Values of the solved gains and coupling, in the order of the file.")
    corner_hz: Positive | None = Field(
        None, description="Corner frequency of the multiplier that proved the walls, Hz."
    )


class GainsDocument(Table):
    """A vctune gains file: a design as plain numbers, and its origin."""

    gains: Gains
    coupling: Coupling
    design: OriginTable = Field(default_factory=OriginTable)


class SteppedTable(Table):
    """The law mass a + drag v = F, integrated by Euler's rule."""

    rule: Literal["euler"] = Field(description="The rule.")
    mass: FoundPositive = Field(description="Mass M, kg.")
    drag: Found = Field(description="Drag D, N s/m.")


def _law(value: Any) -> str:
    return "<euler>" if isinstance(value, dict | SteppedTable) and "rule" in dict(value) else "<trapezoid>"


def _without_usual_rule(value: Any) -> Any:
    usual = isinstance(value, dict) and value.get("rule") == "trapezoid"
    return {key: number for key, number in value.items() if key != "rule"} if usual else value


class ServoGainsDocument(Table):
    """A vctune gains file of a servo, which has a coupling but no gains."""

    coupling: Annotated[
        Annotated[Coupling, Tag("<trapezoid>")] | Annotated[SteppedTable, Tag("<euler>")],
        Discriminator(_law),
        BeforeValidator(_without_usual_rule),
    ]
    design: OriginTable = Field(default_factory=OriginTable)


class FixedVelocityTable(Table):
    """Gains of a gains file of an impedance display."""

    velocity: NotNegative = Field(0.0, description="K_v, N s/m.")


class SpringGainsDocument(Table):
    """A vctune gains file of an impedance display."""

    gains: FixedVelocityTable = Field(default_factory=FixedVelocityTable)
    coupling: SpringDamper
    design: OriginTable = Field(default_factory=OriginTable)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the problem file."""
    return schema_of(ProblemDocument, "vctune problem")
