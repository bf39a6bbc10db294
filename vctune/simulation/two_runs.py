"""Simulate an experiment with the design and, if the experiment has a baseline, also with its regular PID."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.model.experiment import Experiment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.problem import Problem
from vctune.simulation.metrics import Metrics, metrics
from vctune.simulation.oscillation import Motion, at_rest, motion_of
from vctune.simulation.run import Traces, run
from vctune.simulation.scene import Scene, baseline_scene, designed_scene, evaluated_from, stroke_time
from vctune.simulation.together import matrices_of

# Distance from 1 within which an eigenvalue belongs to a position without a restoring force, not to an oscillation
STANDING = 1e-6


@dataclass(frozen=True, slots=True)
class Mode:
    """The fastest growing, or slowest decaying, mode of a sampled loop: its factor per sample, and its frequency."""

    radius: float
    hz: float


def fastest_mode(scene: Scene) -> Mode:
    """Return the mode that decides whether hand, device and environment oscillate together.

    The loop has no friction, quantisation, limit and noise. Before a wall, it is the worse of contact and release."""
    rendered = scene.law.environment
    environments = [replace(rendered, wall=False)]
    if rendered.wall:
        environments.append(replace(rendered, damping=0.0, stiffness=0.0, zero=0.0, wall=False))
    modes, hand = [], Hand(scene.operator.mass, scene.operator.damping, scene.operator.stiffness)
    for environment in environments:
        law = replace(scene.law, position_resolution=0.0, limit=None, environment=environment)
        linear = replace(scene, friction=None, force_noise=0.0, force_resolution=0.0, law=law)
        values = np.linalg.eigvals(matrices_of(linear, [hand])[0])
        counted = values[np.abs(values - 1) > STANDING]
        dominant = counted[np.argmax(np.abs(counted))]
        modes.append(Mode(float(abs(dominant)), float(abs(np.angle(dominant)) / (2 * pi * scene.device.sample_time))))
    return max(modes, key=lambda mode: mode.radius)


@dataclass(frozen=True, slots=True)
class Run:
    """One controller in one experiment."""

    traces: Traces  # the recorded samples
    metrics: Metrics | None  # measures of the run; None if the run diverged
    mode: Mode
    motion: Motion | None  # what the handle does; None if the run diverged

    @property
    def calm(self) -> bool:
        """Whether the run neither diverges nor goes on oscillating."""
        return self.motion is not None and self.motion.kind != "buzzes"


@dataclass(frozen=True, slots=True)
class Simulated:
    """The results of a simulated experiment.

    Attributes
    ----------
    experiment : Experiment
        Description of the experiment.
    baseline, design : Run, optional and Run
        The two runs; baseline is None if the experiment states no regular PID.
    """

    experiment: Experiment
    baseline: Run | None
    design: Run


def simulate(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    experiment: Experiment,
    progress: Callable[[str], None] = lambda stage: None,
) -> Simulated:
    """Simulate an experiment with the design and, if the experiment has a baseline, also with its regular PID."""

    def ran(scene: Scene, name: str) -> Run:
        """Return a run with its measures, unless it diverged, and with the scene's linear stability."""
        traces = run(scene, lambda share: progress(f"{experiment.name}, {name} {share:.0%}"))
        measured, motion = None, None
        if traces.diverged is None:
            law, hand = scene.law, experiment.operator
            measured = metrics(traces, law.environment, hand, law.limit, law.command, law.coupling)
            last, count = traces.time >= evaluated_from(hand), experiment.sensors.position_resolution
            if hand.stays:
                motion = at_rest(traces, last, hand.travel, count)
            else:
                cycle = 2 * stroke_time(hand)
                motion = motion_of(traces.position[last], law.sample_time, cycle, hand.travel, count)
        return Run(traces, measured, fastest_mode(scene), motion)

    design = ran(designed_scene(problem.device, gains, coupling, experiment), "design")
    pid = experiment.baseline
    if pid is None:
        return Simulated(experiment, None, design)
    baseline = ran(baseline_scene(problem.device, experiment, pid), "baseline")
    return Simulated(experiment, baseline, design)
