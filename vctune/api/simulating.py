"""Provide `vctune simulate` as a function."""

from __future__ import annotations

import json
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vctune.api.result import DESIGN_FILE, Files, Printed, RefusedError, Table, write
from vctune.api.solving import designed
from vctune.design.records.design import DesignRecord, read_design
from vctune.design.result import Solved
from vctune.design.search.optimum import Progress
from vctune.design.solve import solve as find
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design_for as design_for
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile
from vctune.document.text.errors import InputError, printable
from vctune.exit_codes import ExitCode
from vctune.model.experiment import Experiment
from vctune.model.gains import AnyCoupling, Gains
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.simulation.simulation_record import FILE, SimulationRecord, simulation_record, trace_arrays
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
        """Whether no run diverges or goes on oscillating, and the linear loop of every experiment is stable."""
        return all(one.design.calm and one.design.mode.radius < 1 for one in self.experiments)

    @property
    def exit_code(self) -> ExitCode:
        """Failed if the design is not stable in an experiment."""
        return ExitCode.OK if self.stable else ExitCode.FAILED

    def measured(self) -> SimulationRecord:
        """Return the record of simulation.json."""
        return simulation_record(self.file, self.gains, self.coupling, list(self.experiments))

    def record(self) -> dict[str, Any]:
        """Return the object of simulation.json."""
        return self.measured().to_json()

    def rows(self) -> Printed:
        """Yield the measures of each run."""
        yield ((printable(self.file.problem.name), "bold"),)
        rows = [tuple(map(printable, row)) for row in measured_rows(self.measured())]
        yield Table(rows, HEADINGS)

    def files(self, folder: Path) -> Files:
        """Return simulation.json, traces.npz and their figure, in the report of the folder's design if it is this."""
        from vctune.report.page import report_files, simulation_files

        traces, record = BytesIO(), self.measured()
        np.savez(traces, **trace_arrays(list(self.experiments)))  # type: ignore[arg-type]
        text = json.dumps(record.to_json(), indent=1, allow_nan=False) + "\n"
        files: Files = {folder / FILE: text, folder / "traces.npz": traces.getbuffer()}
        design = _record_in(folder)
        if design is not None and record.is_of(design.problem, design.gains, design.coupling):
            return {**files, **report_files(design, folder, record)}
        return {**files, **simulation_files(record, folder)}


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
        Gains, SI units, together with `coupling`; or a gains file or its path; None with the coupling of a
        servo, which has no gains, or for the design of `solve`.
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
        If the problem or the design is invalid, or if there is no such experiment or no design.
    """
    file = problem_of(problem)
    chosen = (experiment,) if isinstance(experiment, Experiment) else chosen_experiments(file, experiment)
    if gains is None and coupling is None:
        law, coupling = _found(file, find(file.problem, progress))
    else:
        file, design = design_for(file, gains, coupling)
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


def designed_in(file: ProblemFile, folder: Path, progress: Progress) -> tuple[Gains, AnyCoupling]:
    """Return the design of this problem in the folder, else that which solving it finds. A folder without any design
    gets it; another design stays. Refuse a problem without a design."""
    record = _record_in(folder)
    if record is not None and record.problem.sha256 == file.sha256 and record.design is not None:
        return record.design
    solved = find(file.problem, progress)
    if not (folder / DESIGN_FILE).exists():
        write(designed(file, solved).files(folder))
    return _found(file, solved)


def _record_in(folder: Path) -> DesignRecord | None:
    """Return the record of the design in a folder; None if there is none."""
    return read_design(folder / DESIGN_FILE) if (folder / DESIGN_FILE).exists() else None


def _found(file: ProblemFile, solved: Solved) -> tuple[Gains, AnyCoupling]:
    """Return the design that vctune has found for a problem. Refuse a problem without a design."""
    if solved.judgement is None:
        message = f"nothing to simulate: {solved.reason}"
        raise RefusedError(file.problem.name, "no-design", message, ExitCode.FAILED)
    return solved.judgement.gains, solved.judgement.coupling
