"""Integrate friction on the motor of a device with parts by fixed steps, which are exact for the linear parts and, at a
constant velocity of the motor, for the bristles.

Over a step, the code holds the friction force F at its mean. The code computes this mean for bristles that follow the
motor's mean velocity w. All other parts are linear, and their motion is exact (`assembly`). w is the motor's mean
velocity under the held force. Over a step of length h, the friction takes the work F h w from the motor, and the
bristles receive this work. No step therefore creates energy, for any h, any stiffness of the parts and any predicted
velocity. Neither a fast actuator nor a stiff handle makes this step stiff. The step approximates only the variation of
the friction within a step, to second order. If a motion is faster than a step, the step gives the mean of this motion
over the step, to first order. An example is the motion of a hand's mass on a nearly rigid handle.
"""

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
    """States and inputs of an assembly, the motor's position and velocity first, and the bristles' deflection z [m].

    The input of the friction force is 0, because `assembly_step` computes this force.
    """

    values: list[Number]
    z: Number

    @property
    def v(self) -> Number:
        """The motor's velocity, m/s."""
        return self.values[1]


@dataclass(frozen=True, slots=True)
class FrictionStep:
    """A step of an assembly in which command and friction are held.

    Attributes
    ----------
    length : length h of the step, s
    change : e^(rates h) - 1, see `Assembly.changed`
    friction : index of the friction's force in states and inputs
    """

    length: float
    change: Floats
    friction: int


def friction_step(moving: Assembly, length: float) -> FrictionStep:
    """Return the step of an assembly with a given length, s.

    Parameters
    ----------
    moving : device with parts, and the hand on it
    length : length h of the step, s
    """
    return FrictionStep(length, moving.changed(length), moving.size + GIVEN.index("friction"))


def assembly_step(
    step: FrictionStep, friction: Friction, at: AssemblyState, foreseen: Number, ops: Arithmetic
) -> tuple[AssemblyState, Number]:
    """Advance by one step, and return the new state and the motor's mean velocity w, m/s.

    Parameters
    ----------
    step : step of the assembly
    friction : friction that acts on the motor
    at : states and bristles at the beginning
    foreseen : predicted velocity at which the friction's rate is evaluated, m/s
    ops : arithmetic of states and velocity

    Returns
    -------
    state, velocity
        States and bristles at the end, and w.
    """
    h, bristles = step.length, bristle_step(friction, foreseen, step.length, ops)
    compliance = -float(step.change[0, step.friction])  # reduction of the motor's travel per newton, m/N
    free_travel = applied(step.change[0], at.values)
    # h w = free_travel - compliance F with F = stiffness z + slope w
    w = (free_travel - compliance * (bristles.stiffness * at.z)) / (h + compliance * bristles.slope)
    with_friction = [*at.values]
    with_friction[step.friction] = bristles.stiffness * at.z + bristles.slope * w
    values = [value + applied(row, with_friction) for value, row in zip(at.values, step.change, strict=True)]
    return AssemblyState(values, bristles.deflection_after(at.z, w)), w


AdvanceStep = Callable[[AssemblyState, Number], tuple[AssemblyState, Number]]
"""Type of `assembly_step` with a given step: a function of a state and a predicted velocity."""


def assembly_steps(step: AdvanceStep, at: AssemblyState, count: int) -> AssemblyState:
    """Advance by several steps.

    Each step predicts its mean velocity from the previous step: the velocity at its beginning plus half the change over
    the previous step. A trial step predicts the velocity of the first step, as in `friction.slide`.

    Parameters
    ----------
    step : function that advances by one step
    at : states and bristles at the beginning
    count : number of steps

    Returns
    -------
    AssemblyState
        The state at the end of the last step.
    """
    _, foreseen = step(at, at.v)
    for _ in range(count):
        at, w = step(at, foreseen)
        foreseen = 2 * at.v - w  # v + (v - w), where w is about the velocity at the middle of the step
    return at
