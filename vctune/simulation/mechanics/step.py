"""Compile one sample of a scene into a function, assembled from the parts of the scene. This module imports casadi."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from vctune.model.experiment import Friction
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.firmware.controller import State, control, encoded, remembered_by
from vctune.simulation.firmware.operations import FLOATS
from vctune.simulation.mechanics import rigid_motion
from vctune.simulation.mechanics.assembly import Assembly, applied, sensing
from vctune.simulation.mechanics.assembly import transition as assembled_transition
from vctune.simulation.mechanics.intended_motion import push_matrix
from vctune.simulation.mechanics.rigid_motion import timing
from vctune.simulation.mechanics.step_inputs import (
    INTENDED,
    NEXT_INTENDED_VELOCITY,
)
from vctune.simulation.mechanics.step_symbols import acting, at_rest, sample_symbols, values_at
from vctune.simulation.mechanics.stretches import SYMBOLS, Stretch, fixed_steps, push_at
from vctune.simulation.scene import Scene

SAMPLES_PER_CALL = 1024  # Number of samples per call of the compiled function, and between two checks for divergence
# Columns that a simulation records at each sample: x, v, f_h, x_e, v_e, f_e, u, f_s
COLUMNS = ("position", "velocity", "force", "reference", "desired", "environment_force", "motor", "sensed")
MOTOR_COLUMNS = ("motor_position", "motor_velocity")  # Additional recorded columns if motor and handle move differently
MOTION = slice(INTENDED, NEXT_INTENDED_VELOCITY + 1)  # x_i and v_i at a sample and at the next, among the inputs


@dataclass(frozen=True, slots=True)
class Step:
    """A compiled step, advance(state, inputs) -> (state, record), and its state at the start of the motion."""

    advance: Any
    start: Floats

    def chunk(self) -> Any:
        """Return the function for `SAMPLES_PER_CALL` samples, samples(state, inputs) -> (states, records), with one
        column for each sample."""
        return self.advance.mapaccum(SAMPLES_PER_CALL)


def build(scene: Scene, stretch: Stretch = fixed_steps) -> Step:
    """Assemble and compile the step of a scene; `stretch` integrates the friction."""
    wired = sample_symbols(scene)
    mechanism, motion, inputs, body, begin = wired.mechanism, wired.motion, wired.inputs, wired.body, wired.begin
    memory = {field.name: ca.SX.sym(field.name) for field in fields(State)}
    remembered, command = control(scene.law, State(**memory), wired.measurement, SYMBOLS)
    used = remembered_by(scene.law)
    not_zero = {"reference": begin.reference, "measured": encoded(scene.law, begin.position, FLOATS)}
    answer = [remembered.reference, remembered.desired, command.environment, command.given]
    record = [motion.handle.x, motion.handle.v, motion.force, *answer, wired.measurement.force]
    record += [motion.motor.x, motion.motor.v] if scene.device.structure is not None else []
    commands, forces = [command.given, *wired.commands], [motion.sensed, *wired.unread]  # the newest first
    state = ca.vertcat(body, *(memory[name] for name in used), *wired.commands, *wired.unread, *wired.filtered)
    # the oldest command and the oldest force are no longer needed
    after = [getattr(remembered, name) for name in used]
    kept = ca.vertcat(*after, *commands[:-1], *forces[:-1], *wired.filtered_after)
    *_, late, early = acting(scene, commands)  # u[k-N] and u[k-N-1] of `Timing`
    start = [
        *at_rest(scene, mechanism, begin),
        *(not_zero.get(name, 0.0) for name in used),
        *(begin.motor for _ in wired.commands),
        *(begin.hand for _ in [*wired.unread, *wired.filtered]),
    ]
    if scene.friction is None:
        body_after = _body_after_without_friction(scene, mechanism, body, inputs, early, late)
        advance = ca.Function("one", [state, inputs], [ca.vertcat(body_after, kept), ca.vertcat(*record)])
    else:
        outputs = ca.Function("firmware", [state, inputs], [kept, ca.vertcat(*record), early, late])
        advance = _with_friction(scene, mechanism, scene.friction, stretch, outputs)
    return Step(advance, np.array(start))


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the recorded columns of a scene's step."""
    return COLUMNS if scene.device.structure is None else COLUMNS + MOTOR_COLUMNS


def _sensed_at(scene: Scene, mechanism: Assembly, time: float) -> Any:
    """Return the function (body, motor, push) -> sensed force [N], at a given time [s] after the sample."""
    body, motor, push = ca.SX.sym("body", mechanism.size + 1), ca.SX.sym("motor"), ca.SX.sym("push", 4)
    values = values_at(scene, ca.vertsplit(body), mechanism.size, motor, push_at(push, time))
    return ca.Function("felt", [body, motor, push], [applied(mechanism.sensed, values)])


def _body_after_without_friction(
    scene: Scene, mechanism: Assembly | None, body: Any, inputs: Any, early: Any, late: Any
) -> Any:
    """Return the body after a sample without friction, by matrix exponentials: `early` acts first, then `late`."""
    exact = rigid_motion.transition(scene) if mechanism is None else assembled_transition(scene, mechanism)
    after = ca.mtimes(ca.DM(exact.state), body) + ca.mtimes(ca.DM(exact.motion), inputs[MOTION])
    after = after + ca.DM(exact.late) * late
    return after + ca.DM(exact.early) * early if exact.early.any() else after


def _with_friction(scene: Scene, mechanism: Assembly | None, friction: Friction, stretch: Stretch, outputs: Any) -> Any:
    """Return the step of a device with friction."""
    T, early_ends, force_taken = scene.device.sample_time, timing(scene).early, sensing(scene).instant
    derivatives = ca.DM(push_matrix(scene.operator, T))
    state, inputs = ca.MX.sym("state", outputs.size_in(0)), ca.MX.sym("inputs", outputs.size_in(1))
    kept, record, early, late = outputs(state, inputs)
    push = ca.mtimes(derivatives, inputs[MOTION])
    # the moving parts (x and v of a single mass), and z of the friction
    body, sensed = state[: 3 if mechanism is None else mechanism.size + 1], []
    borders = {0.0, early_ends, T} | ({force_taken} if force_taken is not None else set())
    for begin, end in pairwise(sorted(borders)):
        motor = early if end <= early_ends else late
        body = stretch(scene, friction, begin, end - begin)(body, motor, push)
        if end == force_taken:
            assert mechanism is not None, "a device whose force is taken between samples is an assembly"
            sensed = [_sensed_at(scene, mechanism, end)(body, motor, push)]
    return ca.Function("one", [state, inputs], [ca.vertcat(body, *sensed, kept), record])
