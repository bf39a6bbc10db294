"""Define `vctune bound`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.api.argument_ranges import GAPS
from vctune.cli.printing.options import out_option, output_options, problem_argument, time_limited
from vctune.running import OutOfTimeError, check_time


@click.command(short_help="Prove a bound on how much better any other design could be.")
@problem_argument
@click.argument("design", type=click.Path(path_type=Path), required=False)
@click.option(
    "--gap",
    type=click.FloatRange(*GAPS),
    default=0.03,
    show_default=True,
    help="Gap to prove between the error and the bound, as a share of the bound.",
)
@click.option(
    "--jobs", type=click.IntRange(1, 64), default=1, show_default=True, help="Number of threads for the search."
)
@out_option()
@output_options()
@time_limited
def bound(
    problem: Path,
    design: Path | None,
    gap: float,
    jobs: int,
    out: Path,
    style: str,
    quiet: bool,
) -> int:
    """Prove a lower bound on the error of every feasible design of PROBLEM.

    The error is the distance of a design from a perfectly transparent device. A design is feasible if it meets all
    constraints of PROBLEM.

    DESIGN is a design.json of the problem. Without DESIGN, vctune solves the problem first. The command adds the bound
    to design.json and to the report.

    After Ctrl-C or the time limit, the command writes the bound reached so far and exits with code 3. Run the same
    command again to continue. A second Ctrl-C ends the command at once.
    """
    from vctune import Status, read_problem
    from vctune.api.bounding import bound as search
    from vctune.api.bounding import known_design, require_free, write_bounded
    from vctune.api.design_files import write_report
    from vctune.api.folders import DESIGN_FILE, design_folder
    from vctune.api.solving import solve
    from vctune.cli.printing.output import answer, warn, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode
    from vctune.interrupt import interrupt_noted

    file = require_free(read_problem(problem))
    path = design or design_folder(file, out) / DESIGN_FILE
    warn_of_doubts(file, quiet=quiet)
    with progress_on_stderr(f"vctune bound {problem.name}", shown=not quiet) as progress:
        start = known_design(file, path, given=design is not None) or solve(file, progress=progress)
        with interrupt_noted() as stopped:  # from here on, an interrupt would lose work
            bounded = search(file, start, gap=gap, jobs=jobs, stopped=stopped, progress=progress)
            write_bounded(bounded, path)
            if bounded.optimality is None and bounded.status is not Status.INFEASIBLE:
                warn("time-limit", "the search had no time: vctune proved nothing about other designs")
        progress("drawing the report")
        try:
            check_time()
            write_report(path)
        except OutOfTimeError:
            warn("time-limit", f"there was no time to draw the report; `vctune report {path}` draws it")
    if bounded.improved:
        click.echo("found a better design, in a basin that the scan had missed", err=True)

    def table() -> None:
        from vctune.cli.printing.design_table import print_design
        from vctune.cli.printing.next_steps import after_bound

        print_design(bounded.record, path.parent, after_bound(bounded.record, path, problem))

    answer(style, quiet, bounded.record.to_json, table)
    if bounded.status is Status.INFEASIBLE:
        return ExitCode.FAILED
    return ExitCode.OK if bounded.proved else ExitCode.UNDECIDED
