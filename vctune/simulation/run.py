"""Simulate a scene from its first sample to its last, and return its traces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.compiled import (
    INPUT_NAMES,
    INTENDED,
    INTENDED_VELOCITY,
    NEXT_INTENDED,
    NEXT_INTENDED_VELOCITY,
    NOISE,
    SAMPLES_PER_CALL,
    build,
)
from vctune.simulation.sample import columns
from vctune.simulation.scene import Scene, intended_motion, sample_count

# A run has diverged if the distance of the handle from the intended motion exceeds this multiple of the
# hand's travel
DIVERGENCE = 1e3
POSITION = 0  # Column of the handle's position in the records (`vctune.simulation.sample.columns`)


@dataclass(frozen=True, slots=True)
class Traces:
    """The recorded samples of a run; all arrays have the same length."""

    time: Floats  # time of the samples, s
    intended: Floats  # intended motion x_i, m
    position: Floats  # motion of the handle, m, m/s
    velocity: Floats
    force: Floats  # f_h, the hand's force on the handle, N
    reference: Floats  # x_e and v_e of the rendered environment, m, m/s
    desired: Floats
    environment_force: Floats  # f_e, N
    motor: Floats  # u, the command: a force, N; for a servo a velocity, m/s, or a position, m
    sensed: Floats  # f_s, the force that the firmware reads, N: the sensed f_h with noise
    diverged: float | None  # time, s, at which the run diverged and the traces end; None if the run did not diverge
    motor_position: Floats | None = None  # motion of the motor, which carries the encoder, m, m/s
    motor_velocity: Floats | None = None


def run(scene: Scene, progress: Callable[[float], None] = lambda share: None) -> Traces:
    """Simulate a scene."""
    samples = sample_count(scene.operator, scene.device.sample_time)
    with interrupt_deferred():
        step = build(scene)
        chunk = step.chunk()
    recorded = np.empty((samples, len(columns(scene.device))))
    intended = np.empty(samples)
    noise = np.random.default_rng(scene.seed)
    state, done, diverged = step.start, 0, False
    while done < samples and not diverged:
        count = min(SAMPLES_PER_CALL, samples - done)
        inputs = motion_inputs(scene, done, noise)
        with interrupt_deferred():
            states, records = chunk(state, inputs)
        state = np.asarray(states)[:, -1]
        block = recorded[done : done + count] = np.asarray(records).T[:count]
        intended[done : done + count] = inputs[INTENDED, :count]
        diverged = has_diverged(scene, block, intended[done : done + count])
        done += count
        progress(done / samples)
    return traces_of(scene, recorded[:done], intended[:done], diverged=diverged)


def has_diverged(scene: Scene, recorded: Floats, intended: Floats) -> bool:
    """Return whether a run has diverged (`DIVERGENCE`), or has numbers that are not finite."""
    reach = DIVERGENCE * scene.operator.travel
    return not (np.isfinite(recorded).all() and np.abs(recorded[:, POSITION] - intended).max() <= reach)


def motion_inputs(scene: Scene, first: int, noise: np.random.Generator) -> Floats:
    """Return the inputs of a scene's step for `SAMPLES_PER_CALL` samples from `first` on, one column for each
    sample."""
    motion = intended_motion(scene.operator, scene.device.sample_time, first, first + SAMPLES_PER_CALL)
    inputs = np.zeros((len(INPUT_NAMES), SAMPLES_PER_CALL))
    inputs[INTENDED], inputs[NEXT_INTENDED] = motion.position[:-1], motion.position[1:]
    inputs[INTENDED_VELOCITY], inputs[NEXT_INTENDED_VELOCITY] = motion.velocity[:-1], motion.velocity[1:]
    if scene.force_noise > 0:
        inputs[NOISE] = noise.normal(0.0, scene.force_noise, SAMPLES_PER_CALL)
    return inputs


def traces_of(scene: Scene, recorded: Floats, intended: Floats, *, diverged: bool) -> Traces:
    """Return the record as traces. If the run diverged, the traces contain only the samples before the divergence."""
    T, began = scene.device.sample_time, None
    if diverged:
        travel = scene.operator.travel
        distance = np.where(np.isfinite(recorded).all(axis=1), np.abs(recorded[:, POSITION] - intended), np.inf)
        limit = travel if (distance <= travel).any() else DIVERGENCE * travel
        near = np.flatnonzero(distance <= limit)
        length = int(near[-1]) + 1 if near.size else 1
        recorded, intended, began = recorded[:length], intended[:length], length * T
    traced = dict(zip(columns(scene.device), recorded.T, strict=True))
    return Traces(time=np.arange(len(intended)) * T, intended=intended, **traced, diverged=began)
