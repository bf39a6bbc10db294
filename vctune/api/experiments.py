"""Provide `vctune simulate` as a function."""

from __future__ import annotations

import json
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vctune.api.folders import DESIGN_FILE
from vctune.design.result import Solved
from vctune.design.search.optimum import Progress
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design_for as design_for
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile
from vctune.document.records.design_json import read_design
from vctune.document.records.simulation_json import FILE, SimulationRecord
from vctune.document.records.simulation_json import simulation_of as simulation_of
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import Content, write_together
from vctune.model.experiment import Experiment
from vctune.model.gains import AnyCoupling, Gains
from vctune.report.experiments import HEADINGS as HEADINGS
from vctune.report.experiments import measured_rows as measured_rows
from vctune.simulation.simulation_record import simulation_record, trace_arrays
from vctune.simulation.two_runs import Simulated
from vctune.simulation.two_runs import simulate as run


@dataclass(frozen=True, slots=True)
class Simulation:
    """The result of simulating a design in a problem's experiments."""

    file: ProblemFile  # the problem
    gains: Gains  # the design
    coupling: AnyCoupling
    experiments: tuple[Simulated, ...]  # results of the experiments

    @property
    def stable(self) -> bool:
        """Whether no run diverges, and the design is stable with the hand and environment of every experiment."""
        runs = [experiment.design for experiment in self.experiments]
        return all(run_of_design.traces.diverged is None and run_of_design.mode.radius < 1 for run_of_design in runs)

    def record(self) -> dict[str, Any]:
        """Return the object of simulation.json."""
        return self._measured().to_json()

    def _measured(self) -> SimulationRecord:
        return simulation_record(self.file, self.gains, self.coupling, list(self.experiments))


def simulate(
    problem: ProblemSource,
    gains: DesignSource | None = None,
    coupling: AnyCoupling | None = None,
    experiment: Experiment | str | None = None,
    *,
    progress: Progress = lambda stage: None,
) -> Simulation:
    """Simulate a design in the experiments of a problem.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    gains : DesignSource, optional
        Gains, SI units, given together with `coupling`; or a gains file or its path; None for the design of
        `solve`.
    coupling : AnyCoupling, optional
        Coupling of the design, SI units.
    experiment : Experiment or str, optional
        Experiment to simulate, by name or as an object; None for all experiments of the problem.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        If the problem or the design is invalid; if they are for different kinds of device; if there is no such
        experiment; or if solving finds no design.
    """
    file = problem_of(problem)
    chosen = (experiment,) if isinstance(experiment, Experiment) else chosen_experiments(file, experiment)
    if gains is None:
        law, coupling = _solved_design(file, progress)
    else:
        design = design_for(file, gains, coupling)
        law, coupling = design.gains, design.coupling
    runs = tuple(run(file.problem, law, coupling, selected, progress) for selected in chosen)
    return Simulation(file, law, coupling, runs)


def chosen_experiments(file: ProblemFile, name: str | None) -> tuple[Experiment, ...]:
    """Return the experiments of a problem, or only the experiment with a given name."""
    experiments = file.problem.experiments
    if not experiments:
        message = "there is none to simulate; add an [[experiment]] table"
        raise InputError.of(file.source, "no-experiment", message, key="experiment")
    chosen = tuple(experiment for experiment in experiments if name in (None, experiment.name))
    if not chosen:
        names = ", ".join(experiment.name for experiment in experiments)
        raise InputError.of(
            file.source, "no-experiment", f"none is called {name!r}; there are: {names}", key="experiment"
        )
    return chosen


def design_in(folder: Path, file: ProblemFile) -> tuple[Gains, AnyCoupling] | None:
    """Return the design of this version of the problem in a folder; None if there is none."""
    try:
        record = read_design(folder / DESIGN_FILE)
    except InputError:
        return None
    return record.design if record.problem.sha256 == file.sha256 else None


def solve_to_simulate(file: ProblemFile, progress: Progress) -> Solved:
    """Solve a problem, but without repairs and prices, and return the result."""
    from vctune.design.solve import solve

    return solve(file.problem, progress)


def write_simulation(simulation: Simulation, folder: Path) -> dict[str, Any]:
    """Write simulation.json, traces.npz and their figure."""
    from vctune.report.page import report_files, simulation_files

    value, traces = simulation.record(), BytesIO()
    record = simulation_of(value)
    np.savez(traces, **trace_arrays(list(simulation.experiments)))  # type: ignore[arg-type]
    try:
        design = read_design(folder / DESIGN_FILE)
    except InputError:
        design = None
    text = json.dumps(value, indent=1, allow_nan=False) + "\n"
    measured: dict[Path, Content] = {folder / FILE: text, folder / "traces.npz": traces.getbuffer()}
    if design is not None and record.is_of(design):
        write_together({**measured, **report_files(design, folder, record)})
    else:
        write_together({**measured, **simulation_files(record, folder)})
    return value


def _solved_design(file: ProblemFile, progress: Progress) -> tuple[Gains, AnyCoupling]:
    """Return the design that vctune finds for a problem. Refuse a problem without a design."""
    from vctune.design.solve import solve

    solved = solve(file.problem, progress)
    if solved.judgement is None:
        raise InputError.of(file.source, "no-design", f"nothing to simulate: {solved.reason}")
    return solved.judgement.gains, solved.judgement.coupling
