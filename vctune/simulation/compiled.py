"""Compile one sample of a scene into a function. This module imports casadi."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import casadi as ca
import numpy as np

from vctune.model.experiment import Friction
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.controller import FLOATS, Operations, at_rest, controller_of, encoded
from vctune.simulation.friction import Sliding, dry_step, friction_force, friction_step, slide, steps_per_sample
from vctune.simulation.plant import GIVEN, Plant, plant, row_times
from vctune.simulation.sample import begun, sampled, timing
from vctune.simulation.scene import Scene, equilibrium, push_matrix

CASADI_OPERATIONS = Operations(ca.exp, ca.expm1, ca.fabs, ca.floor, ca.fmin, ca.fmax, ca.if_else)
SAMPLES_PER_CALL = 1024  # Number of samples per call of the compiled function, and between two checks for divergence
# Inputs of a step: x_i [m] and v_i [m/s] at this sample and at the next, and the noise of the force sensor [N]
INPUT_NAMES = ("intended", "intended_velocity", "next_intended", "next_intended_velocity", "noise")
INTENDED, INTENDED_VELOCITY, NEXT_INTENDED, NEXT_INTENDED_VELOCITY, NOISE = range(len(INPUT_NAMES))


@dataclass(frozen=True, slots=True)
class Step:
    """A compiled step, advance(state, inputs) -> (state, record), and its state at the start of the motion."""

    advance: Any
    start: Floats

    def chunk(self) -> Any:
        """Return the function for `SAMPLES_PER_CALL` samples, with one column for each sample."""
        return self.advance.mapaccum(SAMPLES_PER_CALL)


def build(scene: Scene) -> Step:
    """Assemble and compile the step of a scene."""
    moving, begin = plant(scene.device, scene.operator), equilibrium(scene)
    sensed = begin.sensed(scene.device)
    c = controller_of(replace(scene.law, own_zero=sensed))
    rest = at_rest(c, encoded(c, sensed, FLOATS), begin.reference, begin.hand)
    start = begun(scene, moving, rest, begin)
    now = {name: [ca.SX.sym(f"{name}_{k}") for k in range(len(numbers))] for name, numbers in start.items()}
    inputs = ca.SX.sym("inputs", len(INPUT_NAMES))
    push = ca.vertsplit(ca.mtimes(ca.DM(push_matrix(scene.operator, scene.device.sample_time)), inputs[:NOISE]))
    given = push, inputs[NOISE] if scene.force_noise > 0 else 0.0

    def rubbing(velocity: Any, z: Any) -> Any:
        if scene.friction is None or scene.friction.dry:
            return z
        return friction_force(scene.friction, velocity, z, CASADI_OPERATIONS)[0]

    def move(values: list[Any], z: Any, held: Sequence[Any]) -> tuple[list[Any], Any, list[Any]]:
        """Move over a sample in which two commands act."""
        when, n, (late, early), between = timing(scene.device), len(moving.states), held, list[Any]()
        for begin, end in when.intervals(scene.device.sample_time):
            values[n + GIVEN.index("command")] = early if end <= when.early else late
            if scene.friction is None:
                change = moving.change(end - begin)
                values = [value + row_times(row, values) for value, row in zip(values, change, strict=True)]
            else:
                values, z = _slid(scene, scene.friction, moving, values, z, end - begin)
            if end == when.instant:
                felt = [*values]
                felt[n + GIVEN.index("friction")] = rubbing(values[1], z)
                between = [row_times(moving.sensed, felt)]
        return values, z, between

    after, record = sampled(scene, moving, (c, rest), now, given, rubbing, move, CASADI_OPERATIONS)
    names = ca.vertcat(*(symbol for symbols in now.values() for symbol in symbols))
    ends = ca.vertcat(*(number for numbers in after.values() for number in numbers))
    advance = ca.Function("one", [names, inputs], [ends, ca.vertcat(*record)])
    return Step(advance, np.array([number for numbers in start.values() for number in numbers], float))


def _slid(
    scene: Scene, friction: Friction, moving: Plant, values: list[Any], z: Any, length: float
) -> tuple[list[Any], Any]:
    """Return values and bristles after a part of a sample with friction."""
    # a rounding above a whole number must not add a step
    steps = steps_per_sample(friction, scene.device, scene.operator)
    count = max(1, ceil(steps * length / scene.device.sample_time * (1 - 1e-12)))
    symbols = ca.SX.sym("values", len(values) + 2)
    change = moving.change(length / count)
    *at, deflection, foreseen = ca.vertsplit(symbols)
    begin = Sliding(at, deflection, foreseen)
    if friction.dry:
        end = dry_step(change, friction.coulomb, begin, CASADI_OPERATIONS)
    else:
        end = friction_step(change, length / count, friction, begin, CASADI_OPERATIONS)
    compiled = ca.Function("slid", [symbols], [ca.vertcat(*end.values, end.z, end.foreseen)])

    def step(before: Sliding) -> Sliding:
        *after, z, foreseen = ca.vertsplit(compiled(ca.vertcat(*before.values, before.z, before.foreseen)))
        return Sliding(after, z, foreseen)

    last = Sliding(values, z, values[1])
    if not friction.dry:
        last = slide(step, last, count)
    else:
        for _ in range(count):
            last = step(last)
    return list(last.values), last.z
