"""Define `vctune solve`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.api.argument_ranges import GAPS, STDIN
from vctune.cli.printing.options import out_option, output_options, problem_argument, time_limit_option, verbose_option
from vctune.running import OutOfTimeError, check_time, time_limit_of_command
from vctune.running import time_limit as limited

if TYPE_CHECKING:
    from vctune import AxesFile


@click.command(short_help="Find the most transparent gains and prove them stable.")
@problem_argument
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
@verbose_option
@output_options()
def solve(
    problem: Path,
    out: Path,
    no_report: bool,
    strict: bool,
    watch: bool,
    gap: float | None,
    time_limit: float,
    verbose: bool,
    style: str,
    quiet: bool,
) -> int:
    """Find the most transparent gains of PROBLEM and prove them stable.

    A transparent device feels light and renders the virtual environment exactly. The error is the distance from this
    ideal.

    PROBLEM is a TOML file, or - for standard input. Most problems need only mass, damping and sample_time in [device].
    If PROBLEM has several [[axis]] tables, the command solves each axis and writes the files of an axis to
    OUT/NAME/AXIS/. The exit code is then the code of the worst result.
    """

    def once() -> int:
        with limited(time_limit) if watch else time_limit_of_command(time_limit):
            return _solve(
                problem, out, report=not no_report, strict=strict, gap=gap, style=style, quiet=quiet, verbose=verbose
            )

    if watch:
        from vctune.cli.printing.watch import on_every_save

        if problem == STDIN:
            raise click.UsageError("--watch needs a file; standard input is read once")
        on_every_save(problem, once)
    return once()


def _solve(
    problem: Path, out: Path, *, report: bool, strict: bool, gap: float | None, style: str, quiet: bool, verbose: bool
) -> int:
    """Solve a problem, write and print its design, and return the exit code."""
    from vctune import AxesFile, read_problem_or_axes
    from vctune.api.design_files import write_report, write_solved
    from vctune.api.folders import DESIGN_FILE, design_folder
    from vctune.cli.printing.output import answer, warn, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr

    file = read_problem_or_axes(problem)
    if isinstance(file, AxesFile):
        return _solve_axes(file, out, report=report, strict=strict, gap=gap, style=style, quiet=quiet)
    folder = design_folder(file, out)

    from vctune import Status
    from vctune.api.messages import has_code
    from vctune.api.solving import solve as solve_problem
    from vctune.cli.printing.exits import of_status
    from vctune.exit_codes import ExitCode

    warn_of_doubts(file, quiet=quiet)
    with progress_on_stderr(f"vctune solve {problem.name}", shown=not quiet) as progress:
        solved = solve_problem(file, gap=gap, prices=report, progress=progress)
        record, renamed = write_solved(folder, file, solved)
        say_renamed(renamed)
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

    def table() -> None:
        from vctune.cli.printing.design_table import print_design
        from vctune.cli.printing.next_steps import after_design

        print_design(record, folder, after_design(record, folder, problem), verbose=verbose)

    answer(style, quiet, record.to_json, table)
    cut = any(has_code(warning, "time-limit") for warning in record.warnings)
    if strict and record.warnings and not cut:
        return ExitCode.FAILED
    open_ = gap is not None and solved.optimality is not None and not solved.optimality.proved
    unfinished = open_ or cut or not drawn
    return ExitCode.UNDECIDED if unfinished and solved.status is Status.CERTIFIED else of_status(solved.status)


def _solve_axes(
    axes: AxesFile, out: Path, *, report: bool, strict: bool, gap: float | None, style: str, quiet: bool
) -> int:
    """Solve a problem with several axes, and return the exit code of the worst axis."""
    from vctune import Status
    from vctune.api.design_files import write_report
    from vctune.api.folders import folder_name
    from vctune.api.uncoupled_axes import axis_folder, claim_axes, solve_axes, write_axes
    from vctune.cli.printing.axes_table import print_axes
    from vctune.cli.printing.exits import of_status, worst
    from vctune.cli.printing.output import answer, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    claim_axes(axes, out)
    warn_of_doubts(*(axis.file for axis in axes.axes), quiet=quiet)
    with progress_on_stderr(f"vctune solve {axes.name}", shown=not quiet) as progress:
        designs = solve_axes(axes, gap=gap, prices=report, progress=progress)
        say_renamed(write_axes(axes, designs, out, reported=report))
        for design in designs if report else ():
            progress(f"{design.axis.name}: drawing the report")
            write_report(design.record, axis_folder(axes, design.axis, out))
    records = {design.axis.name: design.record for design in designs}
    answer(
        style,
        quiet,
        lambda: [record.to_json() for record in records.values()],
        lambda: print_axes(axes.name, records, out / folder_name(axes.name)),
    )
    if strict and any(record.warnings for record in records.values()):
        return ExitCode.FAILED
    return worst(of_status(Status(record.status)) for record in records.values())


def say_renamed(renamed: dict[Path, Path]) -> None:
    """Print the names of the renamed files of an earlier design."""
    for place, kept in renamed.items():
        click.echo(f"{place}: of an earlier design, renamed to {kept.name}", err=True)
