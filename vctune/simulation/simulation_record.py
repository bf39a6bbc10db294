"""Make the object of simulation.json and the arrays of traces.npz from simulated experiments."""

from __future__ import annotations

from dataclasses import asdict, fields
from math import ceil
from typing import Any, Literal

import numpy as np

from vctune.document.reading import ProblemFile
from vctune.document.records.gains_json import stated_units
from vctune.document.records.simulation_json import (
    ExperimentRecord,
    MetricsRecord,
    MotionRecord,
    RunRecord,
    SimulatedLoopRecord,
    SimulatedProblemRecord,
    SimulationRecord,
)
from vctune.document.text.json import experiments_digest
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.run import Traces
from vctune.simulation.scene import evaluated_from, stroke_time
from vctune.simulation.two_runs import Run, Simulated
from vctune.version import __version__

# Greatest number of points of a curve: evenly spaced samples, of which traces.npz has all; of an oscillation every
# sample of the last ones
CURVE_POINTS, OF_OSCILLATION = 500, 2000


def simulation_record(
    file: ProblemFile, gains: Gains, coupling: AnyCoupling, simulated: list[Simulated]
) -> SimulationRecord:
    """Return the record of simulated experiments."""
    also: dict[str, Any] = {}
    device = file.problem.device
    if device.commanded != "force":
        also["commanded"] = device.commanded
    return SimulationRecord(
        problem=SimulatedProblemRecord(
            name=file.problem.name,
            sha256=file.sha256,
            experiments_sha256=experiments_digest(file.problem.experiments),
            **stated_units(device),
        ),
        gains=gains,
        coupling=coupling,
        experiments=[_experiment(one) for one in simulated],
        versions={"vctune": __version__},
        **also,
    )


def trace_arrays(simulated: list[Simulated]) -> dict[str, Floats]:
    """Return all traces by name. A name states experiment, run and quantity, as in "spring/design/force"."""
    return {
        f"{result.experiment.name}/{name}/{field.name}": values
        for result in simulated
        for name, run in (("baseline", result.baseline), ("design", result.design))
        if run is not None
        for field in fields(Traces)
        if field.name != "diverged" and (values := getattr(run.traces, field.name)) is not None
    }


def _experiment(simulated: Simulated) -> ExperimentRecord:
    """Return the record of an experiment."""
    experiment = simulated.experiment
    hand = experiment.operator
    quantity, begin = axis(experiment.environment), evaluated_from(hand) if hand.stays else 2 * stroke_time(hand)
    baseline, design = (
        None if run is None else _run(run, _curve(run, quantity, begin))
        for run in (simulated.baseline, simulated.design)
    )
    assert design is not None
    return ExperimentRecord(
        name=experiment.name,
        environment=experiment.environment,
        axis=quantity,
        samples=len(simulated.design.traces.time),
        baseline=baseline,
        design=design,
    )


def axis(environment: Environment) -> Literal["position", "velocity"]:
    """Return the quantity of the horizontal axis for an environment's force: position for a spring, velocity
    otherwise."""
    return "position" if environment.stiffness > 0 else "velocity"


def _run(run: Run, curve: list[list[float]]) -> RunRecord:
    return RunRecord(
        diverged_s=run.traces.diverged,
        metrics=MetricsRecord(**asdict(run.metrics)) if run.metrics else None,
        loop=SimulatedLoopRecord(stable=run.mode.radius < 1, spectral_radius=run.mode.radius, hz=run.mode.hz),
        motion=MotionRecord(**asdict(run.motion)) if run.motion else None,
        curve=curve,
    )


def _curve(run: Run, name: str, begin: float) -> list[list[float]]:
    """Return position or velocity, and the force at each of its values."""
    traces, oscillates = run.traces, run.motion is not None and run.motion.kind == "buzzes"
    first = int(np.searchsorted(traces.time, begin * (1 - 1e-9)))
    first = first if len(traces.time) - first > 1 else 0
    first = max(first, len(traces.time) - OF_OSCILLATION) if oscillates else first
    step = 1 if oscillates else ceil((len(traces.time) - first) / CURVE_POINTS)
    points = zip(getattr(traces, name)[first::step], traces.force[first::step], strict=True)
    return [[float(f"{value:.5g}") for value in point] for point in points]
