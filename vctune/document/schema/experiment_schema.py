"""Define the schema of the [[experiment]] tables: type, range, default and documentation of every key."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from vctune.document.schema.fields import Count, Late, NotNegative, Place, Positive, Table, Text
from vctune.model.experiment import Rule

Seed = Annotated[int, Field(strict=True, ge=0, le=2**32 - 1)]


class EnvironmentTable(Table):
    """The rendered environment: f_e = mass dv/dt + damping v + stiffness (x - zero). Empty for free motion."""

    mass: NotNegative = Field(0.0, description="Mass of the environment, kg.")
    damping: NotNegative = Field(0.0, description="Damping of the environment, N s/m.")
    stiffness: NotNegative = Field(0.0, description="Stiffness of the environment, N/m.")
    zero: Place = Field(0.0, description="Position at which the spring has no force, m.")
    wall: bool = Field(
        False, strict=True, description="Whether damping and stiffness can only push the hand, as a wall does."
    )
    rule: Rule = Field(
        "backward",
        description="Integration of mass and stiffness: backward Euler, which damps, the lossless trapezoidal rule, or "
        "explicit Euler.",
    )
    late: Late = Field(0, description="Delay of the environment's force in whole samples.")


class SceneOperatorTable(Table):
    """The hand: a mass on the handle. A spring and a damper connect this mass to the intended motion."""

    motion: Literal["reciprocate", "sine"] = Field(
        "reciprocate",
        description="Intended motion: to and fro at constant speed, with a fifth of each stroke for turning, or a "
        "sine.",
    )
    start: Place = Field(0.0, alias="from", description="Position, m, at which the intended motion starts.")
    end: Place = Field(0.05, alias="to", description="Position, m, of the other end of the motion.")
    speed: Positive = Field(0.01, description="Greatest speed of the intended motion, m/s.")
    cycles: Count = Field(
        3, description="Number of cycles to and fro. With more than one cycle, vctune does not evaluate the first."
    )
    mass: NotNegative = Field(0.0, description="Mass of the hand, rigidly attached to the handle, kg.")
    damping: NotNegative = Field(2.0, description="Damping between hand and intended motion, N s/m.")
    stiffness: NotNegative = Field(1000.0, description="Stiffness between hand and intended motion, N/m.")


class FrictionTable(Table):
    """LuGre friction of the device. Without this table there is no friction."""

    coulomb: Positive = Field(description="Sliding friction at high speed, N.")
    stiction: Positive | None = Field(None, description="Sliding friction at vanishing speed, N. Default: coulomb.")
    stribeck_velocity: Positive = Field(0.005, description="Speed of the transition from stiction to coulomb, m/s.")
    stiffness: Positive = Field(1e5, description="Stiffness of the bristles, N/m.")
    damping: NotNegative | None = Field(
        None,
        description="Damping of the bristles at rest, N s/m. vctune reduces this damping with speed, as "
        "passivity requires. Default: sqrt(stiffness times the device's mass).",
    )


class SensorsTable(Table):
    """The errors of the encoder and of the force sensor."""

    position_resolution: NotNegative = Field(0.0, description="Resolution of the encoder, m; 0 for no quantisation.")
    force_noise: NotNegative = Field(0.0, description="Standard deviation of a force sample, N.")
    seed: Seed = Field(0, description="Seed of the noise.")


class LimitTable(Table):
    """The limits of the motor."""

    limit: Positive | None = Field(None, description="Greatest force, N. Default: no limit.")


class BaselineTable(Table):
    """A regular PID for comparison. The PID has a virtual mass and damping instead of a coupling."""

    kp: NotNegative = Field(description="Gain on the position error, N/m.")
    ki: NotNegative = Field(0.0, description="Gain on the integral of the position error, N/(m s).")
    kd: NotNegative = Field(description="Gain on the velocity error, N s/m.")
    mass: NotNegative = Field(description="Virtual mass, kg.")
    damping: NotNegative = Field(description="Virtual damping, N s/m.")


class ExperimentTable(Table):
    """An experiment for `vctune simulate`; the design does not depend on it."""

    name: Text = Field(
        min_length=1,
        max_length=100,
        pattern=r"^[A-Za-z0-9 _.,+-]*$",
        description="Unique name of the experiment: letters, digits, spaces and _ . , + -",
    )
    environment: EnvironmentTable = Field(default_factory=EnvironmentTable)
    operator: SceneOperatorTable = Field(default_factory=SceneOperatorTable)
    friction: FrictionTable | None = Field(None)
    sensors: SensorsTable = Field(default_factory=SensorsTable)
    actuator: LimitTable = Field(default_factory=LimitTable)
    baseline: BaselineTable | None = Field(None)
