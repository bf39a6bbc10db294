"""`vctune simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from vctune.cli.progress import Progress
    from vctune.document.experiment import Experiment
    from vctune.document.reading import ProblemFile
    from vctune.model.quantities import Coupling, Gains
    from vctune.simulation.experiment import Simulated


@click.command(short_help="Simulate a design in the problem's experiments.")
@click.argument("problem", type=click.Path(path_type=Path))
@click.argument("gains", type=click.Path(path_type=Path), required=False)
@click.option("--experiment", "name", help="Name of the only experiment to simulate.  [default: all]")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("results"), show_default=True, help="Folder for OUT/NAME/."
)
@click.option("--json", "as_json", is_flag=True, help="Print simulation.json instead of the table.")
def simulate(problem: Path, gains: Path | None, name: str | None, out: Path, as_json: bool) -> int:
    """Simulate the design in GAINS, or else the one that solving finds, in the [[experiment]] tables of PROBLEM.

    Writes simulation.json, traces.npz and the figure `simulation`, which becomes part of the design's report. Exit
    code 1 if the design diverges or is unstable with an experiment's hand and environment, or if there is none.
    """
    import json

    from vctune.cli.output import emit, reader_may_leave
    from vctune.cli.progress import progress_on_stderr
    from vctune.cli.solve import design_folder
    from vctune.document.reading import read_gains, read_problem
    from vctune.exits import ExitCode

    file = read_problem(problem)
    experiments = _chosen(file, problem, name)
    given = read_gains(gains) if gains else None
    if given and given.sha256 not in (None, file.sha256):
        click.echo(f"{gains}: made for another version of the problem (sha256 differs)", err=True)
    folder = design_folder(file, problem, out)

    with progress_on_stderr(f"vctune simulate {problem.name}", shown=True) as progress:
        design = (given.gains, given.coupling) if given else _solved(file, folder, progress)
        if design is None:
            return ExitCode.FAILED
        from vctune.simulation.experiment import simulate as simulate_one
        from vctune.simulation.record import simulation_record

        simulated = [simulate_one(file.problem, *design, one, progress=progress) for one in experiments]
        record = simulation_record(file, *design, simulated)
        text = json.dumps(record, indent=1, allow_nan=False)
        progress("writing and drawing")
        _write(folder, record, text, simulated)
    if as_json:
        emit(text)
    else:
        from vctune.cli.table import print_simulation

        with reader_may_leave():
            print_simulation(record, folder)
    good = all(one.design.traces.diverged is None and one.design.mode.radius < 1 for one in simulated)
    return ExitCode.OK if good else ExitCode.FAILED


def _chosen(file: ProblemFile, problem: Path, name: str | None) -> tuple[Experiment, ...]:
    from vctune.document.errors import InputError, Mistake

    experiments = file.problem.experiments
    if not experiments:
        raise InputError(
            str(problem), [Mistake("experiment", "there is none to simulate; add an [[experiment]] table")]
        )
    chosen = tuple(one for one in experiments if name in (None, one.name))
    if not chosen:
        known = ", ".join(one.name for one in experiments)
        raise InputError(str(problem), [Mistake("experiment", f"none is called {name!r}; there are: {known}")])
    return chosen


def _solved(file: ProblemFile, folder: Path, progress: Progress) -> tuple[Gains, Coupling] | None:
    """Solve the problem and write its design, as `vctune solve` does; say why if there is none."""
    import json

    from vctune.cli.solve import write_design
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record
    from vctune.design.solve import solve
    from vctune.document.errors import printable

    solved = solve(file.problem, progress)
    record, judgement = design_record(file, solved, ipopt_version()), solved.judgement
    design = (judgement.gains, judgement.coupling) if judgement else None
    write_design(folder, file, record, json.dumps(record, indent=2, allow_nan=False), design)
    if design is None:
        click.echo(f"{printable(file.problem.name)}: nothing to simulate: {record['reason']}", err=True)
    return design


def _write(folder: Path, record: dict[str, Any], text: str, simulated: list[Simulated]) -> None:
    """Write record, traces and figure, and the report again if the design beside them is this one."""
    from io import BytesIO

    import numpy as np

    from vctune.document.design import read_design
    from vctune.document.errors import InputError
    from vctune.document.files import Content, write_together
    from vctune.document.simulation import FILE, is_of
    from vctune.report.report import report_files, simulation_files
    from vctune.simulation.record import trace_arrays

    traces = BytesIO()
    np.savez(traces, **trace_arrays(simulated))  # type: ignore[arg-type]
    try:
        design = read_design(folder / "design.json")
    except InputError:
        design = None
    measured: dict[Path, Content] = {folder / FILE: text + "\n", folder / "traces.npz": traces.getbuffer()}
    if design is not None and is_of(record, design):
        write_together({**measured, **report_files(design, folder, record)})
    else:
        write_together({**measured, **simulation_files(record, folder)})
