"""Simulate an experiment with the design and, if the experiment has a baseline, also with its regular PID."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.experiment import Experiment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.simulation.metrics import Metrics, metrics
from vctune.simulation.run import Traces, run
from vctune.simulation.scene import Scene, baseline_scene, designed_scene
from vctune.simulation.stability import Mode, fastest_mode


@dataclass(frozen=True, slots=True)
class Run:
    """One controller in one experiment."""

    traces: Traces  # the recorded samples
    metrics: Metrics | None  # measures of the run; None if the run diverged
    mode: Mode


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
        traces, measured = run(scene, lambda share: progress(f"{experiment.name}, {name} {share:.0%}")), None
        if traces.diverged is None:
            measured = metrics(traces, experiment.environment, experiment.operator, experiment.limit, scene.law.command)
        return Run(traces, measured, fastest_mode(scene))

    design = ran(designed_scene(problem.device, gains, coupling, experiment), "design")
    pid = experiment.baseline
    if pid is None:
        return Simulated(experiment, None, design)
    baseline = ran(baseline_scene(problem.device, experiment, pid), "baseline")
    return Simulated(experiment, baseline, design)
