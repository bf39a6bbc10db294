"""Simulate a scene from its first sample to its last, and return its traces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.simulation.mechanics.hand_changes import called, hand_changes, moved_on, steps_of_hands
from vctune.simulation.mechanics.intended_motion import Floats, intended_motion, sample_count
from vctune.simulation.mechanics.step import CHUNK, INPUTS, build, columns
from vctune.simulation.mechanics.stretches import Stretch, fixed_steps
from vctune.simulation.scene import Scene

DIVERGENCE = 1e3
"""A run has diverged if the distance of the handle from its target exceeds this multiple of the hand's travel. No
stable loop comes near this distance. An unstable loop passes half and twice this distance within a few samples."""


@dataclass(frozen=True, slots=True)
class Traces:
    """The recorded samples of a run; all arrays have the same length.

    Attributes
    ----------
    time : time of the samples, s
    intended : target position of the hand, m
    position, velocity : motion of the handle, m, m/s; without a spring between them also that of the motor
    force : f_h, the hand's force on the handle, N
    reference, desired : x_e and v_e of the rendered environment, m, m/s
    environment_force : f_e, N
    motor : u, the command: a force, N; for a servo a velocity, m/s, or a position, m
    sensed : f_s, the sensed f_h with noise, N
    diverged : time, s, at which the run diverged and the traces end; None if it did not diverge
    motor_position, motor_velocity : motion of the firmware's encoder, m, m/s; None if it moves like the handle
    """

    time: Floats
    intended: Floats
    position: Floats
    velocity: Floats
    force: Floats
    reference: Floats
    desired: Floats
    environment_force: Floats
    motor: Floats
    sensed: Floats
    diverged: float | None
    motor_position: Floats | None = None
    motor_velocity: Floats | None = None


def run(scene: Scene, progress: Callable[[float], None] = lambda share: None, stretch: Stretch = fixed_steps) -> Traces:
    """Simulate a scene.

    Parameters
    ----------
    scene : device, operator, friction and firmware
    progress : function that receives the share of the finished samples
    stretch : function that integrates the friction; not used without friction, where the motion is exact

    Returns
    -------
    Traces
        Finite numbers; the traces of a run that diverges end where the divergence begins.
    """
    if scene.operator.changes:
        return _run_changing(scene, progress, stretch)
    samples = sample_count(scene.operator, scene.device.sample_time)
    with interrupt_deferred():
        step = build(scene, stretch)
        chunk = step.chunk()
    recorded = np.empty((samples, len(columns(scene))))
    wanted = np.empty(samples)
    noise = np.random.default_rng(scene.seed)
    reach = DIVERGENCE * abs(scene.operator.end - scene.operator.start)
    state, done, diverged = step.start, 0, False
    while done < samples and not diverged:
        count = min(CHUNK, samples - done)
        inputs = motion_inputs(scene, done, noise)
        with interrupt_deferred():
            states, records = chunk(state, inputs)
        state = np.asarray(states)[:, -1]
        block = recorded[done : done + count] = np.asarray(records).T[:count]
        wanted[done : done + count] = inputs[0, :count]
        done += count
        diverged = not (np.isfinite(block).all() and np.abs(block[:, 0] - inputs[0, :count]).max() <= reach)
        progress(done / samples)
    return traces_of(scene, recorded[:done], wanted[:done], diverged=diverged)


def _run_changing(scene: Scene, progress: Callable[[float], None], stretch: Stretch) -> Traces:
    """Simulate a scene whose hand changes, sample by sample."""
    samples, changes = sample_count(scene.operator, scene.device.sample_time), hand_changes(scene)
    with interrupt_deferred():
        steps = steps_of_hands(scene, lambda now, then: build(now, stretch, then))
    recorded, wanted = np.empty((samples, len(columns(scene)))), np.empty(samples)
    noise, reach = np.random.default_rng(scene.seed), DIVERGENCE * abs(scene.operator.end - scene.operator.start)
    state, grip, done, diverged = steps[0, 0].start, 0.0, 0, False
    while done < samples and not diverged:
        count, inputs = min(CHUNK, samples - done), motion_inputs(scene, done, noise)
        with interrupt_deferred():
            for at in range(done, done + count):
                one = called(steps[changes.hands(at)].one, state)
                regrips = changes.regrips and changes.at(at)
                state, recorded[at], grip = moved_on(one, inputs[:, at - done], grip, regrips=regrips)
        wanted[done : done + count] = inputs[0, :count]
        block = recorded[done : done + count]
        done += count
        diverged = not (np.isfinite(block).all() and np.abs(block[:, 0] - inputs[0, :count]).max() <= reach)
        progress(done / samples)
    return traces_of(scene, recorded[:done], wanted[:done], diverged=diverged)


def motion_inputs(scene: Scene, first: int, noise: np.random.Generator) -> Floats:
    """Return the inputs of a scene's step for `CHUNK` samples, beginning at `first`, with a column for each sample.

    Parameters
    ----------
    scene : the scene of the run
    first : index of the first sample
    noise : generator of the force sensor's noise; it advances by `CHUNK` samples if there is noise

    Returns
    -------
    array
        Shape (`INPUTS`, `CHUNK`).
    """
    motion = intended_motion(scene.operator, scene.device.sample_time, first, first + CHUNK)
    inputs = np.zeros((INPUTS, CHUNK))
    inputs[0], inputs[2] = motion.position[:-1], motion.position[1:]
    inputs[1], inputs[3] = motion.velocity[:-1], motion.velocity[1:]
    if scene.force_noise > 0:
        inputs[4] = noise.normal(0.0, scene.force_noise, CHUNK)
    return inputs


def traces_of(scene: Scene, recorded: Floats, wanted: Floats, *, diverged: bool) -> Traces:
    """Return the record as traces. If the run diverged, the traces contain only the samples before the divergence.

    Parameters
    ----------
    scene : scene of the run
    recorded : records of `columns`, one row for each sample
    wanted : intended position at each of these samples, m
    diverged : whether the handle left the hand's travel
    """
    T, began = scene.device.sample_time, None
    if diverged:
        travel = abs(scene.operator.end - scene.operator.start)
        near = np.flatnonzero(np.isfinite(recorded).all(axis=1) & (np.abs(recorded[:, 0] - wanted) <= travel))
        length = int(near[-1]) + 1 if near.size else 1
        recorded, wanted, began = recorded[:length], wanted[:length], length * T
    traced = dict(zip(columns(scene), recorded.T, strict=True))
    return Traces(time=np.arange(len(wanted)) * T, intended=wanted, **traced, diverged=began)
