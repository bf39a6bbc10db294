"""Integrate friction over a stretch of a sample, as a compiled function with fixed steps.

A sample is cut into stretches where a command arrives or where the force sensor takes its sample. This module imports
casadi.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Any

import casadi as ca

from vctune.model.experiment import Friction
from vctune.simulation.firmware.operations import Arithmetic
from vctune.simulation.mechanics.assembly import GIVEN, Assembly, assembly
from vctune.simulation.mechanics.assembly_friction import AssemblyState, assembly_step, assembly_steps, friction_step
from vctune.simulation.mechanics.friction import Slide, SlideStep, slide, slide_step
from vctune.simulation.scene import Scene

STEPS_PER_RADIAN = 64
"""Number of fixed steps per radian of the bristles' oscillation. With half as many steps, the error is four times as
large in half the time. With twice as many steps, the error is a quarter in twice the time
(results/work-precision.csv)."""
LEAST_STEPS, MOST_STEPS = 4, 256
"""Least and greatest number of steps in a sample. The least number resolves a motion that crosses the Stribeck curve
within a sample, even with soft bristles. Bristles that need more than the greatest number of steps are stiffer than a
hand can feel. The simulation time is proportional to the number of steps."""


class _SymbolArithmetic:
    """Arithmetic of CasADi symbols."""

    exp = staticmethod(ca.exp)
    expm1 = staticmethod(ca.expm1)
    absolute = staticmethod(ca.fabs)
    floor = staticmethod(ca.floor)
    minimum = staticmethod(ca.fmin)
    maximum = staticmethod(ca.fmax)
    where = staticmethod(ca.if_else)


SYMBOLS: Arithmetic = _SymbolArithmetic()


Stretch = Callable[[Scene, Friction, float, float], Any]
"""Function that returns the function (body, motor, push) -> body, which integrates the motion over part of a sample.
The arguments are a scene, the scene's friction, the start of that part, s, and the length of that part, s. `body` holds
x, v and the deflection z of the bristles, or the states of the assembly and z. `motor` is the force of the motor, N.
`push` is the force of the hand (`push_at`) and its three derivatives at the sample, N to N/s^3."""
MIDPOINT = 0.5
"""Point of a fixed step at which the forces are evaluated. With the midpoint, the rule is of second order
(`friction.slide`)."""


def default_substeps(scene: Scene, friction: Friction) -> int:
    """Return the number of fixed steps per sample, from the bristles' oscillation with the moving mass.

    The number is at most `MOST_STEPS`.

    Parameters
    ----------
    scene : scene with the moving masses and the sample time
    friction : friction with the bristles' stiffness, N/m
    """
    mass = scene.carriage.mass if scene.device.structure is None else scene.device.motor_mass
    bristles = (friction.stiffness / mass) ** 0.5
    return ceil(min(max(bristles * scene.device.sample_time * STEPS_PER_RADIAN, LEAST_STEPS), MOST_STEPS))


def fixed_steps(
    scene: Scene,
    friction: Friction,
    begin: float,
    length: float,
    substeps: int | None = None,
    theta: float = MIDPOINT,
) -> Any:
    """Return the function (body, motor, push) -> body that integrates the motion over part of a sample in fixed steps.

    Parameters
    ----------
    scene, friction : scene with the moving masses, and its friction
    begin, length : start of the part within the sample, and its length, s
    substeps : number of steps per sample; None for `default_substeps`
    theta : point of a step at which the forces are evaluated, see `friction.slide`; not used for an `assembly`
    """
    share = length / scene.device.sample_time
    # a rounding above a whole number must not add a step
    count = max(1, ceil((substeps or default_substeps(scene, friction)) * share * (1 - 1e-12)))
    motor, push = ca.SX.sym("motor"), ca.SX.sym("push", 4)
    parts = assembly(scene)
    if parts is not None:
        return _assembly_stretch(parts, friction, begin, length, count)
    body = ca.SX.sym("body", 3)

    def force(time: float) -> Any:
        return motor + push_at(push, begin + time)

    step = _slide_step(scene, friction, length / count, theta)
    end = slide(step, Slide(*ca.vertsplit(body)), force, length / count, count, theta)
    return ca.Function("stretch", [body, motor, push], [ca.vertcat(end.x, end.v, end.z)])


def _assembly_stretch(parts: Assembly, friction: Friction, begin: float, length: float, count: int) -> Any:
    """Return the function of `fixed_steps` for an assembly. The function calls one compiled step repeatedly."""
    n, constants = parts.size, friction_step(parts, length / count)
    state, foreseen = ca.SX.sym("state", n + len(GIVEN) + 1), ca.SX.sym("foreseen")
    *values, z = ca.vertsplit(state)
    end, w = assembly_step(constants, friction, AssemblyState(values, z), foreseen, SYMBOLS)
    compiled_step = ca.Function("step", [state, foreseen], [ca.vertcat(*end.values, end.z), w])

    def step(at: AssemblyState, foreseen: Any) -> tuple[AssemblyState, Any]:
        after, w = compiled_step(ca.vertcat(*at.values, at.z), foreseen)
        *values, z = ca.vertsplit(after)
        return AssemblyState(values, z), w

    body, motor, push = ca.MX.sym("body", n + 1), ca.MX.sym("motor"), ca.MX.sym("push", 4)
    slope = push[1] + begin * (push[2] + begin / 2 * push[3])
    at_begin = push_at(push, begin), slope, push[2] + begin * push[3], push[3]
    # the order of GIVEN; friction begins at 0
    last = assembly_steps(step, AssemblyState([*ca.vertsplit(body[:n]), motor, ca.MX(0.0), *at_begin], body[n]), count)
    return ca.Function("stretch", [body, motor, push], [ca.vertcat(*last.values[:n], last.z)])


def _slide_step(scene: Scene, friction: Friction, h: float, theta: float) -> SlideStep:
    """Return `slide_step` as one compiled function, which the caller calls once per step."""
    numbers = ca.SX.sym("numbers", 5)
    x, v, z, foreseen, push = ca.vertsplit(numbers)
    end, mean = slide_step(scene.carriage, friction, Slide(x, v, z), foreseen, push, h, theta, SYMBOLS)
    compiled_step = ca.Function("slide", [numbers], [ca.vertcat(end.x, end.v, end.z, mean)])

    def step(at: Slide, foreseen: Any, push: Any) -> tuple[Slide, Any]:
        x, v, z, w = ca.vertsplit(compiled_step(ca.vertcat(at.x, at.v, at.z, foreseen, push)))
        return Slide(x, v, z), w

    return step


def push_at(push: Any, time: Any) -> Any:
    """Return the push of the hand at a time after the sample, from its derivatives at the sample.

    The push is the force of the hand's spring and damper on a handle that rests at 0. The carriage subtracts what the
    motion of the handle changes.

    Parameters
    ----------
    push : force at the sample and its three derivatives, N to N/s^3
    time : time since the sample, s
    """
    return push[0] + time * (push[1] + time / 2 * (push[2] + time / 3 * push[3]))
