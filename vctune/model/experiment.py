"""Define an experiment and its tables: hand, environment and hardware. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Literal

from pydantic import Field, GetPydanticSchema
from pydantic_core.core_schema import nullable_schema

from vctune.model.fields import Flag, Key, NotNegative, NotNegativeOrNull, Place, Positive, record
from vctune.model.numbers.units import UnitSystem

Motion = Literal["reciprocate", "sine", "kick", "hold"]
MOST_LATE = 10  # Greatest permitted lateness of an environment in samples
# Rule by which the firmware integrates mass and stiffness: backward Euler, which damps, the lossless trapezoidal rule,
# or explicit Euler
Rule = Literal["backward", "trapezoid", "explicit"]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Late = Annotated[int, Field(strict=True, ge=0, le=MOST_LATE)]
Seed = Annotated[int, Field(strict=True, ge=0, le=2**32 - 1)]

# Numbers whose defaults the rest of the problem determines; no finished experiment lacks them
DefaultedPositive = Annotated[Any, GetPydanticSchema(lambda _source, handler: nullable_schema(handler(Positive)))]
DefaultedRule = Annotated[Any, GetPydanticSchema(lambda _source, handler: nullable_schema(handler(Rule)))]
Defaulted = Annotated[Any, GetPydanticSchema(lambda _source, handler: nullable_schema(handler(NotNegative)))]


@record
class Environment:
    """The rendered environment: f_e = mass dv/dt + damping v + stiffness (x - zero). Empty for free motion."""

    mass: Annotated[NotNegative, Key("Mass of the environment, kg.")] = 0.0
    damping: Annotated[NotNegative, Key("Damping of the environment, N s/m.")] = 0.0
    stiffness: Annotated[
        NotNegativeOrNull, Key("Stiffness of the environment, N/m; inf for a rigid one, of an impedance display.")
    ] = 0.0
    zero: Annotated[Place, Key("Position at which the spring has no force, m.")] = 0.0
    wall: Annotated[Flag, Key("Whether damping and stiffness can only push the hand, as a wall does.")] = False
    rule: Annotated[
        DefaultedRule,
        Key(
            "Integration of mass and stiffness: backward Euler, which damps, the lossless trapezoidal rule, or "
            'explicit Euler. Default: "trapezoid" for a mass if the problem has [environment], as it is proved; '
            'else "backward".'
        ),
    ] = None
    late: Annotated[Late, Key("Delay of the environment's force in whole samples.")] = 0

    @property
    def rigid(self) -> bool:
        """Whether the environment does not move where it is met."""
        return self.stiffness == inf

    @property
    def built_in(self) -> bool:
        """Whether the exported firmware can render this environment: it must be on time, not rigid, and not use
        explicit Euler."""
        return self.rule != "explicit" and self.late == 0 and not self.rigid


@record
class MovingHand:
    """The hand: a mass on the handle. A spring and a damper connect this mass to the intended motion."""

    motion: Annotated[
        Motion,
        Key(
            "Intended motion: to and fro at constant speed, with a fifth of each stroke for turning, or a sine. "
            '"hold": the hand stays at `to`. "kick": it stays there, and the handle starts at `from` with `speed` '
            "towards it."
        ),
    ] = "reciprocate"
    start: Annotated[Place, Field(alias="from"), Key("Position, m, at which the intended motion starts.")] = 0.0
    end: Annotated[Place, Field(alias="to"), Key("Position, m, of the other end of the motion.")] = 0.05
    speed: Annotated[
        NotNegative, Key("Greatest speed of the intended motion, or speed of the kick, m/s; 0 releases the handle.")
    ] = 0.01
    cycles: Annotated[
        Count,
        Key(
            "Number of cycles to and fro. With more than one cycle, vctune does not evaluate the first. A hand that "
            "stays is simulated for 10 s, of which vctune evaluates the last 2 s."
        ),
    ] = 3
    mass: Annotated[NotNegative, Key("Mass of the hand, rigidly attached to the handle, kg.")] = 0.0
    damping: Annotated[NotNegative, Key("Damping between hand and intended motion, N s/m.")] = 2.0
    stiffness: Annotated[NotNegative, Key("Stiffness between hand and intended motion, N/m.")] = 1000.0

    @property
    def stays(self) -> bool:
        """Whether the hand stays in one place."""
        return self.motion in ("kick", "hold")

    @property
    def travel(self) -> float:
        """The distance that measures a motion, m: from end to end, or what a kick would move in a second."""
        return float(abs(self.end - self.start) or self.speed)


@record
class Friction:
    """Dry friction of the device, or LuGre friction on bristles. Without this table there is `device.friction`."""

    coulomb: Annotated[Positive, Key("Sliding friction at high speed, N.")]
    stiction: Annotated[DefaultedPositive, Key("Sliding friction at vanishing speed, N. Default: coulomb.")] = None
    stribeck_velocity: Annotated[Positive, Key("Speed of the transition from stiction to coulomb, m/s.")] = 0.005
    stiffness: Annotated[
        DefaultedPositive,
        Key("Stiffness of the bristles, N/m. Default: none, the friction is dry; 1e5 if stiction is above coulomb."),
    ] = None
    damping: Annotated[
        Defaulted,
        Key(
            "Damping of the bristles at rest, N s/m. vctune reduces this damping with speed, as passivity requires. "
            "Default: sqrt(stiffness times the device's mass)."
        ),
    ] = None

    @property
    def dry(self) -> bool:
        """Whether there are no bristles: the friction is coulomb, or what stops the handle."""
        return self.stiffness is None


@record
class Sensors:
    """The errors of the encoder and of the force sensor."""

    position_resolution: Annotated[
        Defaulted,
        Key("Resolution of the encoder, m; 0 for no quantisation. Default: device.velocity.resolution, else 0."),
    ] = None
    force_noise: Annotated[NotNegative, Key("Standard deviation of a force sample, N.")] = 0.0
    seed: Annotated[Seed, Key("Seed of the noise.")] = 0


@record
class Baseline:
    """A regular PID for comparison. The PID has a virtual mass and damping instead of a coupling."""

    kp: Annotated[NotNegative, Key("Gain on the position error, N/m.")]
    ki: Annotated[NotNegative, Field(default=0.0), Key("Gain on the integral of the position error, N/(m s).")]
    kd: Annotated[NotNegative, Key("Gain on the velocity error, N s/m.")]
    mass: Annotated[NotNegative, Key("Virtual mass, kg.")]
    damping: Annotated[NotNegative, Key("Virtual damping, N s/m.")]


USUAL_MASS = 0.4  # Mass of a typical linear device, kg


def usual_share(mass: float, units: UnitSystem) -> float:
    """Return the factor that scales the typical hands and walls of a linear device to this device."""
    return 1.0 if units == "linear" else mass / USUAL_MASS


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment in which vctune simulates a design.

    Attributes
    ----------
    name : str
        Name that no other experiment of the problem has.
    environment, operator, sensors : Environment and MovingHand and Sensors
        See `Environment`, `MovingHand` and `Sensors`.
    friction : Friction, optional
        Friction of the device; None without friction and for a servo.
    limit : float, optional
        Greatest force of the actuator, N; None without a limit and for a servo, whose firmware commands no
        force.
    baseline : Baseline, optional
        A regular controller for comparison; None without one.
    """

    name: str
    environment: Environment
    operator: MovingHand
    friction: Friction | None
    sensors: Sensors
    limit: float | None
    baseline: Baseline | None
