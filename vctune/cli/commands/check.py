"""Define `vctune check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.cli.printing.options import out_option, output_options, time_limited

if TYPE_CHECKING:
    from vctune.api.checking import Checked
    from vctune.cli.printing.progress import Progress
    from vctune.document.reading import ProblemFile


@click.command(short_help="Prove gains that already exist.")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PROBLEM... [GAINS]...")
@click.option(
    "--region", "baseline", type=click.Path(path_type=Path), help="Prove the cells and gains of this region.json again."
)
@click.option("--strict", is_flag=True, help="Fail the check if there is a warning.")
@out_option("NAME/lost.json and its picture, if a part of a region is no longer proved")
@output_options("github")
@time_limited
def check(
    paths: tuple[Path, ...],
    style: str,
    quiet: bool,
    baseline: Path | None,
    strict: bool,
    out: Path,
) -> int:
    """Prove gains that already exist. The exit code is the code of the worst result.

    Without GAINS, PROBLEM must fix all gains and the whole coupling. With several GAINS files, the command checks one
    PROBLEM with each of them. A folder stands for all .toml files in it.

    A YAML file in place of GAINS is a parameter file of a ROS 2 admittance_controller. The command checks each axis
    that the YAML file selects with the device of PROBLEM: a servo, or a device whose [gains] are fixed. Rotations
    need a rotary device, and translations a linear one. If an axis does not fit, the command skips it and exits with
    code 3. Several PROBLEMs share the axes. A PROBLEM whose name is x, y, z, rx, ry or rz is only for this axis.

    With --region, the check passes only if vctune can still prove the feasible cells and the gain sets of a region.json
    for PROBLEM. `vctune region` writes this file.
    """
    from dataclasses import replace
    from functools import partial

    from vctune import read_problem
    from vctune.api.checking import check_files, check_parameter_files, is_admittance
    from vctune.cli.printing.exits import of_check, worst
    from vctune.cli.printing.formats import FORMATS
    from vctune.cli.printing.output import emit, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr

    files = [file for path in paths for file in _files(path)]
    admittances = [file for file in files if is_admittance(file)]
    show_doubts = partial(warn_of_doubts, quiet=quiet)
    with progress_on_stderr("vctune check", shown=not quiet) as progress:
        others = [file for file in files if file not in admittances]
        problem = read_problem(others[0]) if baseline is not None and others else None
        if admittances:
            checks_found = check_parameter_files(others, admittances, progress, show_doubts)
        elif baseline is None or len(others) > 1:
            checks_found = check_files(others, progress, show_doubts)
        else:
            checks_found = []
            if problem is not None:
                show_doubts(problem.problem)
        if baseline is not None and problem is not None:  # after the gains, since a time limit may end it
            checks_found.append(_against(problem, baseline, out, progress))
    checks = [replace(checked, strict=strict) for checked in checks_found]
    if style != "text" or not quiet:
        emit(FORMATS[style](checks))
    elif refused := [checked for checked in checks if checked.finding is None]:
        click.echo(FORMATS[style](refused), err=True)
    return worst(of_check(checked.result) for checked in checks)


def _against(file: ProblemFile, baseline: Path, out: Path, progress: Progress) -> Checked:
    """Check a region for a problem. Write its losses, or remove those of an earlier check."""
    from vctune import InputError
    from vctune.api.checking import LOST, recheck, refused_region, remove_lost, write_lost
    from vctune.api.folders import folder_name

    try:
        checked, again = recheck(file, baseline, progress)
    except InputError as error:
        return refused_region(baseline, error)
    folder = out / folder_name(checked.name)
    if again.lost and not again.cut:
        write_lost(checked, again, folder)
        click.echo(f"the lost cells and gain sets are listed and drawn in {folder}: {', '.join(LOST)}", err=True)
    elif not again.cut and (gone := remove_lost(folder)):
        click.echo(f"everything is proved again: removed {', '.join(gone)} from {folder}", err=True)
    return checked


def _files(path: Path) -> list[Path]:
    """Return the files that an argument names: the file itself, or the .toml files in a folder."""
    from vctune import InputError

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix == ".toml")
    if not files:
        raise InputError.of(str(path), "ambiguous-files", "holds no .toml file")
    return files
