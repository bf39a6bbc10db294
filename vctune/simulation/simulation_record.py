"""Simulated experiments: the object of simulation.json, and the arrays of traces.npz."""

from __future__ import annotations

from dataclasses import fields
from math import ceil
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from vctune.document.reading import ProblemFile, parse_problem
from vctune.document.records.gains_json import AnyCouplingRecord, ProblemRecord, stated_units
from vctune.document.records.part import Nullable, RecordPart
from vctune.document.text.json import SealedDocument, as_record, experiments_digest, read_json
from vctune.model.experiment import Environment
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.arithmetic import Floats
from vctune.model.numbers.units import UNITS, Units, UnitSystem
from vctune.simulation.metrics import Metrics
from vctune.simulation.oscillation import Motion
from vctune.simulation.run import Traces
from vctune.simulation.scene import evaluated_from, stroke_time
from vctune.simulation.two_runs import Run, Simulated
from vctune.version import __version__

# Greatest number of points of a curve: evenly spaced samples, of which traces.npz has all; of an oscillation every
# sample of the last ones
CURVE_POINTS, OF_OSCILLATION = 500, 2000
FILE = "simulation.json"
MAX_BYTES = 100_000_000
KIND = "a simulation.json of `vctune simulate`"


class SimulatedProblemRecord(RecordPart):
    """The problem: its name, its digest, the digest of its experiments, and the motion of its device."""

    name: str
    sha256: str
    experiments_sha256: str
    units: UnitSystem = "linear"


class SimulatedLoopRecord(RecordPart):
    """The linear sampled loop of device, hand and environment."""

    stable: bool
    spectral_radius: Nullable
    hz: float


class RunRecord(RecordPart):
    """One controller in one experiment."""

    diverged_s: Nullable  # time at which the run diverged, s; null if it did not
    metrics: Metrics | None  # measures; null if the run diverged
    loop: SimulatedLoopRecord  # linear loop of this controller
    motion: Motion | None = None  # what the trace does; null if the run diverged
    curve: Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=1)]


class ExperimentRecord(RecordPart):
    """An experiment with the runs of the regular PID and of the design."""

    name: str
    environment: Environment
    axis: Literal["position", "velocity"]  # quantity of the horizontal axis of the curves
    samples: int  # number of samples of the design's run
    baseline: RunRecord | None
    design: RunRecord


class SimulationRecord(SealedDocument):
    """Simulated experiments, in SI units and hertz: the object of simulation.json."""

    SCHEMA = "vctune/simulation/1"

    problem: SimulatedProblemRecord
    gains: Gains
    coupling: AnyCouplingRecord
    experiments: Annotated[list[ExperimentRecord], Field(min_length=1)]
    versions: dict[str, str | None]
    commanded: Literal["velocity", "position"] | None = None

    @property
    def units(self) -> Units:
        """The units of the record."""
        return UNITS[self.problem.units]

    @property
    def command_unit(self) -> str:
        """The unit of the firmware's command: a force, or for a servo a velocity or a position."""
        return {"velocity": self.units.speed, "position": self.units.position, None: self.units.force}[self.commanded]

    def is_of(self, problem: ProblemRecord, gains: Gains | None, coupling: AnyCoupling | None) -> bool:
        """Return whether a simulation belongs to the problem and the design of a design.json, and used no other
        controller."""
        if self.problem.sha256 != problem.sha256 or (self.gains, self.coupling) != (gains, coupling):
            return False
        experiments = parse_problem(problem.text, problem.name, problem.name).experiments
        return self.problem.experiments_sha256 == experiments_digest(experiments)


def read_simulation(path: Path) -> SimulationRecord:
    """Return the record in a simulation.json."""
    remedy = "simulate again, or remove the file"
    return as_record(read_json(path, KIND, MAX_BYTES), SimulationRecord, str(path), kind=KIND, remedy=remedy)


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
        metrics=run.metrics,
        loop=SimulatedLoopRecord(stable=run.mode.radius < 1, spectral_radius=run.mode.radius, hz=run.mode.hz),
        motion=run.motion,
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
