"""Make the object of simulation.json and the arrays of traces.npz from simulated experiments."""

from __future__ import annotations

from dataclasses import asdict, fields
from math import isfinite
from typing import Any, Literal

import numpy as np

from vctune.document.reading import ProblemFile
from vctune.document.records.gains_json import GainsRecord, coupling_record, stated_units
from vctune.document.records.simulation_json import (
    EnvironmentRecord,
    ExperimentRecord,
    LeastVirtualRecord,
    MetricsRecord,
    RunRecord,
    SimulatedLoopRecord,
    SimulatedProblemRecord,
    SimulationRecord,
)
from vctune.document.text.digest import experiments_digest
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.mechanics.intended_motion import stroke_time
from vctune.simulation.run import Traces
from vctune.simulation.thinning import thinned
from vctune.simulation.two_runs import Run, Simulated
from vctune.version import __version__

TOLERANCE = 1.5e-3  # Share of the plotted range by which a thinned curve may differ from the original


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
        gains=GainsRecord(**asdict(gains)),
        coupling=coupling_record(coupling),
        experiments=[_experiment(one, device, coupling) for one in simulated],
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


def _experiment(simulated: Simulated, device: Device, coupling: AnyCoupling) -> ExperimentRecord:
    """Return the record of an experiment, with curves thinned to a tolerance."""
    experiment, pid = simulated.experiment, simulated.experiment.baseline
    least_share, runs = simulated.least_virtual, {"baseline": simulated.baseline, "design": simulated.design}
    quantity, cycle = axis(experiment.environment), 2 * stroke_time(experiment.operator)
    curves = {name: _curve(run.traces, quantity, cycle) for name, run in runs.items() if run is not None}
    x_range, y_range = (max(np.ptp(curve[k]) for curve in curves.values()) for k in (0, 1))
    tolerance = (TOLERANCE * x_range or 1.0, TOLERANCE * y_range or 1.0)
    virtual = None
    if least_share is not None and pid is not None:
        virtual = LeastVirtualRecord(share=least_share, mass=least_share * pid.mass, damping=least_share * pid.damping)
    baseline = None if simulated.baseline is None else _run(simulated.baseline, _thinned(curves["baseline"], tolerance))
    optional: dict[str, Any] = {}
    if isinstance(coupling, SpringDamper) and experiment.sensors.position_resolution > 0:
        optional["quiet_stiffness"] = quiet_stiffness(device, experiment)
    if experiment.operator.dwell is not None:
        optional["dwell_s"] = max(1, round(experiment.operator.dwell / device.sample_time)) * device.sample_time
    return ExperimentRecord(
        name=experiment.name,
        environment=EnvironmentRecord(**asdict(experiment.environment)),
        axis=quantity,
        samples=len(simulated.design.traces.time),
        least_virtual=virtual,
        baseline=baseline,
        design=_run(simulated.design, _thinned(curves["design"], tolerance)),
        **optional,
    )


def quiet_stiffness(device: Device, experiment: Experiment) -> float:
    """Return the greatest stiffness of a wall at which an impedance display with an encoder comes to rest, N/m."""
    coulomb = experiment.friction.coulomb if experiment.friction is not None else 0.0
    return min(2 * device.damping / device.sample_time, 2 * coulomb / experiment.sensors.position_resolution)


def axis(environment: Environment) -> Literal["position", "velocity"]:
    """Return the quantity of the horizontal axis for an environment's force: position for a spring, velocity
    otherwise."""
    return "position" if environment.stiffness > 0 else "velocity"


def _finite(number: float) -> float | None:
    return number if isfinite(number) else None


def _run(run: Run, curve: list[list[float]]) -> RunRecord:
    return RunRecord(
        diverged_s=run.traces.diverged,
        metrics=MetricsRecord(**asdict(run.metrics)) if run.metrics else None,
        loop=SimulatedLoopRecord(stable=run.mode.radius < 1, spectral_radius=run.mode.radius, hz=run.mode.hz),
        curve=curve,
    )


def _curve(traces: Traces, name: str, cycle: float) -> tuple[Floats, Floats]:
    """Return position or velocity, and the force at each of its values."""
    first = int(np.searchsorted(traces.time, cycle * (1 - 1e-9)))
    first = first if len(traces.time) - first > 1 else 0
    return getattr(traces, name)[first:], traces.force[first:]


def _thinned(curve: tuple[Floats, Floats], tolerance: tuple[float, float]) -> list[list[float]]:
    return [[float(f"{value:.5g}") for value in point] for point in np.transpose(curve)[thinned(*curve, tolerance)]]
