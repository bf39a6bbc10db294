"""`vctune region`."""

from __future__ import annotations

from pathlib import Path

import click

KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")


@click.command(short_help="Find the whole set of admissible gains, cell by cell.")
@click.argument("problem", type=click.Path(path_type=Path))
@click.option("--x", type=click.Choice(KEYS), default="gains.velocity", show_default=True, help="Across.")
@click.option("--y", type=click.Choice(KEYS), default="gains.position", show_default=True, help="Up.")
@click.option(
    "--resolution",
    type=click.FloatRange(1 / 2048, 1 / 8),
    default=1 / 256,
    show_default="1/256",
    help="Side of the smallest cell as a share of the plane's.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("results"), show_default=True, help="Folder for OUT/NAME/."
)
def region(problem: Path, x: str, y: str, resolution: float, out: Path) -> int:
    """Find the gains of PROBLEM for which its demands hold.

    The plane of two variables is divided into cells that are proved feasible throughout, proved infeasible throughout,
    or undecided at the resolution. Where the coupling is free, feasible means that some coupling within its bounds will
    do. Writes OUT/NAME/region.json, a baseline for `vctune check --region`, and region.svg.

    Exit code 0 if there are admissible gains, 1 if there are none, 3 if neither is proved.
    """
    from math import ceil, log2

    from vctune.cli.output import emit
    from vctune.cli.progress import progress_on_stderr
    from vctune.document.errors import InputError
    from vctune.document.files import folder_name, make_folder, write_together
    from vctune.document.reading import read_problem
    from vctune.study.plane import obstacles, plane

    file = read_problem(problem)
    if mistakes := obstacles(file.problem, x, y):
        raise InputError(str(problem), mistakes)
    folder = out / folder_name(file.problem.name)
    make_folder(folder)

    import json

    from vctune.design.judge import Status
    from vctune.design.solve import solve
    from vctune.exits import ExitCode
    from vctune.study.baseline import region_record
    from vctune.study.region import Kind
    from vctune.study.region import region as find

    with progress_on_stderr(f"vctune region {problem.name}", shown=True) as progress:
        across = plane(file.problem, x, y, ceil(-log2(resolution)))
        found = find(file.problem, across, across.whole(), progress)
        solved = solve(file.problem, progress)
        best = solved.judgement if solved.status is Status.CERTIFIED else None
        designs = [(best.gains, best.coupling)] if best else []
        record = region_record(file, found, designs)
        progress("drawing")
        from vctune.report.page import figure_file
        from vctune.report.region import region_figure

        text = json.dumps(record, allow_nan=False)
        pictures = figure_file(region_figure(file.problem, found, designs), folder, "region")
        write_together({folder / "region.json": text + "\n", **pictures})
    for kind in (Kind.FEASIBLE, Kind.INFEASIBLE, Kind.UNDECIDED):
        emit(f"{kind.name.lower():10} {100 * found.area(kind):7.2f} %")
    emit(f"of the plane {x} by {y}; written to {folder}")
    if found.area(Kind.FEASIBLE) > 0 or designs:
        return ExitCode.OK
    impossible = solved.status is Status.INFEASIBLE or found.area(Kind.UNDECIDED) == 0
    return ExitCode.FAILED if impossible else ExitCode.UNDECIDED
