"""`vctune bound`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable

    from vctune.design.bound import Optimality
    from vctune.design.judge import Judgement
    from vctune.design.leaves import Unfinished
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
    from vctune.interrupt import interrupt_noted
    from vctune.report.report import write_report

    with progress_on_stderr(f"vctune bound {problem.name}", shown=True) as progress:
        known = _known(file, path, given=design is not None) or _solved(file, progress)
        record, best = known.record, known.best
        with interrupt_noted() as stopped:  # from here on something would be lost
            if record["status"] != "infeasible":
                found = _searched(file, known, gap, jobs, time_limit, stopped, progress)
                record, best = _added(file, record, found), found.improved or best
                _keep(file, path.parent / SAVED, found)
            text = json.dumps(record, indent=2, allow_nan=False)
            _write(file, path, record, text, best)
        progress("drawing the report")
        write_report(record, path.parent, simulation_beside(path.parent, record))
    if as_json:
        emit(text)
    else:
        from vctune.cli.table import print_design

        with reader_may_leave():
            print_design(record, path.parent)
    if record["status"] == "infeasible":
        return ExitCode.FAILED
    return ExitCode.OK if record["optimality"]["verdict"] == "proved" else ExitCode.UNDECIDED


@dataclass(frozen=True, slots=True)
class _Known:
    """What is known before the search: design.json, its design proved again, and what an earlier search has left."""

    record: dict[str, Any]
    best: Judgement | None
    rest: Unfinished | None = None


def _known(file: ProblemFile, path: Path, *, given: bool) -> _Known | None:
    """Return the design that was given, or that an unfinished search has left; None where there is none."""
    from vctune.document.errors import InputError

    rest = _rest(file, path.parent / SAVED)
    if rest is None and not given:
        return None
    try:
        record, best = _read(file, path)
    except InputError:
        if given:
            raise
        return None
    return _Known(record, best, rest) if record["status"] != "infeasible" else None


def _rest(file: ProblemFile, saved: Path) -> Unfinished | None:
    from vctune.design.leaves import ARRAYS, unfinished
    from vctune.document.unfinished import read_unfinished

    arrays = read_unfinished(saved, file.sha256, ARRAYS)
    return unfinished(arrays) if arrays else None


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
    if best.status is not Status.CERTIFIED:
        message = f"is not proved to meet the demands (status {best.status}); solve the problem again"
        raise InputError(str(path), [Mistake("gains", message)])
    return record, best


def _solved(file: ProblemFile, progress: Callable[[str], None]) -> _Known:
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record
    from vctune.design.repaired import repaired
    from vctune.design.solve import solve

    solved = repaired(file, solve(file.problem, progress), progress)
    rest = solved.optimality.rest if solved.optimality is not None else None
    return _Known(design_record(file, solved, ipopt_version()), solved.judgement, rest)


def _searched(
    file: ProblemFile,
    known: _Known,
    gap: float,
    jobs: int,
    time_limit: float | None,
    stopped: Callable[[], bool],
    progress: Callable[[str], None],
) -> Optimality:
    """Search, going on where an earlier search of the same problem has stopped."""
    from functools import partial
    from math import inf

    from vctune.design.bound import bound
    from vctune.design.optimum import improved

    return bound(
        file.problem,
        known.best,
        partial(improved, file.problem),
        gap=gap,
        time_limit=inf if time_limit is None else time_limit,
        jobs=jobs,
        rest=known.rest,
        stopped=stopped,
        progress=lambda at: progress(str(at)),
    )


def _keep(file: ProblemFile, saved: Path, found: Optimality) -> None:
    """Keep what is left to do."""
    from vctune.document.files import write_together
    from vctune.document.unfinished import unfinished_bytes

    if found.proved:
        saved.unlink(missing_ok=True)
    else:
        write_together({saved: unfinished_bytes(file.sha256, found.rest.arrays())})


def _added(file: ProblemFile, record: dict[str, Any], found: Optimality) -> dict[str, Any]:
    """Return the design's record with what is proved of all designs; that of a better design if one was found."""
    from vctune.design.infeasible import OPENINGS
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import design_record, optimality_record
    from vctune.design.result import Solved

    if found.improved is not None:
        click.echo("found a better design than the one known, whose basin the scan had missed", err=True)
        solved = Solved(file.problem, found.improved, None, 0, None, None, {}, found)
        return design_record(file, solved, ipopt_version())
    added: dict[str, Any] = {"optimality": optimality_record(found)}
    if record["gains"] is None and found.proved:
        reason = str(record["reason"]).replace(OPENINGS[False], OPENINGS[True], 1)
        added |= {"status": "infeasible", "reason": reason, "proved": True}
    return record | added


def _write(file: ProblemFile, path: Path, record: dict[str, Any], text: str, best: Judgement | None) -> None:
    from vctune.cli.solve import write_design
    from vctune.document.files import write_together
    from vctune.report.contents import report_paths

    if path.name == "design.json":
        write_design(path.parent, file, record, text, (best.gains, best.coupling) if best else None)
    else:
        write_together({path: text + "\n"}, report_paths(path.parent))
