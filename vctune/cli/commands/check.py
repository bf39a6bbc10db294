"""Define `vctune check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.api.argument_ranges import AXES
from vctune.cli.printing.options import out_option, output_options, time_limited

if TYPE_CHECKING:
    from collections.abc import Callable

    from vctune import AxesFile
    from vctune.api.checking import Checked
    from vctune.cli.printing.progress import Progress

    Said = Callable[..., None]


@click.command(short_help="Prove gains that already exist.")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PROBLEM... [GAINS]...")
@click.option(
    "--region", "baseline", type=click.Path(path_type=Path), help="Prove the cells and gains of this region.json again."
)
@click.option(
    "--axis",
    "axes",
    type=click.Choice(AXES),
    multiple=True,
    help="Axis of a ROS 2 file to check; repeatable. [default: all axes that the file selects]",
)
@click.option("--strict", is_flag=True, help="Fail the check if there is a warning.")
@out_option("NAME/lost.json and its picture, if a part of a region is no longer proved")
@output_options("github", "junit", "sarif")
@time_limited
def check(
    paths: tuple[Path, ...],
    style: str,
    quiet: bool,
    baseline: Path | None,
    axes: tuple[str, ...],
    strict: bool,
    out: Path,
) -> int:
    """Prove gains that already exist. The exit code is the code of the worst result.

    Without GAINS, PROBLEM must fix all gains and the whole coupling. With several GAINS files, the command checks one
    PROBLEM with each of them. A folder stands for all .toml files in it.

    A YAML file in place of GAINS is a parameter file of a ROS 2 admittance_controller. The command checks each axis
    that the YAML file selects with the device of one PROBLEM: a servo, or a device whose [gains] are fixed. Rotations
    need a rotary device, and translations a linear one. If an axis does not fit, the command skips it and exits with
    code 3. Use --axis to select the axes that fit.

    If PROBLEM has several [[axis]] tables, the command checks each axis. The gains and the coupling of an axis come
    from the axis itself if it fixes them, from the gains in OUT/NAME (the folder of `vctune solve`), or from the axis
    of the same name in a ROS 2 file.

    With --region, the check passes only if vctune can still prove the feasible cells and the gain sets of a region.json
    for PROBLEM. `vctune region` writes this file.
    """
    from dataclasses import replace
    from functools import partial

    from vctune import read_axes
    from vctune.api.checking import check_files, check_parameter_files, is_admittance
    from vctune.cli.printing.exits import of_check, worst
    from vctune.cli.printing.formats import FORMATS
    from vctune.cli.printing.output import emit, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr

    several = next(filter(None, map(read_axes, paths)), None) if baseline is None else None
    if several is None:
        files = [file for path in paths for file in _files(path)]
    else:
        files = [path for path in paths if str(path) != several.axes[0].file.source]
    admittances = [file for file in files if is_admittance(file)]
    if axes and not admittances:
        raise click.UsageError("--axis selects axes of a ROS 2 parameter file, and no .yaml file is named")
    show_doubts = partial(warn_of_doubts, quiet=quiet)
    with progress_on_stderr("vctune check", shown=not quiet) as progress:
        if several is not None:
            checks_found = _of_axes(several, files, axes, progress, show_doubts)
        elif admittances and baseline is None:
            problems = [file for file in files if file not in admittances]
            checks_found = check_parameter_files(problems, admittances, axes, progress, show_doubts)
        elif baseline is None:
            checks_found = check_files(files, progress, show_doubts)
        else:
            checks_found = _against(baseline, files, out, progress, show_doubts)
    checks = [replace(checked, strict=strict) for checked in checks_found]
    if style != "text" or not quiet:
        emit(FORMATS[style](checks))
    elif refused := [checked for checked in checks if checked.finding is None]:
        click.echo(FORMATS[style](refused), err=True)
    return worst(of_check(checked.result) for checked in checks)


def _against(baseline: Path, files: list[Path], out: Path, progress: Progress, show_doubts: Said) -> list[Checked]:
    """Check a region and the gains files for its problem. Write the losses of the region, or remove those of an earlier
    check."""
    from vctune import read_problem
    from vctune.api.checking import LOST, check_files, recheck, remove_lost, write_lost
    from vctune.api.folders import folder_name

    file = read_problem(files[0])
    show_doubts(file.problem)
    checked, again = recheck(file, baseline, progress)
    folder = out / folder_name(checked.name)
    if again.lost and not again.cut:
        write_lost(checked, again, folder)
        click.echo(f"the lost cells and gain sets are listed and drawn in {folder}: {', '.join(LOST)}", err=True)
    elif not again.cut and (gone := remove_lost(folder)):
        click.echo(f"everything is proved again: removed {', '.join(gone)} from {folder}", err=True)
    return [checked, *(check_files(files, progress) if len(files) > 1 else [])]


def _of_axes(
    several: AxesFile, files: list[Path], axes: tuple[str, ...], progress: Progress, show_doubts: Said
) -> list[Checked]:
    """Check several axes with the values that they fix, with the gains in a folder of `vctune solve`, or with a ROS 2
    file."""
    from vctune import InputError
    from vctune.api.checking import is_admittance
    from vctune.api.uncoupled_axes import check_axes, check_parameters, gains_of_axes

    show_doubts(*(axis.file.problem for axis in several.axes))
    if files and all(map(is_admittance, files)):
        return [check for path in files for check in check_parameters(several, path, axes, progress)]
    if len(files) > 1 or (files and not files[0].is_dir()):
        message = (
            "with a problem of several axes; name the folder of their designs, OUT/NAME of `vctune solve`, or "
            "files of ROS 2"
        )
        raise InputError.of(str(files[0]), "ambiguous-files", message)
    return check_axes(several, gains_of_axes(several, files[0]) if files else None, progress)


def _files(path: Path) -> list[Path]:
    """Return the files that an argument names: the file itself, or the .toml files in a folder."""
    from vctune import InputError

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix == ".toml")
    if not files:
        raise InputError.of(str(path), "ambiguous-files", "holds no .toml file")
    return files
