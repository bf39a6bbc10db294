"""A scene with an external firmware: sample by sample, beside the design's own on the same measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Protocol

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.simulation.firmware.controller import coefficients_of, encoded
from vctune.simulation.firmware.operations import FLOATS
from vctune.simulation.firmware.stepped import Precision, Start, SteppedFirmware, exported_parts
from vctune.simulation.mechanics.hand_changes import called, hand_changes, moved_on, steps_of_hands
from vctune.simulation.mechanics.intended_motion import Floats, sample_count
from vctune.simulation.mechanics.step import ANSWER, CHUNK, OpenStep, build_open, columns
from vctune.simulation.run import DIVERGENCE, Traces, motion_inputs, traces_of
from vctune.simulation.scene import Scene, equilibrium

REWRITTEN = 1e-9
"""Share of the greatest command by which firmware in double precision may differ. Another order of the operations makes
some 1e-12, a constant in seven correct digits 1e-7."""
ROUNDED = 2.0
"""Factor on the effect of single precision in the design's own commands by which firmware in it may differ, as in
replay.c."""


class Controller(Protocol):
    """A firmware that is called sample by sample; `precision` is that of its numbers."""

    @property
    def precision(self) -> Precision: ...

    def start(self, scene: Scene) -> None:
        """Begin a run of a scene."""

    def step(self, measured: Floats) -> Floats:
        """Return x_e [m], v_e [m/s], f_e and u [N] for position [m], velocity [m/s] and force [N]."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference of a firmware's commands from the design's, both in its precision, on the same measurements.

    Attributes
    ----------
    force : the greatest difference, N
    time : time of that sample, s
    tolerance : the greatest difference that passes, N
    precision : precision of the firmware
    """

    force: float
    time: float
    tolerance: float
    precision: Precision

    @property
    def passes(self) -> bool:
        """Whether the commands are those of the design, except for rounding."""
        return isfinite(self.force) and self.force <= self.tolerance


@np.errstate(all="ignore")
def run_in_the_loop(
    scene: Scene,
    controller: Controller,
    progress: Callable[[float], None] = lambda share: None,
    tolerance: float | None = None,
) -> tuple[Traces, Difference]:
    """Simulate a scene with a firmware instead of its law.

    Parameters
    ----------
    scene : device, operator, friction and the design's own firmware
    controller : the firmware
    progress : function that receives the share of the finished samples
    tolerance : greatest difference of a command that passes, in its unit; None for the effect of rounding

    Returns
    -------
    traces : finite; a run that diverges ends where the divergence began
    difference : difference from the design's own commands
    """
    samples, T = sample_count(scene.operator, scene.device.sample_time), scene.device.sample_time
    with interrupt_deferred():
        steps = steps_of_hands(scene, lambda now, then: build_open(now, then=then))
    beside, noise = _Beside(scene, controller.precision), np.random.default_rng(scene.seed)
    recorded, wanted = np.empty((samples, len(columns(scene)))), np.empty(samples)
    reach = DIVERGENCE * abs(scene.operator.end - scene.operator.start)
    controller.start(scene)
    changes, grip = hand_changes(scene), 0.0
    state, done, diverged = steps[0, 0].start, 0, False
    given, own, exact = np.zeros((3, samples))
    while done < samples and not diverged:
        count = min(CHUNK, samples - done)
        inputs = motion_inputs(scene, done, noise)
        for k in range(count):
            at = done + k
            step, regrips = steps[changes.hands(at)], changes.regrips and changes.at(at)
            sampled = _sample(step, controller, state, inputs[:, k], grip, regrips=regrips)
            state, recorded[at], grip, measured, given[at] = sampled
            own[at], exact[at] = beside.commands(measured)
        block = recorded[done : done + count]
        wanted[done : done + count] = inputs[0, :count]
        done += count
        diverged = not (np.isfinite(block).all() and np.abs(block[:, 0] - inputs[0, :count]).max() <= reach)
        progress(done / samples)
    traces = traces_of(scene, recorded[:done], wanted[:done], diverged=diverged)
    given, own, exact = (commands[: len(traces.time)] for commands in (given, own, exact))
    apart = np.abs(given - own)
    if tolerance is None:
        single = controller.precision == "single"
        tolerance = float(ROUNDED * np.abs(own - exact).max() if single else REWRITTEN * np.abs(own).max())
    at = int(apart.argmax())
    return traces, Difference(float(apart[at]), at * T, tolerance, controller.precision)


def _sample(
    step: OpenStep, controller: Controller, state: Floats, inputs: Floats, grip: float, *, regrips: bool
) -> tuple[Floats, Floats, float, Floats, float]:
    """Return state, record, the hand's grip, measurement and command of one sample."""
    with interrupt_deferred():
        held = inputs.copy()
        held[[0, 2]] += grip
        measured = np.asarray(step.sense(state, held)).ravel()
        answer = controller.step(measured)
        one = called(step.one, state)
        moved = moved_on(lambda given: one(np.concatenate([given, answer])), inputs, grip, regrips=regrips)
    return *moved, measured, float(answer[ANSWER.index("motor")])


class _Beside:
    """The design's own firmware on the other one's measurements, in its precision and in double."""

    def __init__(self, scene: Scene, precision: Precision) -> None:
        begin, law = equilibrium(scene), scene.law
        start = Start(law.environment, law.limit, encoded(law, begin.position, FLOATS), begin.reference)
        parts, coefficients = exported_parts(law), coefficients_of(law)
        self._own = SteppedFirmware(parts, coefficients, start, precision)
        self._exact = SteppedFirmware(parts, coefficients, start, "double") if precision != "double" else None

    def commands(self, measured: Floats) -> tuple[float, float]:
        """Return the force that the design commands, in either precision, after position, velocity and force."""
        read = measured.tolist()
        own = self._own.command(read)
        return own, own if self._exact is None else self._exact.command(read)
