"""Define `vctune region`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.api.argument_ranges import RESOLUTIONS, VARIABLES
from vctune.cli.printing.options import out_option, output_options, problem_argument, time_limited

# Default axes in the help text
SHOWN = (
    "gains.velocity; impedance display: coupling.damping; servo: coupling.mass",
    "gains.position; impedance display: coupling.stiffness; servo: coupling.drag",
)


@click.command(short_help="Find the whole set of feasible gains, cell by cell.")
@problem_argument
@click.argument("gains", type=click.Path(path_type=Path), required=False)
@click.option(
    "--x",
    type=click.Choice(VARIABLES),
    show_default=SHOWN[0],
    help="Variable on the horizontal axis of the plane.",
)
@click.option(
    "--y", type=click.Choice(VARIABLES), show_default=SHOWN[1], help="Variable on the vertical axis of the plane."
)
@click.option(
    "--resolution",
    type=click.FloatRange(*RESOLUTIONS),
    default=1 / 256,
    show_default="1/256",
    help="Side of the smallest cell, relative to the side of the plane.",
)
@out_option()
@output_options()
@time_limited
def region(
    problem: Path,
    gains: Path | None,
    x: str | None,
    y: str | None,
    resolution: float,
    out: Path,
    style: str,
    quiet: bool,
) -> int:
    """Find all gains of PROBLEM that meet its constraints.

    The command divides the plane of two variables into cells. vctune proves each cell feasible throughout or infeasible
    throughout, or leaves it undecided at the given resolution. If the coupling is free, a point is feasible if some
    coupling within its bounds meets the constraints. The command writes OUT/NAME/region.json, a baseline for `vctune
    check --region`, and region.svg. The picture marks the best design, and also GAINS if you name a file.

    The exit code is 0 if feasible gains exist, 1 if vctune proves that none exist, and 3 if it proves neither. After
    Ctrl-C or the time limit, the command writes the cells decided so far and exits with code 3. A second Ctrl-C ends
    the command at once.
    """
    from vctune import read_problem
    from vctune.api.folders import design_folder
    from vctune.api.regions import (
        PICTURE,
        REGION_FILE,
        axes_of,
        best_design,
        design_for,
        require_plane,
        write_region,
    )
    from vctune.api.regions import region as find
    from vctune.cli.printing.exits import of_status
    from vctune.cli.printing.output import answer, warn, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode
    from vctune.interrupt import interrupt_noted

    read = read_problem(problem)
    x, y = axes_of(read.problem, x, y)
    file = require_plane(read, x, y)
    folder = design_folder(file, out)
    warn_of_doubts(file, quiet=quiet)
    given = design_for(file, gains) if gains else None
    with progress_on_stderr(f"vctune region {problem.name}", shown=not quiet) as progress:
        solved = best_design(file.problem, progress)
        with interrupt_noted() as stopped:  # from here on, an interrupt would lose work
            found = find(file, x, y, given, resolution=resolution, solved=solved, stopped=stopped, progress=progress)
            late = found.region.interrupted and not stopped()
            progress("drawing")
            write_region(found, folder)
    interrupted = found.region.interrupted
    if interrupted:
        holds = f"{folder / REGION_FILE}: holds what was decided before"
        if late:
            warn("time-limit", f"{holds} the time limit")
        else:
            warn("interrupted", f"{holds} the interrupt")
    lines = [f"{kind:10} {100 * share:7.2f} %" for kind, share in found.areas.items()]
    if interrupted:
        lines[-1] += f"  {'out of time' if late else 'interrupted'}: the search did not examine the whole plane"
    lines.append(f"of the plane {x} by {y}")
    steps = [f"open {folder / PICTURE}", *(["run it again with more time to decide more cells"] * interrupted)]

    def table() -> None:
        from vctune.cli.printing.design_table import print_lines

        print_lines(lines, folder, steps)

    answer(style, quiet, found.record, table)
    return ExitCode.UNDECIDED if interrupted else of_status(found.status)
