"""Model LuGre friction (Canudas de Wit, Olsson, Astrom, Lischinsky 1995), and integrate it with a dedicated step.

With the bristles' deflection z, the rate a(v) = stiffness |v|/g(v) and the Stribeck curve g,

    dz/dt = v - a(v) z,   F = stiffness z + damping(v) dz/dt,   g = coulomb + (stiction - coulomb) e^{-(v/v_s)^2}.

With a constant damping, LuGre friction can return energy at high speed. The model returns no energy if damping <= 4
g/|v|. The code therefore uses damping(v) = damping/(1 + damping |v|/(4 coulomb)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.experiment import Friction
from vctune.model.numbers.arithmetic import Number
from vctune.simulation.firmware.operations import Arithmetic

SERIES_BELOW = 0.01
"""Argument y at which the code changes from the series of phi_2 to its formula. The subtraction in the formula
increases the rounding error by a factor of 2/y. At this argument both are correct to 2e-14. At half this argument, the
formula's rounding error doubles. At twice this argument, the remainder of the series of five terms is 6e-13."""


def relaxation(friction: Friction, velocity: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return a(v) [1/s] and damping(v) [N s/m].

    Parameters
    ----------
    friction : parameters of the friction
    velocity : velocity, m/s
    ops : arithmetic of the velocity
    """
    speed = ops.absolute(velocity)
    g = friction.coulomb
    if friction.stiction > friction.coulomb:
        ratio = velocity / friction.stribeck_velocity
        g = g + (friction.stiction - friction.coulomb) * ops.exp(-ratio * ratio)
    return friction.stiffness * speed / g, friction.damping / (1 + friction.damping * speed / (4 * friction.coulomb))


def friction_force(friction: Friction, velocity: Number, deflection: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return F [N] and dz/dt [m/s].

    Parameters
    ----------
    friction : parameters of the friction
    velocity : velocity, m/s
    deflection : deflection of the bristles, m
    ops : arithmetic of velocity and deflection
    """
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
    """The sliding mass of device and hand, mass dv/dt = f - damping v - stiffness x - F, in SI units.

    The driving force f is the force of the motor plus the force of the hand's spring and damper on a handle at rest
    at 0. The damping is that of device and hand, the stiffness that of the hand.
    """

    mass: float
    damping: float
    stiffness: float


SlideStep = Callable[[Slide, Number, Number], tuple[Slide, Number]]
"""Type of `slide_step` with a given length: a function of a state, a predicted velocity and a driving force."""


def slide(
    step: SlideStep, at: Slide, driving_force: Callable[[float], Number], h: float, steps: int, theta: float
) -> Slide:
    """Advance by several steps of length h [s] under a driving force that depends on time.

    The midpoint rule (theta = 1/2) is of second order, Euler's rule (theta = 1) of first order. For theta < 1, the code
    evaluates the bristles' rate at a velocity that the previous step predicts. In the first step, a trial step predicts
    the velocity. For theta = 1, the code evaluates the rate at the velocity at the beginning of the step.

    Parameters
    ----------
    step : function that advances by one step of length h
    at : state at the beginning
    driving_force : function of the time since the beginning, s, that returns the force of motor and hand, N
    h : length of a step, s
    steps : number of steps
    theta : point of a step at which the forces are evaluated, 1/2 to 1

    Returns
    -------
    Slide
        The state at the end.
    """
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
    """Advance by one step h under the force `driving_force`, and return the new state and the velocity of the step.

    The velocity of the step is w = v + theta (v_new - v).

    The function evaluates rate and damping at the predicted velocity, and assumes that the velocity w is constant over
    the step. The motion of the bristles is then exact. With y = a h, their mean deflection is phi_1 z + phi_2 h w with
    phi_1 = (1 - e^-y)/y and phi_2 = (1 - phi_1)/y. The friction is linear in w, and the function solves the momentum
    balance for w. The bristles receive exactly the work that friction does at the velocity w. No step therefore creates
    energy, for any h, any stiffness and any predicted velocity.

    Parameters
    ----------
    carriage : the sliding mass
    friction : friction on the mass
    at : state at the beginning
    foreseen : predicted velocity at which the friction's rate is evaluated, m/s
    driving_force : force of motor and hand, N
    h : length of the step, s
    theta : point of the step at which the forces are evaluated, 1/2 to 1
    ops : arithmetic of state, velocity and force

    Returns
    -------
    tuple of Slide and Number
        The state at the end, and w, m/s.
    """
    bristles = bristle_step(friction, foreseen, h, ops)
    inertia = carriage.mass / (theta * h)
    free = inertia * at.v + driving_force - carriage.stiffness * at.x - bristles.stiffness * at.z
    w = free / (inertia + carriage.damping + carriage.stiffness * theta * h + bristles.slope)
    return Slide(at.x + h * w, at.v + (w - at.v) / theta, bristles.deflection_after(at.z, w)), w


@dataclass(frozen=True, slots=True)
class BristleStep:
    """The bristles over a step h at a constant velocity w: their mean force is stiffness z + slope w.

    Attributes
    ----------
    rate : a(v), 1/s
    time : h phi_1, s, the time in which z would change by its change over the step if it kept its initial rate
    stiffness, slope : coefficients of the mean force, N/m and N s/m
    """

    rate: Number
    time: Number
    stiffness: Number
    slope: Number

    def deflection_after(self, z: Number, w: Number) -> Number:
        """Return the deflection after the step, m.

        Parameters
        ----------
        z : deflection before the step, m
        w : velocity over the step, m/s
        """
        return z + self.time * (w - self.rate * z)


def bristle_step(friction: Friction, foreseen: Number, h: Number, ops: Arithmetic) -> BristleStep:
    """Return the bristles over a step, with rate and damping at the predicted velocity.

    Parameters
    ----------
    friction : parameters of the friction
    foreseen : predicted velocity, m/s
    h : length of the step, s
    ops : arithmetic of the velocity
    """
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
