"""`vctune bound`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable

    from vctune.design.bound import Optimality
    from vctune.design.judge import Judgement
    from vctune.document.reading import ProblemFile

SAVED = "bound.npz"


@click.command(short_help="Prove how much better any design could be.")
@click.argument("problem", type=click.Path(path_type=Path))
@click.argument("design", type=click.Path(path_type=Path), required=False)
@click.option(
    "--gap", type=click.FloatRange(1e-4, 10.0), default=0.03, show_default=True, help="What to prove, a share."
)
@click.option("--jobs", type=click.IntRange(1, 64), default=1, show_default=True, help="Threads.")
@click.option("--time-limit", type=click.FloatRange(0), metavar="S", help="Stop after so many seconds.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("results"), show_default=True, help="Folder for OUT/NAME/."
)
@click.option("--json", "as_json", is_flag=True, help="Print design.json instead of the table.")
def bound(
    problem: Path, design: Path | None, gap: float, jobs: int, time_limit: float | None, out: Path, as_json: bool
) -> int:
    """Prove a lower bound on the error of every admissible design of PROBLEM.

    DESIGN is a design.json of it; without one the problem is solved first. What is proved is added to design.json and
    to the report. Ctrl-C and the time limit leave the bound reached so far, exit code 3; the same command goes on.
    """
    import json

    from vctune.cli.output import emit, reader_may_leave
    from vctune.cli.progress import progress_on_stderr
    from vctune.cli.solve import design_folder
    from vctune.document.errors import InputError, Mistake
    from vctune.document.reading import read_problem

    file = read_problem(problem)
    if file.problem.bounds.fixed:
        raise InputError(str(problem), [Mistake("", "fixes every number: there is nothing to choose; free one")])
    path = design or design_folder(file, problem, out) / "design.json"

    from vctune.document.simulation import simulation_beside
    from vctune.exits import ExitCode
    from vctune.report.report import write_report

    with progress_on_stderr(f"vctune bound {problem.name}", shown=True) as progress:
        record, best = _read(file, design) if design else _solved(file, progress)
        found = _searched(file, path.parent / SAVED, best, gap, jobs, time_limit, progress)
        record = _added(file, record, found)
        text = json.dumps(record, indent=2, allow_nan=False)
        _write(file, path, record, text, found.improved or best)
        progress("drawing the report")
        write_report(record, path.parent, simulation_beside(path.parent, record))
    if as_json:
        emit(text)
    else:
        from vctune.cli.table import print_design

        with reader_may_leave():
            print_design(record, path.parent)
    if not found.proved:
        return ExitCode.UNDECIDED
    return ExitCode.FAILED if record["gains"] is None else ExitCode.OK


def _read(file: ProblemFile, path: Path) -> tuple[dict[str, Any], Judgement | None]:
    """Return a design.json of the problem and what is proved of it today."""
    from vctune.design.judge import Status, judge
    from vctune.document.design import read_design
    from vctune.document.errors import InputError, Mistake
    from vctune.model.quantities import Coupling, Gains

    record = read_design(path)
    if record["problem"]["sha256"] != file.sha256:
        raise InputError(str(path), [Mistake("problem.sha256", "is of another version of the problem; solve it again")])
    if record["gains"] is None:
        return record, None
    best = judge(file.problem, Gains(**record["gains"]), Coupling(**record["coupling"]))
    factor = file.problem.stability.safety_factor
    if best.status is not Status.CERTIFIED or best.certificate.factor < factor:
        message = f"is not proved to meet the demands (status {best.status}); solve the problem again"
        raise InputError(str(path), [Mistake("gains", message)])
    return record, best


def _solved(file: ProblemFile, progress: Callable[[str], None]) -> tuple[dict[str, Any], Judgement | None]:
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record
    from vctune.design.solve import solve

    solved = solve(file.problem, progress)
    return design_record(file, solved, ipopt_version()), solved.judgement


def _searched(
    file: ProblemFile,
    saved: Path,
    best: Judgement | None,
    gap: float,
    jobs: int,
    time_limit: float | None,
    progress: Callable[[str], None],
) -> Optimality:
    """Search, going on where an earlier search of the same problem has stopped; keep what is left to do."""
    from functools import partial
    from math import inf

    from vctune.design.bound import ARRAYS, bound, unfinished
    from vctune.design.solve import improved
    from vctune.document.files import write_together
    from vctune.document.unfinished import read_unfinished, unfinished_bytes
    from vctune.interrupt import interrupt_noted

    arrays = read_unfinished(saved, file.sha256, ARRAYS)
    rest = unfinished(arrays) if arrays else None
    with interrupt_noted() as stopped:
        found = bound(
            file.problem,
            best,
            partial(improved, file.problem),
            gap=gap,
            time_limit=inf if time_limit is None else time_limit,
            jobs=jobs,
            rest=rest if rest is not None and rest.gap <= gap else None,
            stopped=stopped,
            progress=lambda at: progress(f"error {at.incumbent:.5g}, bound {at.bound:.5g}, {at.open} boxes open"),
        )
    if found.proved:
        saved.unlink(missing_ok=True)
    else:
        write_together({saved: unfinished_bytes(file.sha256, found.rest.arrays())})
    return found


def _added(file: ProblemFile, record: dict[str, Any], found: Optimality) -> dict[str, Any]:
    """Return the design's record with what is proved of all designs; that of a better design if one was found."""
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record, optimality_record
    from vctune.design.result import Solved

    if found.improved is not None:
        click.echo("found a better design than the one known, whose basin the scan had missed", err=True)
        seconds = {"bound": found.rest.seconds}
        solved = Solved(file.problem, found.improved, None, 0, None, None, seconds, found)
        return design_record(file, solved, ipopt_version())
    added: dict[str, Any] = {"optimality": optimality_record(found)}
    if record["gains"] is None:
        added |= {"status": "infeasible" if found.proved else "undecided", "proved": found.proved}
    return record | added


def _write(file: ProblemFile, path: Path, record: dict[str, Any], text: str, best: Judgement | None) -> None:
    from vctune.cli.solve import write_design
    from vctune.document.files import write_together

    if path.name == "design.json":
        write_design(path.parent, file, record, text, (best.gains, best.coupling) if best else None)
    else:
        write_together({path: text + "\n"})
