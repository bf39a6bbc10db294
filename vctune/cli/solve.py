"""`vctune solve`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.api.limits import GAPS
from vctune.cli.options import out_option, problem_argument


@click.command(short_help="Find the most transparent gains and prove them stable.")
@problem_argument
@out_option()
@click.option("--json", "as_json", is_flag=True, help="Print design.json instead of the table.")
@click.option("--no-report", is_flag=True, help="Write only gains.toml and design.json; an earlier report is removed.")
@click.option("--quiet", is_flag=True, help="No progress and no table.")
@click.option("--strict", is_flag=True, help="Exit code 1 if there is a warning.")
@click.option(
    "--prove-gap",
    "gap",
    type=click.FloatRange(*GAPS),
    metavar="GAP",
    help="Prove that no design has an error lower by more than this share, 0.03 for 3 %.",
)
def solve(
    problem: Path, out: Path, as_json: bool, no_report: bool, quiet: bool, strict: bool, gap: float | None
) -> int:
    """Find the most transparent gains of PROBLEM and prove them stable.

    PROBLEM is a TOML file; only [device] mass, damping and sample_time are required in it.
    """
    from vctune.api.files import design_folder, json_text, write_record, write_report
    from vctune.cli.output import emit, reader_may_leave
    from vctune.cli.progress import progress_on_stderr
    from vctune.document.reading import read_problem

    file = read_problem(problem)
    folder = design_folder(file, out)

    from vctune.api.solving import solve as solve_problem
    from vctune.cli.exits import of_status
    from vctune.design.judge import Status
    from vctune.design.nlp import ipopt_version
    from vctune.design.record import record_of
    from vctune.document.date import today
    from vctune.exit_codes import ExitCode

    with progress_on_stderr(f"vctune solve {problem.name}", shown=not quiet) as progress:
        solved = solve_problem(file, gap=gap, prices=not no_report, progress=progress)
        record = record_of(file, solved, ipopt_version(), today())
        say_renamed(write_record(folder, file, record))
        if not no_report:
            progress("drawing the report")
            write_report(record, folder)
    if as_json:
        emit(json_text(record).rstrip())
    elif not quiet:
        from vctune.cli.table import print_design

        with reader_may_leave():
            print_design(record, folder)
    if strict and record.warnings:
        return ExitCode.FAILED
    open_ = gap is not None and solved.optimality is not None and not solved.optimality.proved
    return ExitCode.UNDECIDED if open_ and solved.status is Status.CERTIFIED else of_status(solved.status)


def say_renamed(gains: Path | None) -> None:
    """Say that gains of an earlier run were renamed, if so."""
    if gains is not None:
        click.echo(f"{gains.with_name('gains.toml')}: gains of an earlier run, renamed to {gains.name}", err=True)
