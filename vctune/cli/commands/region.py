"""Define `vctune region`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from vctune.api.argument_ranges import RESOLUTIONS, VARIABLES
from vctune.cli.options import PATH, Share, command, out_option, problem_argument, time_limited
from vctune.cli.runner import Run


@command("Find the whole set of feasible gains, cell by cell.")
@problem_argument
@click.argument("gains", type=PATH, required=False)
@click.option("--x", type=click.Choice(VARIABLES), metavar="KEY", help="Horizontal axis of the plane.")
@click.option("--y", type=click.Choice(VARIABLES), metavar="KEY", help="Vertical axis of the plane.")
@click.option(
    "--resolution",
    type=Share(*RESOLUTIONS),
    metavar="SHARE",
    default=1 / 256,
    show_default="1/256",
    help="Least side of a cell, as a share of the plane's.",
)
@click.option("--linear", is_flag=True, help="Linear axes instead of logarithmic ones.")
@click.option("--points", type=PATH, help="CSV of measured points: both axes, and stable (yes or no).")
@out_option()
@time_limited
def region(
    run: Run,
    problem: Path,
    gains: Path | None,
    x: str | None,
    y: str | None,
    resolution: float,
    linear: bool,
    points: Path | None,
    out: Path,
) -> int:
    """Find all gains of PROBLEM that meet its constraints.

    vctune proves each cell of the plane of two variables feasible or infeasible throughout, or leaves it undecided.
    Other free variables may have any values within their bounds. The axes are gains.velocity and gains.position, for
    an impedance display coupling.damping and coupling.stiffness, for a servo coupling.mass and coupling.drag. The
    command writes region.json, a baseline for `vctune check --region`, and region.svg with the best design, GAINS,
    limits of the literature and what was measured.

    After Ctrl-C or the time limit, it writes the cells decided so far, with code 3. A second Ctrl-C ends it at once.
    """
    from vctune import interrupt, read_problem
    from vctune.api.regions import (
        PICTURE,
        REGION_FILE,
        axes_of,
        best_design,
        design_for,
        measured_points,
        require_plane,
    )
    from vctune.api.regions import region as find
    from vctune.api.result import design_folder, write

    file = read_problem(problem)
    x, y = axes_of(file.problem, x, y)
    folder = design_folder(require_plane(file, x, y), out)
    run.doubt(file)
    file, given = design_for(file, gains) if gains else (file, None)
    measured = measured_points(points, (x, y)) if points else ()
    with run.progress(problem.name) as progress:
        solved = best_design(file.problem, progress)
        with interrupt.interrupt_noted() as stopped:  # from here on, an interrupt would lose work
            how: dict[str, Any] = {"resolution": resolution, "linear": linear, "points": measured}
            found = find(file, x, y, given, **how, solved=solved, stopped=stopped, progress=progress)
            progress("drawing")
            write(found.files(folder))
    if found.region.interrupted:
        by = "time limit" if found.late else "interrupt"
        run.warn(
            "time-limit" if found.late else "interrupted",
            f"{folder / REGION_FILE}: holds what was decided before the {by}",
        )
    return run.show(found, found.record, folder, [f"open {folder / PICTURE}"])
