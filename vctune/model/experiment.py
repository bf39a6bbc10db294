"""Define an experiment with all defaults filled in: hand, environment and hardware. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vctune.model.numbers.units import UnitSystem

Motion = Literal["reciprocate", "sine"]
MOST_LATE = 10  # Greatest permitted lateness of an environment in samples
# Rule by which the firmware integrates mass and stiffness: backward Euler, which damps, the lossless trapezoidal rule,
# or explicit Euler
Rule = Literal["backward", "trapezoid", "explicit"]


@dataclass(frozen=True, slots=True)
class Environment:
    """The virtual environment f_e = mass dv_e/dt + damping v_e + stiffness (x_e - zero) (paper eq. 2)."""

    mass: float  # mass of the environment, kg
    damping: float  # damping of the environment, N s/m
    stiffness: float  # stiffness of the environment, N/m
    zero: float  # position at which the spring is relaxed, m
    wall: bool  # whether damping and stiffness only push, towards negative x
    rule: Rule = "backward"  # integration rule in the firmware; "backward" for a wall
    late: int = 0  # number of samples by which the environment's force is late; 0 for a wall

    @property
    def built_in(self) -> bool:
        """Whether the exported firmware can render this environment: it must be on time and not use explicit Euler."""
        return self.rule != "explicit" and self.late == 0


@dataclass(frozen=True, slots=True)
class Operator:
    """A hand: a mass on the handle. A spring and a damper connect the mass to an intended motion."""

    motion: Motion  # waveform of the intended to-and-fro motion
    start: float  # ends of the intended motion, m
    end: float
    speed: float  # greatest speed of the intended motion, m/s
    cycles: int  # number of to-and-fro cycles
    mass: float  # mass, damping and stiffness of the hand, kg, N s/m, N/m
    damping: float
    stiffness: float


@dataclass(frozen=True, slots=True)
class Friction:
    """The friction of the device in the LuGre model."""

    coulomb: float  # sliding friction at high speed and at vanishing speed, N
    stiction: float
    stribeck_velocity: float  # speed at which the friction changes from stiction to coulomb, m/s
    stiffness: float  # stiffness of the bristles, N/m
    damping: float  # damping of the bristles, N s/m


@dataclass(frozen=True, slots=True)
class Sensors:
    """Errors of the encoder and the force sensor."""

    position_resolution: float  # resolution of the encoder, m; 0 for an ideal encoder
    force_noise: float  # standard deviation of the noise in each force sample, N
    seed: int  # seed of the noise


@dataclass(frozen=True, slots=True)
class Baseline:
    """A regular PID that makes the device follow a virtual mass and damping, without a coupling."""

    kp: float  # gains, N/m, N/(m s), N s/m
    ki: float
    kd: float
    mass: float  # virtual mass and damping, kg, N s/m
    damping: float


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
    environment, operator, sensors : Environment and Operator and Sensors
        See `Environment`, `Operator` and `Sensors`.
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
    operator: Operator
    friction: Friction | None
    sensors: Sensors
    limit: float | None
    baseline: Baseline | None
