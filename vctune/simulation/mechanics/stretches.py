"""Integrate the motion with friction over a stretch of a sample, as a compiled function with fixed steps."""

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

STEPS_PER_RADIAN = 64  # Number of fixed steps per radian of the bristles' oscillation with the moving mass
LEAST_STEPS, MOST_STEPS = 4, 256  # Least and greatest number of steps in a sample


class _SymbolArithmetic:
    """Arithmetic of CasADi symbols."""

    exp = staticmethod(ca.exp)
    expm1 = staticmethod(ca.expm1)
    absolute = staticmethod(ca.fabs)
    floor = staticmethod(ca.floor)
    minimum = staticmethod(ca.fmin)
    maximum = staticmethod(ca.fmax)
    where = staticmethod(ca.if_else)


SYMBOLS: Arithmetic = _SymbolArithmetic()  # The arithmetic with which controller and friction run on CasADi symbols

# Function that returns a CasADi function (body, command, push_and_derivatives) -> body, which integrates the motion
# over part of a sample interval
Stretch = Callable[[Scene, Friction, float, float], Any]
MIDPOINT = 0.5  # Point of a fixed step at which the forces are evaluated


def default_substeps(scene: Scene, friction: Friction) -> int:
    """Return the number of fixed steps per sample, from the bristles' oscillation with the moving mass."""
    mass = scene.carriage.mass if scene.device.structure is None else scene.device.motor_mass
    frequency = (friction.stiffness / mass) ** 0.5  # rad/s
    return ceil(min(max(frequency * scene.device.sample_time * STEPS_PER_RADIAN, LEAST_STEPS), MOST_STEPS))


def fixed_steps(
    scene: Scene,
    friction: Friction,
    begin: float,
    length: float,
    substeps: int | None = None,
    theta: float = MIDPOINT,
) -> Any:
    """Return the CasADi function (body, command, push_and_derivatives) -> body that integrates the motion in fixed
    steps."""
    share = length / scene.device.sample_time
    # a rounding above a whole number must not add a step
    count = max(1, ceil((substeps or default_substeps(scene, friction)) * share * (1 - 1e-12)))
    command, push_and_derivatives = ca.SX.sym("command"), ca.SX.sym("push", 4)
    parts = assembly(scene)
    if parts is not None:
        return _assembly_stretch(parts, friction, begin, length, count)
    body = ca.SX.sym("body", 3)

    def force(time: float) -> Any:
        """Return the force of motor and hand on a mass that rests at 0."""
        return command + push_at(push_and_derivatives, begin + time)

    step = _slide_step(scene, friction, length / count, theta)
    end = slide(step, Slide(*ca.vertsplit(body)), force, length / count, count, theta)
    return ca.Function("stretch", [body, command, push_and_derivatives], [ca.vertcat(end.x, end.v, end.z)])


def _assembly_stretch(parts: Assembly, friction: Friction, begin: float, length: float, count: int) -> Any:
    """Return the function of `fixed_steps` for an assembly and a number of steps. It calls one compiled step
    repeatedly."""
    n, constants = parts.size, friction_step(parts, length / count)
    state, foreseen = ca.SX.sym("state", n + len(GIVEN) + 1), ca.SX.sym("foreseen")
    *values, z = ca.vertsplit(state)
    end, w = assembly_step(constants, friction, AssemblyState(values, z), foreseen, SYMBOLS)
    compiled_step = ca.Function("step", [state, foreseen], [ca.vertcat(*end.values, end.z), w])

    def step(at: AssemblyState, foreseen: Any) -> tuple[AssemblyState, Any]:
        after, w = compiled_step(ca.vertcat(*at.values, at.z), foreseen)
        *values, z = ca.vertsplit(after)
        return AssemblyState(values, z), w

    body, command, push_and_derivatives = ca.MX.sym("body", n + 1), ca.MX.sym("command"), ca.MX.sym("push", 4)
    _, first, second, third = (push_and_derivatives[order] for order in range(4))
    # push and derivatives at the start of the stretch
    push_at_begin = push_at(push_and_derivatives, begin)
    at_begin = push_at_begin, first + begin * (second + begin / 2 * third), second + begin * third, third
    # the order of GIVEN; each step computes the friction, whose input stays 0
    given = [command, ca.MX(0.0), *at_begin]
    last = assembly_steps(step, AssemblyState([*ca.vertsplit(body[:n]), *given], body[n]), count)
    return ca.Function("stretch", [body, command, push_and_derivatives], [ca.vertcat(*last.values[:n], last.z)])


def _slide_step(scene: Scene, friction: Friction, h: float, theta: float) -> SlideStep:
    """Return `slide_step` with the length h, s, as a function of a state, a predicted velocity and a force."""
    numbers = ca.SX.sym("numbers", 5)
    x, v, z, foreseen, force = ca.vertsplit(numbers)
    end, mean = slide_step(scene.carriage, friction, Slide(x, v, z), foreseen, force, h, theta, SYMBOLS)
    compiled_step = ca.Function("slide", [numbers], [ca.vertcat(end.x, end.v, end.z, mean)])

    def step(at: Slide, foreseen: Any, force: Any) -> tuple[Slide, Any]:
        x, v, z, w = ca.vertsplit(compiled_step(ca.vertcat(at.x, at.v, at.z, foreseen, force)))
        return Slide(x, v, z), w

    return step


def push_at(push_and_derivatives: Any, time: Any) -> Any:
    """Return the push of the hand at a time after the sample, N."""
    push, first, second, third = (push_and_derivatives[order] for order in range(4))
    return push + time * (first + time / 2 * (second + time / 3 * third))
