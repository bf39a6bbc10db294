"""Define `vctune sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from vctune.cli.options import PATH, command, jobs_option, out_option, time_limit_option
from vctune.cli.runner import Run


@command("Solve a problem at many points.")
@click.argument("study", type=PATH)
@out_option("STUDY/")
@jobs_option("Number of workers.", 512, None)
@click.option(
    "--executor",
    default="processes",
    show_default=True,
    metavar="WORKERS",
    help="processes, serial (this process), dask (a new cluster) or dask:ADDRESS (a running one).",
)
@click.option("--restart", is_flag=True, help="Start again instead of continuing with the existing rows.")
@click.option(
    "--plot", default="error", show_default=True, metavar="COLUMN", help="Column of table.csv that the picture shows."
)
@click.option(
    "--figures", type=click.Choice(["svg", "pdf", "png"]), default="svg", show_default=True, help="Kind of picture."
)
@time_limit_option(" each point")
def sweep(
    run: Run,
    study: Path,
    out: Path,
    jobs: int | None,
    executor: str,
    restart: bool,
    plot: str,
    figures: Any,
    time_limit: float,
) -> int:
    """Solve a problem at every point of STUDY, a TOML file with a grid or a list of points.

    The command writes each finished point as a line of rows.jsonl; to continue an interrupted sweep, run it again. At
    the end it writes table.csv and, for one or two axes, a picture, COLUMN.svg. The exit code is 3 if a point reached
    the time limit, 0 if every point has an answer and at least one design is certified, and 1 otherwise.
    """
    from vctune.api.result import folder_name
    from vctune.api.sweeping import ROWS, read_study
    from vctune.api.sweeping import sweep as solve
    from vctune.interrupt import resumable

    plan = read_study(study)
    folder = out / folder_name(plan.name)
    run.doubt(*plan.extremes())
    again = f"running it again {'without --restart ' if restart else ''}resumes"
    with resumable(again), run.bar(study.name, plan.count) as on_done:
        swept = solve(
            plan, folder=folder, jobs=jobs, executor=executor, restart=restart, time_limit=time_limit, on_done=on_done,
            plot=plot, figures=figures,
        )  # fmt: skip
    if swept.dropped:
        run.warn("rows-torn", f"{folder / ROWS}: {swept.dropped} torn lines dropped")
    return run.show(swept, swept.summary.to_json, folder)
