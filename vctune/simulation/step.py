"""One sample of a scene as a compiled function, assembled from what the scene contains. Imports casadi.

A sample goes: sensors read, the firmware runs, the device moves on for a sample time under the forces that have
arrived. Friction, quantisation, saturation, filters and the coupling are operations of the function only where the
scene has them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from math import ceil
from typing import Any

import casadi as ca
import numpy as np

from vctune.model.experiment import Friction
from vctune.simulation.arithmetic import Arithmetic
from vctune.simulation.controller import Measurement, State, control
from vctune.simulation.friction import Slide, SlideStep, friction_force, slide, slide_step
from vctune.simulation.motion import Floats, hand_force_derivatives
from vctune.simulation.plant import timing, transition
from vctune.simulation.scene import Scene, equilibrium

CHUNK = 1024
"""Samples per call of the compiled function: progress and Ctrl-C wait for one. Half and twice it take the same time."""
COLUMNS = ("position", "velocity", "force", "reference", "desired", "environment_force", "motor")
"""What a step records at each sample: x, v, f_h, x_e, v_e, f_e, u."""
INPUTS = 5
"""x_i, v_i at this sample and at the next, and the noise of the force sensor."""


STEPS_PER_RADIAN = 64
"""Fixed steps per radian of the bristles' oscillation. Half: four times the error in half the time, twice: a quarter of
it in twice the time (results/work-precision.csv)."""
LEAST_STEPS, MOST_STEPS = 4, 256
"""Least: Stribeck's curve is crossed within a sample also by soft bristles. Most: beyond it bristles are stiffer than
anything that can be felt. Half and twice either are half and twice the time where they apply."""


class _SymbolArithmetic:
    """CasADi symbols."""

    exp = staticmethod(ca.exp)
    expm1 = staticmethod(ca.expm1)
    absolute = staticmethod(ca.fabs)
    floor = staticmethod(ca.floor)
    minimum = staticmethod(ca.fmin)
    maximum = staticmethod(ca.fmax)
    where = staticmethod(ca.if_else)


SYMBOLS: Arithmetic = _SymbolArithmetic()


Stretch = Callable[[Scene, Friction, float, float], Any]
"""Makes the function (body, motor, push) -> body over a stretch of a sample: of a scene with friction, where in the
sample the stretch begins and how long it is, s."""
MIDPOINT = 0.5
"""Where in a fixed step its forces are taken; of second order (`friction.slide`)."""


@dataclass(frozen=True, slots=True)
class Step:
    """A compiled step, one(state, inputs) -> (state, record), and its state at rest where the motion starts.

    The state is x, v and with friction z; what the firmware remembers and changes; the forces on their way.
    """

    one: Any
    start: Floats

    def chunk(self) -> Any:
        """Return the function for `CHUNK` samples: samples(state, inputs) -> (states, records), a column a sample."""
        return self.one.mapaccum(CHUNK)


def default_substeps(scene: Scene, friction: Friction) -> int:
    """Return how many fixed steps a sample gets, by the bristles' oscillation with device and hand.

    No more than `MOST_STEPS`: beyond that the bristles are stiffer than anything that can be felt.
    """
    bristles = (friction.stiffness / scene.carriage.mass) ** 0.5
    return ceil(min(max(bristles * scene.device.sample_time * STEPS_PER_RADIAN, LEAST_STEPS), MOST_STEPS))


def fixed_steps(
    scene: Scene,
    friction: Friction,
    begin: float,
    length: float,
    substeps: int | None = None,
    theta: float = MIDPOINT,
) -> Any:
    """Return the function (body, motor, push) -> body over a stretch of a sample, in fixed steps.

    Parameters
    ----------
    scene, friction : what moves
    begin, length : where in the sample the stretch begins, and how long it is, s
    substeps : per sample; None for `default_substeps`
    theta : where in a step its forces are taken, see `friction.slide`
    """
    share = length / scene.device.sample_time
    count = max(1, ceil((substeps or default_substeps(scene, friction)) * share * (1 - 1e-12)))
    body, motor, push = ca.SX.sym("body", 3), ca.SX.sym("motor"), ca.SX.sym("push", 4)

    def force(time: float) -> Any:
        return motor + push_at(push, begin + time)

    step = _slide_step(scene, friction, length / count, theta)
    end = slide(step, Slide(*ca.vertsplit(body)), force, length / count, count, theta)
    return ca.Function("stretch", [body, motor, push], [ca.vertcat(end.x, end.v, end.z)])


def build(scene: Scene, stretch: Stretch = fixed_steps) -> Step:
    """Assemble and compile the step of a scene; `stretch` says how friction is integrated."""
    when = timing(scene)
    names = [field.name for field in fields(State)]
    body, inputs = ca.SX.sym("body", 3 if scene.friction else 2), ca.SX.sym("inputs", INPUTS)
    queue = [
        ca.SX.sym(f"u{age}") for age in range(when.whole_samples + 1)
    ]  # forces commanded and not yet spent, the newest first
    memory = {name: ca.SX.sym(name) for name in names}

    at = Slide(body[0], body[1], body[2] if scene.friction else 0.0)
    hand = _hand_force(scene, at, inputs, queue[-1])
    measurement = Measurement(at.x, at.v, hand + inputs[4] if scene.force_noise > 0 else hand)
    remembered, command = control(scene.law, State(**memory), measurement, SYMBOLS)
    changed = [name for name in names if getattr(remembered, name) is not memory[name]]
    record = ca.vertcat(at.x, at.v, hand, remembered.reference, remembered.desired, command.environment, command.force)
    commanded = [command.force, *queue]
    state = ca.vertcat(body, *(memory[name] for name in changed), *queue)
    kept = ca.vertcat(*(getattr(remembered, name) for name in changed), *commanded[:-1])
    begin = equilibrium(scene)
    start = np.zeros(state.shape[0])
    start[0], start[-len(queue) :] = begin.position, begin.motor
    known = {"reference": begin.reference, "measured": begin.position}
    start[body.shape[0] : -len(queue)] = [known.get(name, 0.0) for name in changed]
    if scene.friction is None:
        one = ca.Function(
            "one", [state, inputs], [ca.vertcat(_moved_exactly(scene, body, inputs, commanded), kept), record]
        )
    else:
        firmware = ca.Function("firmware", [state, inputs], [kept, record, commanded[-1], commanded[-2]])
        one = _with_friction(scene, scene.friction, stretch, firmware)
    return Step(one, start)


def _hand_force(scene: Scene, at: Slide, inputs: Any, motor: Any) -> Any:
    """Return f_h just before the sample: spring, damper and, with the acceleration at that moment, the hand's mass."""
    hand, carriage = scene.operator, scene.carriage
    push = hand.stiffness * inputs[0] + hand.damping * inputs[1]
    pull = hand.stiffness * at.x + hand.damping * at.v
    if hand.mass == 0:
        return push - pull
    resisting = scene.device.damping * at.v
    if scene.friction is not None:
        resisting = resisting + friction_force(scene.friction, at.v, at.z, SYMBOLS)[0]
    share = hand.mass / carriage.mass
    return (1 - share) * (push - pull) - share * (motor - resisting)


def _moved_exactly(scene: Scene, body: Any, inputs: Any, commanded: list[Any]) -> Any:
    exact = transition(scene)
    moved = ca.mtimes(ca.DM(exact.state), body) + ca.mtimes(ca.DM(exact.motion), inputs[:4])
    moved = moved + ca.DM(exact.late) * commanded[-2]
    return moved + ca.DM(exact.early) * commanded[-1] if exact.early.any() else moved


def _with_friction(scene: Scene, friction: Friction, stretch: Stretch, firmware: Any) -> Any:
    """Return the step of a device with friction: firmware, then one or two stretches of constant motor force."""
    when, push = timing(scene), ca.DM(hand_force_derivatives(scene.operator, scene.device.sample_time))
    state, inputs = ca.MX.sym("state", firmware.size_in(0)), ca.MX.sym("inputs", INPUTS)
    kept, record, early, late = firmware(state, inputs)
    body = state[:3]
    for begin, length, motor in ((0.0, when.early, early), (when.early, when.late, late)):
        if length > 0:
            body = stretch(scene, friction, begin, length)(body, motor, ca.mtimes(push, inputs[:4]))
    return ca.Function("one", [state, inputs], [ca.vertcat(body, kept), record])


def _slide_step(scene: Scene, friction: Friction, h: float, theta: float) -> SlideStep:
    """Return `slide_step` as a function that is written down once, however often it is used."""
    numbers = ca.SX.sym("numbers", 5)
    x, v, z, foreseen, push = ca.vertsplit(numbers)
    end, mean = slide_step(scene.carriage, friction, Slide(x, v, z), foreseen, push, h, theta, SYMBOLS)
    one = ca.Function("slide", [numbers], [ca.vertcat(end.x, end.v, end.z, mean)])

    def step(at: Slide, foreseen: Any, push: Any) -> tuple[Slide, Any]:
        x, v, z, w = ca.vertsplit(one(ca.vertcat(at.x, at.v, at.z, foreseen, push)))
        return Slide(x, v, z), w

    return step


def push_at(push: Any, time: Any) -> Any:
    """Return the force of the hand's spring and damper from its derivatives at the sample, `time` after it."""
    return push[0] + time * (push[1] + time / 2 * (push[2] + time / 3 * push[3]))
