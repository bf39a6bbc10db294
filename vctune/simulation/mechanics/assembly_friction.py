"""Integrate friction on the motor of a device with parts by fixed steps, which are exact for the bristles and for the
linear parts.

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
    """States and inputs of an assembly, and the bristles' deflection z [m]. The input of the friction force is 0,
    because `assembly_step` computes this force."""

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
    moving : the moving masses
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
    way = applied(step.change[0], at.values)  # the travel without friction
    w = (way - compliance * (bristles.stiffness * at.z)) / (h + compliance * bristles.slope)
    inputs_and_states = [*at.values]
    inputs_and_states[step.friction] = bristles.stiffness * at.z + bristles.slope * w
    values = [value + applied(row, inputs_and_states) for value, row in zip(at.values, step.change, strict=True)]
    return AssemblyState(values, bristles.deflection_after(at.z, w)), w


AdvanceStep = Callable[[AssemblyState, Number], tuple[AssemblyState, Number]]
"""Type of `assembly_step` with a given step: a function of a state and a predicted velocity."""


def assembly_steps(step: AdvanceStep, at: AssemblyState, count: int) -> AssemblyState:
    """Advance by several steps.

    Each step predicts its velocity from the previous step. The first step uses a trial, as in `slide`.

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
        foreseen = 2 * at.v - w
    return at
