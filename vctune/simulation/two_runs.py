"""Simulate an experiment with the design and, if the experiment has a baseline, also with its regular PID."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.model.experiment import Experiment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.simulation.firmware.in_the_loop import Controller, Difference, run_in_the_loop
from vctune.simulation.mechanics.scene_stability import Mode, fastest_mode, least_virtual
from vctune.simulation.metrics import Metrics, metrics
from vctune.simulation.run import Traces, run
from vctune.simulation.scene import Scene, baseline_scene, designed_scene


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
    experiment : description of the experiment
    baseline, design : the two runs; baseline is None if the experiment states no regular PID
    least_virtual : least share of the baseline's virtual mass and damping with which its loop is stable; 0 if the loop
        is stable with almost no virtual mass and damping; None without a baseline, or if no tried share is stable
    difference : difference between the commands of an external firmware and the design's commands; None without an
        external firmware. `design.mode` always refers to the design's own firmware
    """

    experiment: Experiment
    baseline: Run | None
    design: Run
    least_virtual: float | None
    difference: Difference | None = None


def simulate(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    experiment: Experiment,
    progress: Callable[[str], None] = lambda stage: None,
    controller: Controller | None = None,
    tolerance: float | None = None,
) -> Simulated:
    """Simulate an experiment with the design and, if the experiment has a baseline, also with its regular PID."""

    def ran(scene: Scene, name: str) -> Run:
        """Return the run of the scene's own firmware."""
        return judged(scene, run(scene, lambda share: progress(f"{experiment.name}, {name} {share:.0%}")))

    def judged(scene: Scene, traces: Traces) -> Run:
        """Return a run from its traces, with its measures unless it diverged, and with the scene's linear stability."""
        measured = None
        if traces.diverged is None:
            measured = metrics(traces, experiment.environment, experiment.operator, experiment.limit, scene.law.command)
        return Run(traces, measured, fastest_mode(scene))

    scene, difference = designed_scene(problem.device, gains, coupling, experiment), None
    if controller is None:
        design = ran(scene, "design")
    else:
        traces, difference = run_in_the_loop(
            scene, controller, lambda share: progress(f"{experiment.name}, firmware {share:.0%}"), tolerance
        )
        design = judged(scene, traces)
    pid = experiment.baseline
    if pid is None:
        return Simulated(experiment, None, design, None, difference)
    baseline = ran(baseline_scene(problem.device, experiment, pid), "baseline")
    return Simulated(experiment, baseline, design, least_virtual(problem.device, experiment, pid), difference)
