"""Integrate friction on the motor of a device with parts by fixed steps, which are exact for the linear parts and, at a
constant velocity of the motor, for the bristles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.experiment import Friction
from vctune.model.numbers.arithmetic import Floats, Number
from vctune.simulation.firmware.operations import Arithmetic
from vctune.simulation.mechanics.assembly import GIVEN, Assembly, applied
from vctune.simulation.mechanics.friction import bristle_step


@dataclass(frozen=True, slots=True)
class AssemblyState:
    """States and inputs of an assembly, the motor's position and velocity first, and the bristles' deflection z [m]."""

    values: list[Number]
    z: Number

    @property
    def v(self) -> Number:
        """The motor's velocity, m/s."""
        return self.values[1]


@dataclass(frozen=True, slots=True)
class FrictionStep:
    """A step of an assembly in which command and friction are held."""

    length: float  # length h of the step, s
    change: Floats  # e^(rates h) - 1, see `Assembly.changed`
    friction: int  # index of the friction's force in states and inputs


def friction_step(moving: Assembly, length: float) -> FrictionStep:
    """Return the step of an assembly with a given length, s."""
    return FrictionStep(length, moving.changed(length), moving.size + GIVEN.index("friction"))


def assembly_step(
    step: FrictionStep, friction: Friction, at: AssemblyState, foreseen: Number, ops: Arithmetic
) -> tuple[AssemblyState, Number]:
    """Advance by one step, and return the new state and the motor's mean velocity w, m/s."""
    h, bristles = step.length, bristle_step(friction, foreseen, step.length, ops)
    compliance = -float(step.change[0, step.friction])  # reduction of the motor's travel per newton, m/N
    free_travel = applied(step.change[0], at.values)
    # h w = free_travel - compliance F with F = stiffness z + slope w
    w = (free_travel - compliance * (bristles.stiffness * at.z)) / (h + compliance * bristles.slope)
    with_friction = [*at.values]
    with_friction[step.friction] = bristles.stiffness * at.z + bristles.slope * w
    values = [value + applied(row, with_friction) for value, row in zip(at.values, step.change, strict=True)]
    return AssemblyState(values, bristles.deflection_after(at.z, w)), w


# Type of `assembly_step` with a given step: a function of a state and a predicted velocity
AdvanceStep = Callable[[AssemblyState, Number], tuple[AssemblyState, Number]]


def assembly_steps(step: AdvanceStep, at: AssemblyState, count: int) -> AssemblyState:
    """Advance by several steps."""
    _, foreseen = step(at, at.v)
    for _ in range(count):
        at, w = step(at, foreseen)
        foreseen = 2 * at.v - w  # v + (v - w), where w is about the velocity at the middle of the step
    return at
