"""A scene whose firmware is somebody else's: sample by sample, beside the design's own on the same measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.simulation.arithmetic import FLOATS
from vctune.simulation.controller import Measurement, State, control, encoded
from vctune.simulation.motion import Floats, sample_count
from vctune.simulation.run import DIVERGENCE, Traces, motion_inputs, traces_of
from vctune.simulation.scene import Scene, equilibrium
from vctune.simulation.step import ANSWER, CHUNK, OpenStep, build_open, columns


class Controller(Protocol):
    """A firmware that is called sample by sample."""

    def start(self, scene: Scene) -> None:
        """Begin a run of a scene."""

    def step(self, measured: Floats) -> Floats:
        """Return x_e [m], v_e [m/s], f_e and u [N] for position [m], velocity [m/s] and force [N]."""


@dataclass(frozen=True, slots=True)
class Difference:
    """By how much a firmware's command differs at most from that of the design, both on what was measured.

    Attributes
    ----------
    force : N
    time : when, s
    """

    force: float
    time: float


def run_in_the_loop(
    scene: Scene, controller: Controller, progress: Callable[[float], None] = lambda share: None
) -> tuple[Traces, Difference]:
    """Simulate a scene with a firmware in the place of its law.

    Parameters
    ----------
    scene : Scene
    controller : the firmware
    progress : told the share of the samples that is done

    Returns
    -------
    traces : finite; a run that diverges ends where it began to
    difference : from the design's own commands
    """
    samples, T = sample_count(scene.operator, scene.device.sample_time), scene.device.sample_time
    with interrupt_deferred():
        step = build_open(scene)
    beside, noise = _Beside(scene), np.random.default_rng(scene.seed)
    recorded, wanted = np.empty((samples, len(columns(scene)))), np.empty(samples)
    reach = DIVERGENCE * abs(scene.operator.end - scene.operator.start)
    controller.start(scene)
    state, done, diverged = step.start, 0, False
    apart = np.zeros(samples)
    while done < samples and not diverged:
        count = min(CHUNK, samples - done)
        inputs = motion_inputs(scene, done, noise)
        for k in range(count):
            state, recorded[done + k], measured, command = _sample(step, controller, state, inputs[:, k])
            apart[done + k] = abs(command - beside.command(measured))
        block = recorded[done : done + count]
        wanted[done : done + count] = inputs[0, :count]
        done += count
        diverged = not (np.isfinite(block).all() and np.abs(block[:, 0] - inputs[0, :count]).max() <= reach)
        progress(done / samples)
    traces = traces_of(scene, recorded[:done], wanted[:done], diverged=diverged)
    apart = apart[: len(traces.time)]
    at = int(apart.argmax())
    return traces, Difference(float(apart[at]), at * T)


def _sample(
    step: OpenStep, controller: Controller, state: Floats, inputs: Floats
) -> tuple[Floats, Floats, Floats, float]:
    """Return state, record and what was measured and commanded of one sample."""
    with interrupt_deferred():
        measured = np.asarray(step.sense(state, inputs)).ravel()
        answer = controller.step(measured)
        after, record = step.one(state, np.concatenate([inputs, answer]))
    return np.asarray(after).ravel(), np.asarray(record).ravel(), measured, float(answer[ANSWER.index("motor")])


class _Beside:
    """The design's own firmware, which sees what the other one sees."""

    def __init__(self, scene: Scene) -> None:
        begin, self._law = equilibrium(scene), scene.law
        position = encoded(scene.law, begin.position, FLOATS)
        self._state = State(begin.reference, 0.0, 0.0, 0.0, position, 0.0, 0.0)

    def command(self, measured: Floats) -> float:
        """Return the force that the design commands to position, velocity and force."""
        self._state, command = control(self._law, self._state, Measurement(*measured.tolist()), FLOATS)
        return float(command.force)
