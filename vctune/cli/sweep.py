"""`vctune sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from vctune.cli.options import out_option, worker_options

MANY = 100_000
"""So many points are solved only when asked for with --yes."""


@click.command(short_help="Solve a problem at many points.")
@click.argument("study", type=click.Path(path_type=Path))
@out_option("STUDY/")
@worker_options
@click.option("--resume/--restart", default=True, help="Go on with the rows that are there, or begin anew.")
@click.option(
    "--format", "style", type=click.Choice(["text", "json"]), default="text", show_default=True, help="What to print."
)
@click.option("--yes", is_flag=True, help=f"Solve {MANY:,} points or more.")
def sweep(study: Path, out: Path, jobs: int | None, executor: str, resume: bool, style: str, yes: bool) -> int:
    """Solve a problem at every point of STUDY, a TOML file with a grid, a Latin hypercube or a list of points.

    Each finished point is a line of OUT/STUDY/rows.jsonl; an interrupted sweep goes on where it was. At the end
    table.csv (and table.parquet where pyarrow is installed) and, for one or two axes, error.svg.
    """
    from vctune.cli.progress import bar_on_stderr
    from vctune.document.errors import InputError, Mistake
    from vctune.document.files import folder_name
    from vctune.document.study import read_study

    plan = read_study(study)
    if plan.count >= MANY and not yes:
        message = f"has {plan.count:,} points, more than {MANY - 1:,}; confirm them with --yes"
        raise InputError(str(study), [Mistake("", message)])
    folder = out / folder_name(plan.name)

    from vctune.api.studies import sweep as run

    with bar_on_stderr(f"vctune sweep {study.name}", plan.count) as on_done:
        swept = run(plan, folder=folder, jobs=jobs, executor=executor, restart=not resume, on_done=on_done)
    if swept.dropped:
        click.echo(f"{folder / 'rows.jsonl'}: {swept.dropped} torn lines dropped", err=True)
    _print(swept.summary, folder, style)
    return _exit_code(swept.summary)


def _print(found: dict[str, Any], folder: Path, style: str) -> None:
    import json

    from vctune.cli.output import emit, reader_may_leave

    if style == "json":
        emit(json.dumps(found, indent=2, allow_nan=False))
        return
    from vctune.cli.table import print_sweep

    with reader_may_leave():
        print_sweep(found, folder)


def _exit_code(found: dict[str, Any]) -> int:
    """Return 0 if there is a certified design and no point was left without an answer, else 1."""
    from vctune.exit_codes import ExitCode

    return ExitCode.OK if found["best"] and not found["status"].get("failed") else ExitCode.FAILED
