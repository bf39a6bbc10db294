"""Run a scene with an external firmware, and run the design's own firmware on the same measurements for comparison."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Protocol

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.firmware.controller import coefficients_of, encoded
from vctune.simulation.firmware.operations import FLOATS
from vctune.simulation.firmware.stepped import Precision, Start, SteppedFirmware, exported_parts
from vctune.simulation.mechanics.hand_changes import after_sample, from_state, hand_changes, steps_of_hands
from vctune.simulation.mechanics.intended_motion import sample_count
from vctune.simulation.mechanics.step import FIRMWARE_OUTPUTS, SAMPLES_PER_CALL, OpenStep, build_open, columns
from vctune.simulation.mechanics.step_inputs import INTENDED, held_at
from vctune.simulation.run import Traces, has_diverged, motion_inputs, traces_of
from vctune.simulation.scene import Scene, equilibrium

REWRITTEN = 1e-9  # Greatest permitted difference of a firmware in double precision, as a share of the greatest command
# Factor by which the difference of a firmware in single precision may exceed the effect of single precision on the
# design's own commands. replay.c uses the same factor
ROUNDED = 2.0


class Controller(Protocol):
    """A firmware that the simulation calls for each sample. `precision` is the precision of its arithmetic."""

    @property
    def precision(self) -> Precision: ...

    def start(self, scene: Scene) -> None:
        """Begin a run of a scene."""

    def step(self, measured: Floats) -> Floats:
        """Return x_e [m], v_e [m/s], f_e [N] and u [N, or m/s or m for a servo], given position [m], velocity [m/s] and
        force [N]. The order is that of `FIRMWARE_OUTPUTS`."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference between a firmware's commands and the design's commands for the same measurements, in the
    firmware's precision."""

    force: float  # greatest difference, in the unit of the command
    time: float  # time of the sample with the greatest difference, s
    tolerance: float  # greatest permitted difference, in the unit of the command
    precision: Precision  # precision of the firmware

    @property
    def passes(self) -> bool:
        """Whether the commands of firmware and design agree, except for rounding."""
        return isfinite(self.force) and self.force <= self.tolerance


@np.errstate(all="ignore")
def run_in_the_loop(
    scene: Scene,
    controller: Controller,
    progress: Callable[[float], None] = lambda share: None,
    tolerance: float | None = None,
) -> tuple[Traces, Difference]:
    """Simulate a scene with a firmware instead of the scene's law."""
    samples, T = sample_count(scene.operator, scene.device.sample_time), scene.device.sample_time
    with interrupt_deferred():
        steps = steps_of_hands(scene, lambda now, then: build_open(now, then=then))
    own_firmware, noise = _OwnFirmware(scene, controller.precision), np.random.default_rng(scene.seed)
    recorded, (intended, aims) = np.empty((samples, len(columns(scene)))), np.empty((2, samples))
    controller.start(scene)
    changes, grip = hand_changes(scene), 0.0
    state, done, diverged = steps[0, 0].start, 0, False
    external, own_rounded, own_exact = np.zeros((3, samples))
    while done < samples and not diverged:
        count = min(SAMPLES_PER_CALL, samples - done)
        inputs = motion_inputs(scene, done, noise)
        for k in range(count):
            at = done + k
            step, regrips = steps[changes.hands(at)], changes.regrips and changes.changes_after(at)
            aims[at] = inputs[INTENDED, k] + grip
            sampled = _sample(step, controller, state, inputs[:, k], grip, regrips=regrips)
            state, recorded[at], grip, measured, external[at] = sampled
            own_rounded[at], own_exact[at] = own_firmware.commands(measured)
        intended[done : done + count] = inputs[INTENDED, :count]
        diverged = has_diverged(scene, recorded[done : done + count], aims[done : done + count])
        done += count
        progress(done / samples)
    traces = traces_of(scene, recorded[:done], intended[:done], aims[:done], diverged=diverged)
    external, own_rounded, own_exact = (commands[: len(traces.time)] for commands in (external, own_rounded, own_exact))
    differences = np.abs(external - own_rounded)
    if tolerance is None:
        single = controller.precision == "single"
        tolerance = float(
            ROUNDED * np.abs(own_rounded - own_exact).max() if single else REWRITTEN * np.abs(own_rounded).max()
        )
    at = int(differences.argmax())
    return traces, Difference(float(differences[at]), at * T, tolerance, controller.precision)


def _sample(
    step: OpenStep, controller: Controller, state: Floats, inputs: Floats, grip: float, *, regrips: bool
) -> tuple[Floats, Floats, float, Floats, float]:
    """Return the state and the hand's grip after a sample, and the sample's record, measurement and command."""
    with interrupt_deferred():
        measured = np.asarray(step.sense(state, held_at(inputs, grip))).ravel()
        answer = controller.step(measured)
        advance = from_state(step.advance, state)
        after = after_sample(
            lambda held_inputs: advance(np.concatenate([held_inputs, answer])), inputs, grip, regrips=regrips
        )
    return *after, measured, float(answer[FIRMWARE_OUTPUTS.index("motor")])


class _OwnFirmware:
    """The design's own firmware, which runs on the measurements of an external firmware, in the precision of that
    firmware and in double precision."""

    def __init__(self, scene: Scene, precision: Precision) -> None:
        begin, law = equilibrium(scene), scene.law
        start = Start(law.environment, law.limit, encoded(law, begin.position, FLOATS), begin.reference)
        parts, coefficients = exported_parts(law), coefficients_of(law)
        self._rounded = SteppedFirmware(parts, coefficients, start, precision)
        self._exact = SteppedFirmware(parts, coefficients, start, "double") if precision != "double" else None

    def commands(self, measured: Floats) -> tuple[float, float]:
        """Return the design's command in the firmware's precision and in double precision, given position, velocity and
        force."""
        read = measured.tolist()
        rounded = self._rounded.command(read)
        return rounded, rounded if self._exact is None else self._exact.command(read)
