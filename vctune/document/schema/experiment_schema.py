"""The [[experiment]] tables of a problem file as written: types, ranges, defaults and documentation of every key."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from vctune.document.schema.fields import Count, NotNegative, Place, Positive, Table, Text

Seed = Annotated[int, Field(strict=True, ge=0, le=2**32 - 1)]


class EnvironmentTable(Table):
    """What is rendered: f_e = mass dv/dt + damping v + stiffness (x - zero); nothing at all is free motion."""

    mass: NotNegative = Field(0.0, description="kg.")
    damping: NotNegative = Field(0.0, description="N s/m.")
    stiffness: NotNegative = Field(0.0, description="N/m.")
    zero: Place = Field(0.0, description="Where the spring is without force, m.")
    wall: bool = Field(False, strict=True, description="Whether damping and stiffness only push.")
    rule: Literal["backward", "trapezoid"] = Field(
        "backward",
        description="How mass and stiffness run: by backward Euler, which damps, or lossless by the trapezoidal rule.",
    )


class SceneOperatorTable(Table):
    """The hand: its mass is on the handle, and a spring and a damper hold it to the intended motion."""

    motion: Literal["reciprocate", "sine"] = Field(
        "reciprocate", description="To and fro at constant speed with turns of a fifth of each stroke, or a sine."
    )
    start: Place = Field(0.0, alias="from", description="One end of the intended motion, where it starts, m.")
    end: Place = Field(0.05, alias="to", description="The other end, m.")
    speed: Positive = Field(0.01, description="Greatest speed of the intended motion, m/s.")
    cycles: Count = Field(3, description="How many times to and fro; the first is not evaluated if there are more.")
    mass: NotNegative = Field(0.0, description="Of what moves as one with the handle, kg.")
    damping: NotNegative = Field(2.0, description="N s/m.")
    stiffness: NotNegative = Field(1000.0, description="N/m.")


class FrictionTable(Table):
    """Friction of the device, LuGre; without this table there is none."""

    coulomb: Positive = Field(description="Sliding friction at high speed, N.")
    stiction: Positive | None = Field(None, description="Sliding friction at vanishing speed, N. Default: coulomb.")
    stribeck_velocity: Positive = Field(0.005, description="Speed at which one becomes the other, m/s.")
    stiffness: Positive = Field(1e5, description="Stiffness of the bristles, N/m.")
    damping: NotNegative | None = Field(
        None,
        description="Damping of the bristles at rest, N s/m; it fades with speed as passivity demands. Default: "
        "sqrt(stiffness times the device's mass).",
    )


class SensorsTable(Table):
    """What the encoder and the force sensor make of handle and hand."""

    position_resolution: NotNegative = Field(0.0, description="Resolution of the encoder, m; 0 for none.")
    force_noise: NotNegative = Field(0.0, description="Standard deviation of a force sample, N.")
    seed: Seed = Field(0, description="Seed of the noise.")


class LimitTable(Table):
    """What the motor can do."""

    limit: Positive | None = Field(None, description="Greatest force, N. Default: none.")


class BaselineTable(Table):
    """A regular PID to compare with: no coupling, but a virtual mass and damping beside the environment."""

    kp: NotNegative = Field(description="Gain on the position error, N/m.")
    ki: NotNegative = Field(0.0, description="Gain on its integral, N/(m s).")
    kd: NotNegative = Field(description="Gain on the velocity error, N s/m.")
    mass: NotNegative = Field(description="Virtual mass, kg.")
    damping: NotNegative = Field(description="Virtual damping, N s/m.")


class ExperimentTable(Table):
    """An experiment for `vctune simulate`; designing does not look at it."""

    name: Text = Field(
        min_length=1,
        max_length=100,
        pattern=r"^[A-Za-z0-9 _.,+-]*$",
        description="Name, unlike that of any other experiment: letters, digits, spaces and _ . , + -",
    )
    environment: EnvironmentTable = Field(default_factory=EnvironmentTable)
    operator: SceneOperatorTable = Field(default_factory=SceneOperatorTable)
    friction: FrictionTable | None = Field(None)
    sensors: SensorsTable = Field(default_factory=SensorsTable)
    actuator: LimitTable = Field(default_factory=LimitTable)
    baseline: BaselineTable | None = Field(None)
