"""LuGre friction (Canudas de Wit, Olsson, Astrom, Lischinsky 1995), and a step made for it.

With the bristles' deflection z, the rate a(v) = stiffness |v|/g(v) and Stribeck's curve g,

    dz/dt = v - a(v) z,   F = stiffness z + damping(v) dz/dt,   g = coulomb + (stiction - coulomb) e^{-(v/v_s)^2}.

A constant damping can make LuGre friction give energy back at speed. It never does where damping <= 4 g/|v|, hence
damping(v) = damping/(1 + damping |v|/(4 coulomb)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.arithmetic import Number
from vctune.model.experiment import Friction
from vctune.simulation.arithmetic import Arithmetic

SERIES = 0.01


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
    """Handle and bristles: position x [m], velocity v [m/s], deflection z [m]."""

    x: Number
    v: Number
    z: Number


@dataclass(frozen=True, slots=True)
class Carriage:
    """What slides, mass dv/dt = push - damping v - stiffness x - F: the device and the hand on it, kg, N s/m, N/m."""

    mass: float
    damping: float
    stiffness: float


SlideStep = Callable[[Slide, Number, Number], tuple[Slide, Number]]
"""A step of a certain length, as `slide_step`: from a state, a foreseen velocity and a force."""


def slide(step: SlideStep, at: Slide, push: Callable[[float], Number], h: float, steps: int, theta: float) -> Slide:
    """Advance by some steps of length h under the force push(t), t counted from the beginning.

    Midpoint (theta = 1/2) is of second order, Euler (theta = 1) of first. A step's bristle rate is taken at a velocity
    that is foreseen from the step before, in the first step from a trial.
    """
    foreseen = at.v
    if theta < 1:
        _, foreseen = step(at, foreseen, push(theta * h))
    for k in range(steps):
        at, w = step(at, foreseen, push((k + theta) * h))
        foreseen = 2 * at.v - w if theta < 1 else at.v
    return at


def slide_step(
    carriage: Carriage,
    friction: Friction,
    at: Slide,
    foreseen: Number,
    push: Number,
    h: float,
    theta: float,
    ops: Arithmetic,
) -> tuple[Slide, Number]:
    """Advance by one step h under the force `push`; return also the step's velocity w = v + theta (v_new - v).

    With the rate and the damping at the foreseen velocity, and w the same over the step, the bristles are followed
    exactly: with y = a h their mean is phi z + psi h w, phi = (1 - e^-y)/y, psi = (1 - phi)/y. The friction is then
    linear in w, and the momentum balance is solved for w. Since the bristles take exactly the work that friction does
    at the velocity w, no step creates energy, whatever h, the stiffness and what was foreseen.
    """
    rate, damping = relaxation(friction, foreseen, ops)
    phi, psi = _decays(rate * h, ops)
    held = (friction.stiffness - damping * rate) * phi
    slope = friction.stiffness * h * psi + damping * phi
    inertia = carriage.mass / (theta * h)
    free = inertia * at.v + push - carriage.stiffness * at.x - held * at.z
    w = free / (inertia + carriage.damping + carriage.stiffness * theta * h + slope)
    return Slide(at.x + h * w, at.v + (w - at.v) / theta, at.z + h * phi * (w - rate * at.z)), w


def _decays(y: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return (1 - e^-y)/y and (y - 1 + e^-y)/y^2 for y >= 0."""
    safe = ops.maximum(y, SERIES)
    phi = -ops.expm1(-safe) / safe
    small = y < SERIES
    series = 0.5 - y * (1 / 6 - y * (1 / 24 - y * (1 / 120 - y / 720)))
    return ops.where(small, 1 - y * series, phi), ops.where(small, series, (1 - phi) / safe)
