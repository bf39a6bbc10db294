"""Define `vctune solve`."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.api.argument_ranges import GAPS, STDIN
from vctune.cli.printing.options import out_option, output_options, time_limit_option
from vctune.running import OutOfTimeError, check_time, time_limit_of_command
from vctune.running import time_limit as limited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vctune import ProblemFile
    from vctune.document.records.design_json import DesignRecord
    from vctune.exit_codes import ExitCode


@click.command(short_help="Find the most transparent gains and prove them stable.")
@click.argument("problems", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PROBLEM...")
@out_option()
@click.option("--no-report", is_flag=True, help="Write only gains.toml and design.json, and remove an earlier report.")
@click.option("--strict", is_flag=True, help="Exit with code 1 if there is a warning.")
@click.option("--watch", is_flag=True, help="Solve again each time PROBLEM is saved, until Ctrl-C.")
@click.option(
    "--prove-gap",
    "gap",
    type=click.FloatRange(*GAPS),
    metavar="GAP",
    help="Also prove that no design has an error lower by more than this share; 0.03 stands for 3 %.",
)
@time_limit_option()
@output_options()
def solve(
    problems: tuple[Path, ...],
    out: Path,
    no_report: bool,
    strict: bool,
    watch: bool,
    gap: float | None,
    time_limit: float,
    style: str,
    quiet: bool,
) -> int:
    """Find the most transparent gains of PROBLEM and prove them stable.

    A transparent device feels light and renders the virtual environment exactly. The error is the distance from this
    ideal.

    PROBLEM is a TOML file, or - for standard input. Most problems need only mass, damping and sample_time in [device].
    The command solves several PROBLEMs one after the other. The exit code is then the code of the worst result.
    """

    if watch:
        from vctune.cli.printing.watch import on_every_save

        if len(problems) != 1 or problems[0] == STDIN:
            raise click.UsageError("--watch needs exactly one file, and standard input is read once")

        def once() -> int:
            with limited(time_limit):
                return _solve(
                    problems,
                    out,
                    report=not no_report,
                    strict=strict,
                    gap=gap,
                    style=style,
                    quiet=quiet,
                )

        on_every_save(problems[0], once)
    with time_limit_of_command(time_limit):
        return _solve(problems, out, report=not no_report, strict=strict, gap=gap, style=style, quiet=quiet)


def _solve(
    problems: Sequence[Path],
    out: Path,
    *,
    report: bool,
    strict: bool,
    gap: float | None,
    style: str,
    quiet: bool,
) -> int:
    """Solve problems one after the other, write and print their designs, and return the worst exit code."""
    from vctune import read_problem
    from vctune.api.folders import design_folder
    from vctune.cli.printing.exits import worst
    from vctune.cli.printing.output import answer, warn_of_doubts

    files = [read_problem(problem) for problem in problems]
    folders = [design_folder(file, out) for file in files]
    if len(set(folders)) < len(folders):
        raise click.UsageError("two problems have the same name, and so the same folder; give one another `name`")

    from vctune.cli.printing.design_table import print_design
    from vctune.cli.printing.next_steps import after_design

    warn_of_doubts(*files, quiet=quiet)
    records, codes = [], []
    for problem, file, folder in zip(problems, files, folders, strict=True):
        record, code = _solved(problem, file, folder, report=report, strict=strict, gap=gap, quiet=quiet)
        records.append(record)
        codes.append(code)
        if style != "json":
            steps = after_design(record, folder, problem)
            answer(style, quiet, record.to_json, partial(print_design, record, folder, steps))
    if style == "json":
        found = [record.to_json() for record in records]
        answer(style, quiet, lambda: found if len(found) > 1 else found[0], lambda: None)
    return worst(codes)


def _solved(
    problem: Path, file: ProblemFile, folder: Path, *, report: bool, strict: bool, gap: float | None, quiet: bool
) -> tuple[DesignRecord, ExitCode]:
    """Solve one problem, write its design, and return the design's record and the exit code."""
    from vctune import Status
    from vctune.api.design_files import write_report, write_solved
    from vctune.api.folders import DESIGN_FILE
    from vctune.api.messages import has_code
    from vctune.api.solving import solve as solve_problem
    from vctune.cli.printing.exits import of_status
    from vctune.cli.printing.output import warn
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    with progress_on_stderr(f"vctune solve {problem.name}", shown=not quiet) as progress:
        solved = solve_problem(file, gap=gap, prices=report, progress=progress)
        record = write_solved(folder, file, solved)
        drawn = not report
        with suppress(OutOfTimeError):
            if report:
                progress(f"drawing the report; {solved.known}")
                check_time()
                write_report(record, folder)
                drawn = True
    if not drawn:
        message = f"there was no time to draw the report; `vctune report {folder / DESIGN_FILE}` draws it"
        warn("time-limit", message)
    cut = any(has_code(warning, "time-limit") for warning in record.warnings)
    if strict and record.warnings and not cut:
        return record, ExitCode.FAILED
    open_ = gap is not None and solved.optimality is not None and not solved.optimality.proved
    unfinished = open_ or cut or not drawn
    undecided = unfinished and solved.status is Status.CERTIFIED
    return record, ExitCode.UNDECIDED if undecided else of_status(solved.status)
