"""Define an experiment with all defaults filled in: hand, environment and hardware. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vctune.model.numbers.units import UnitSystem

Motion = Literal["reciprocate", "sine"]
Rule = Literal["backward", "trapezoid", "explicit"]
"""Rule by which the firmware integrates mass and stiffness: backward Euler, which damps, the lossless trapezoidal rule,
or explicit Euler."""


@dataclass(frozen=True, slots=True)
class Environment:
    """The virtual environment f_e = mass dv_e/dt + damping v_e + stiffness (x_e - zero) (paper eq. 2).

    Attributes
    ----------
    mass : mass of the environment, kg
    damping : damping of the environment, N s/m
    stiffness : stiffness of the environment, N/m
    zero : position at which the spring is relaxed, m
    wall : whether damping and stiffness only push, towards negative x
    rule : integration rule in the firmware; "backward" for a wall
    late : number of samples by which the environment's force is late; 0 for a wall
    """

    mass: float
    damping: float
    stiffness: float
    zero: float
    wall: bool
    rule: Rule = "backward"
    late: int = 0

    @property
    def built_in(self) -> bool:
        """Whether the exported firmware can render this environment: it must be on time and not use explicit Euler."""
        return self.rule != "explicit" and self.late == 0


@dataclass(frozen=True, slots=True)
class Operator:
    """A hand: a mass on the handle. A spring and a damper connect the mass to an intended motion.

    Attributes
    ----------
    motion : waveform of the intended to-and-fro motion
    start, end : ends of the intended motion, m
    speed : greatest speed of the intended motion, m/s
    cycles : number of to-and-fro cycles
    mass, damping, stiffness : mass, damping and stiffness of the hand, kg, N s/m, N/m
    dwell : time from one change of the hand to the next, s; None if the hand does not change, or changes at given times
    changes_at : given times at which the hand changes, increasing, s
    other_damping : damping in every other interval between changes, N s/m; None if the damping does not change
    regrip : whether the hand, at each change, lets go and takes hold again where the handle is
    """

    motion: Motion
    start: float
    end: float
    speed: float
    cycles: int
    mass: float
    damping: float
    stiffness: float
    dwell: float | None = None
    changes_at: tuple[float, ...] = ()
    other_damping: float | None = None
    regrip: bool = False

    @property
    def changes(self) -> bool:
        """Whether the hand changes."""
        return self.dwell is not None or bool(self.changes_at)


@dataclass(frozen=True, slots=True)
class Friction:
    """The friction of the device in the LuGre model.

    Attributes
    ----------
    coulomb, stiction : sliding friction at high speed and at vanishing speed, N
    stribeck_velocity : speed at which the friction changes from stiction to coulomb, m/s
    stiffness : stiffness of the bristles, N/m
    damping : damping of the bristles, N s/m
    """

    coulomb: float
    stiction: float
    stribeck_velocity: float
    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class Sensors:
    """Errors of the encoder and the force sensor.

    A servo's firmware reads no encoder, and an impedance display has no force sensor.

    Attributes
    ----------
    position_resolution : resolution of the encoder, m; 0 for an ideal encoder
    force_noise : standard deviation of the noise in each force sample, N
    seed : seed of the noise
    """

    position_resolution: float
    force_noise: float
    seed: int


@dataclass(frozen=True, slots=True)
class Baseline:
    """A regular PID that makes the device follow a virtual mass and damping, without a coupling.

    A servo cannot have one, because a PID commands a force.

    Attributes
    ----------
    kp, ki, kd : gains, N/m, N/(m s), N s/m
    mass, damping : virtual mass and damping, kg, N s/m
    """

    kp: float
    ki: float
    kd: float
    mass: float
    damping: float


USUAL_MASS = 0.4
"""Mass of a typical linear device, kg."""


def usual_share(mass: float, units: UnitSystem) -> float:
    """Return the factor that scales the typical hands and walls of a linear device to this device.

    Typical impedances at a rotary handle depend on the handle's size. A problem file states only the inertia, so the
    inertia determines the factor.

    Parameters
    ----------
    mass : moving mass, kg, or moment of inertia, kg m^2
    units : whether the handle moves along a line or about an axis

    Returns
    -------
    float
        1 for a linear device; the inertia divided by `USUAL_MASS` for a rotary one.
    """
    return 1.0 if units == "linear" else mass / USUAL_MASS


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment in which vctune simulates a design.

    Attributes
    ----------
    name : name that no other experiment of the problem has
    environment, operator, sensors : see `Environment`, `Operator` and `Sensors`
    friction : friction of the device; None without friction and for a servo
    limit : greatest force of the actuator, N; None without a limit and for a servo, whose firmware commands no force
    baseline : a regular controller for comparison; None without one
    """

    name: str
    environment: Environment
    operator: Operator
    friction: Friction | None
    sensors: Sensors
    limit: float | None
    baseline: Baseline | None
