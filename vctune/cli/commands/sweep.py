"""Define `vctune sweep`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import out_option, output_options, time_limit_option, worker_options

MANY = 100_000  # Number of points from which a sweep requires --yes


@click.command(short_help="Solve a problem at many points.")
@click.argument("study", type=click.Path(path_type=Path))
@out_option("STUDY/")
@worker_options
@click.option(
    "--resume/--restart", default=True, help="Continue with the existing rows, or start again.  [default: resume]"
)
@time_limit_option(" each point")
@click.option("--yes", is_flag=True, help=f"Confirm a study of {MANY:,} points or more.")
@output_options()
def sweep(
    study: Path,
    out: Path,
    jobs: int | None,
    executor: str,
    resume: bool,
    time_limit: float,
    yes: bool,
    style: str,
    quiet: bool,
) -> int:
    """Solve a problem at every point of STUDY, a TOML file with a grid, a Latin hypercube or a list of points.

    The command writes each finished point as a line of OUT/STUDY/rows.jsonl. To continue an interrupted sweep, run the
    command again. At the end, the command writes table.csv and, for one or
    two axes, error.svg.

    The exit code is 3 if a point reached the time limit, 0 if every point has an answer and at least one design is
    certified, and 1 otherwise.
    """
    from vctune.api.folders import folder_name
    from vctune.api.messages import InputError
    from vctune.api.studies import read_study
    from vctune.api.studies import sweep as run
    from vctune.cli.printing.output import answer, warn, warn_of_doubts
    from vctune.cli.printing.progress import bar_on_stderr
    from vctune.exit_codes import ExitCode
    from vctune.interrupt import resumable

    plan = read_study(study)
    if plan.count >= MANY and not yes:
        message = f"has {plan.count:,} points, more than {MANY - 1:,}; confirm them with --yes"
        raise InputError.of(str(study), "many-points", message)
    folder = out / folder_name(plan.name)
    warn_of_doubts(*plan.extremes(), quiet=quiet)

    again = "running it again resumes" if resume else "running it again without --restart resumes"
    with resumable(again), bar_on_stderr(f"vctune sweep {study.name}", plan.count, shown=not quiet) as on_done:
        swept = run(
            plan,
            folder=folder,
            jobs=jobs,
            executor=executor,
            restart=not resume,
            time_limit=time_limit,
            on_done=on_done,
        )
    if swept.dropped:
        warn("rows-torn", f"{folder / 'rows.jsonl'}: {swept.dropped} torn lines dropped")
    found = swept.summary

    def table() -> None:
        from vctune.cli.printing.design_table import print_sweep

        print_sweep(found, folder)

    answer(style, quiet, found.to_json, table)
    if found.status.get("failed") or not (found.best or swept.cut):
        return ExitCode.FAILED
    return ExitCode.UNDECIDED if swept.cut else ExitCode.OK
