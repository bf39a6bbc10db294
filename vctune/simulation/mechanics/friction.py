"""Model LuGre friction (Canudas de Wit, Olsson, Astrom, Lischinsky 1995), and integrate it with a dedicated step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.experiment import Friction
from vctune.model.numbers.arithmetic import Number
from vctune.simulation.firmware.operations import Arithmetic

SERIES_BELOW = 0.01  # Argument y at which the code changes from the series of phi_2 to its formula


def relaxation(friction: Friction, velocity: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return a(v) [1/s] and damping(v) [N s/m]."""
    speed = ops.absolute(velocity)
    g = friction.coulomb
    if friction.stiction > friction.coulomb:
        ratio = velocity / friction.stribeck_velocity
        g = g + (friction.stiction - friction.coulomb) * ops.exp(-ratio * ratio)
    return friction.stiffness * speed / g, friction.damping / (1 + friction.damping * speed / (4 * friction.coulomb))


def friction_force(friction: Friction, velocity: Number, deflection: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return F [N] and dz/dt [m/s]."""
    rate, damping = relaxation(friction, velocity, ops)
    creep = velocity - rate * deflection
    return friction.stiffness * deflection + damping * creep, creep


@dataclass(frozen=True, slots=True)
class Slide:
    """State of a moving mass and of the bristles on it: position x [m], velocity v [m/s], deflection z [m]."""

    x: Number
    v: Number
    z: Number


@dataclass(frozen=True, slots=True)
class Carriage:
    """The sliding mass of device and hand, mass dv/dt = f - damping v - stiffness x - F, in SI units."""

    mass: float
    damping: float
    stiffness: float


# Type of `slide_step` with a given length: a function of a state, a predicted velocity and a driving force
SlideStep = Callable[[Slide, Number, Number], tuple[Slide, Number]]


def slide(
    step: SlideStep, at: Slide, driving_force: Callable[[float], Number], h: float, steps: int, theta: float
) -> Slide:
    """Advance by several steps of length h [s] under a driving force that depends on time."""
    foreseen = at.v
    if theta < 1:
        _, foreseen = step(at, foreseen, driving_force(theta * h))
    for k in range(steps):
        at, w = step(at, foreseen, driving_force((k + theta) * h))
        foreseen = 2 * at.v - w if theta < 1 else at.v
    return at


def slide_step(
    carriage: Carriage,
    friction: Friction,
    at: Slide,
    foreseen: Number,
    driving_force: Number,
    h: float,
    theta: float,
    ops: Arithmetic,
) -> tuple[Slide, Number]:
    """Advance by one step h under the force `driving_force`, and return the new state and the velocity of the step."""
    bristles = bristle_step(friction, foreseen, h, ops)
    inertia = carriage.mass / (theta * h)
    free = inertia * at.v + driving_force - carriage.stiffness * at.x - bristles.stiffness * at.z
    w = free / (inertia + carriage.damping + carriage.stiffness * theta * h + bristles.slope)
    return Slide(at.x + h * w, at.v + (w - at.v) / theta, bristles.deflection_after(at.z, w)), w


@dataclass(frozen=True, slots=True)
class BristleStep:
    """The bristles over a step h at a constant velocity w: their mean force is stiffness z + slope w."""

    rate: Number  # a(v), 1/s
    time: Number  # h phi_1, s, the time in which z would change by its change over the step if it kept its initial rate
    stiffness: Number  # coefficients of the mean force, N/m and N s/m
    slope: Number

    def deflection_after(self, z: Number, w: Number) -> Number:
        """Return the deflection after the step, m."""
        return z + self.time * (w - self.rate * z)


def bristle_step(friction: Friction, foreseen: Number, h: Number, ops: Arithmetic) -> BristleStep:
    """Return the bristles over a step, with rate and damping at the predicted velocity."""
    rate, damping = relaxation(friction, foreseen, ops)
    phi_1, phi_2 = _phi_1_and_2(rate * h, ops)
    stiffness = (friction.stiffness - damping * rate) * phi_1
    slope = friction.stiffness * h * phi_2 + damping * phi_1
    return BristleStep(rate, h * phi_1, stiffness, slope)


def _phi_1_and_2(y: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return phi_1 = (1 - e^-y)/y and phi_2 = (y - 1 + e^-y)/y^2 for y >= 0."""
    safe = ops.maximum(y, SERIES_BELOW)
    phi_1 = -ops.expm1(-safe) / safe
    small = y < SERIES_BELOW
    series = 0.5 - y * (1 / 6 - y * (1 / 24 - y * (1 / 120 - y / 720)))
    return ops.where(small, 1 - y * series, phi_1), ops.where(small, series, (1 - phi_1) / safe)
