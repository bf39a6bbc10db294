"""Dry friction, and friction on bristles, over a step of a plant in any arithmetic (README.md, "Friction")."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.experiment import Friction, MovingHand
from vctune.model.numbers.arithmetic import Floats, Number
from vctune.simulation.controller import Operations
from vctune.simulation.plant import GIVEN, row_times

SERIES_BELOW = 0.01  # Argument y at which the code changes from the series of phi_2 to its formula
STEPS_PER_RADIAN = 64  # Number of fixed steps per radian of the bristles' oscillation with the moving mass
DRY_STEPS = 32  # Number of fixed steps per sample with dry friction, which stops the handle at the end of one
LEAST_STEPS, MOST_STEPS = 4, 256  # Least and greatest number of steps in a sample


def friction_force(friction: Friction, velocity: Number, deflection: Number, ops: Operations) -> tuple[Number, Number]:
    """Return F [N] and dz/dt [m/s]."""
    rate, damping = _relaxation(friction, velocity, ops)
    creep = velocity - rate * deflection
    return friction.stiffness * deflection + damping * creep, creep


def _relaxation(friction: Friction, velocity: Number, ops: Operations) -> tuple[Number, Number]:
    """Return a(v) [1/s] and damping(v) [N s/m]."""
    speed, g = ops.absolute(velocity), friction.coulomb
    if friction.stiction > friction.coulomb:
        ratio = velocity / friction.stribeck_velocity
        g = g + (friction.stiction - friction.coulomb) * ops.exp(-ratio * ratio)
    return friction.stiffness * speed / g, friction.damping / (1 + friction.damping * speed / (4 * friction.coulomb))


class Sliding(NamedTuple):
    """Where a step begins or ends."""

    values: Sequence[Number]  # states and given inputs of the plant
    z: Number  # deflection of the bristles, m; the last force of a dry friction, N
    foreseen: Number  # predicted velocity of the motor in the middle of the next step, m/s


def dry_force(coulomb: float, ahead: Number, per_force: Number, ops: Operations) -> Number:
    """Return the friction, N, that stops a motor which would move at `ahead`, m/s, without it, or the greatest one; a
    newton of friction slows the motor by `per_force`, m/(N s)."""
    return ops.maximum(-coulomb, ops.minimum(coulomb, ahead / per_force))


def dry_step(change: Floats, coulomb: float, at: Sliding, ops: Operations) -> Sliding:
    """Advance by a step in which the plant changes by `change`. The friction is the force that stops the motor, or the
    greatest one against the motion; `at.z` of the result is this force, N."""
    rubbing = len(change) - len(GIVEN) + GIVEN.index("friction")
    held = [*at.values]
    held[rubbing] = 0.0
    ahead = at.values[1] + row_times(change[1], held)
    held[rubbing] = dry_force(coulomb, ahead, -float(change[1, rubbing]), ops)
    values = [value + row_times(row, held) for value, row in zip(at.values, change, strict=True)]
    return Sliding(values, held[rubbing], values[1])


def friction_step(change: Floats, h: float, friction: Friction, at: Sliding, ops: Operations) -> Sliding:
    """Advance by a step h, s, in which command and friction are held and the plant changes by `change`."""
    rate, damping = _relaxation(friction, at.foreseen, ops)
    phi_1, phi_2 = _phi_1_and_2(rate * h, ops)
    # the bristles' mean force over a step at the velocity w is stiffness z + slope w
    stiffness = (friction.stiffness - damping * rate) * phi_1
    slope = friction.stiffness * h * phi_2 + damping * phi_1
    rubbing = len(change) - len(GIVEN) + GIVEN.index("friction")
    compliance = -float(change[0, rubbing])  # reduction of the motor's travel per newton, m/N
    w = (row_times(change[0], at.values) - compliance * (stiffness * at.z)) / (h + compliance * slope)
    held = [*at.values]
    held[rubbing] = stiffness * at.z + slope * w
    values = [value + row_times(row, held) for value, row in zip(at.values, change, strict=True)]
    # v + (v - w), where w is about the velocity at the middle of the step
    return Sliding(values, at.z + h * phi_1 * (w - rate * at.z), 2 * values[1] - w)


def slide(step: Callable[[Sliding], Sliding], at: Sliding, count: int) -> Sliding:
    """Advance by several steps. A first try foresees the velocity of the first step."""
    tried = step(at)
    at = at._replace(foreseen=2 * tried.values[1] - tried.foreseen)
    for _ in range(count):
        at = step(at)
    return at


def _phi_1_and_2(y: Number, ops: Operations) -> tuple[Number, Number]:
    """Return phi_1 = (1 - e^-y)/y and phi_2 = (y - 1 + e^-y)/y^2 for y >= 0."""
    safe = ops.maximum(y, SERIES_BELOW)
    phi_1, small = -ops.expm1(-safe) / safe, y < SERIES_BELOW
    series = 0.5 - y * (1 / 6 - y * (1 / 24 - y * (1 / 120 - y / 720)))
    return ops.where(small, 1 - y * series, phi_1), ops.where(small, series, (1 - phi_1) / safe)


def steps_per_sample(friction: Friction, device: Device, hand: MovingHand) -> int:
    """Return the number of fixed steps per sample: of bristles, from their oscillation with the moving mass."""
    if friction.dry:
        return DRY_STEPS
    mass = device.mass + hand.mass if device.structure is None else device.motor_mass
    frequency = (friction.stiffness / mass) ** 0.5  # rad/s
    return ceil(min(max(frequency * device.sample_time * STEPS_PER_RADIAN, LEAST_STEPS), MOST_STEPS))
