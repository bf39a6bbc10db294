"""`vctune check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.cli.printing.options import out_option, output_options, time_limited
from vctune.document.ros import AXES

if TYPE_CHECKING:
    from collections.abc import Callable

    from vctune.cli.printing.progress import Progress
    from vctune.design.verdict.checked import Checked
    from vctune.document.problem_axes import AxesFile
    from vctune.model.problem import Problem

    Said = Callable[[Problem], None]


@click.command(short_help="Prove gains that already exist.")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PROBLEM... [GAINS]...")
@click.option(
    "--region", "baseline", type=click.Path(path_type=Path), help="Prove again what this region.json had proved."
)
@click.option(
    "--axis",
    "axes",
    type=click.Choice(AXES),
    multiple=True,
    help="Axis of a ROS 2 file to check.  [default: all selected]",
)
@click.option("--strict", is_flag=True, help="A warning fails the check.")
@out_option("NAME/lost.json and its picture when a region has lost cells")
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
    """Prove gains that already exist; the worst exit code of all checks wins.

    PROBLEM files whose numbers are all fixed are checked as they stand. One PROBLEM with GAINS files is checked with
    each of them. A folder stands for the .toml files in it.

    A YAML file in the place of GAINS is a parameter file of a ROS 2 admittance_controller: each of its selected axes is
    checked with the device of one PROBLEM whose [gains] are fixed. Rotations need a rotary device, translations a
    linear one: other axes are not looked at, exit code 3, unless --axis selects those that fit.

    With several [[axis]] each is checked: with the numbers that it fixes, with its gains in the folder OUT/NAME of
    `vctune solve`, or with the axis of that name of a ROS 2 file.

    With --region one PROBLEM is held against a file of `vctune region`: its feasible cells and its gain sets must still
    be proved.
    """
    from dataclasses import replace
    from functools import partial

    from vctune.cli.printing.exits import of_check, worst
    from vctune.cli.printing.formats import FORMATS
    from vctune.cli.printing.output import emit, warn_of_doubts
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.design.verdict.gains_check import check as check_files
    from vctune.document.ros import is_admittance

    several = next(filter(None, map(_axes, paths)), None) if baseline is None else None
    if several is None:
        files = [file for path in paths for file in _files(path)]
    else:
        files = [path for path in paths if str(path) != several.axes[0].file.source]
    admittances = [file for file in files if is_admittance(file)]
    if axes and not admittances:
        raise click.UsageError("--axis selects axes of a ROS 2 parameter file, and no .yaml file is named")
    said = partial(warn_of_doubts, quiet=quiet)
    with progress_on_stderr("vctune check", shown=not quiet) as progress:
        if several is not None:
            found = _of_axes(several, files, axes, progress, said)
        elif admittances and baseline is None:
            found = _admittances([file for file in files if file not in admittances], admittances, axes, progress, said)
        elif baseline is None:
            found = check_files(files, progress, said)
        else:
            found = _against(baseline, files, out, progress, said)
    checks = [replace(checked, strict=strict) for checked in found]
    if style != "text" or not quiet:
        emit(FORMATS[style](checks))
    elif refused := [checked for checked in checks if checked.finding is None]:
        click.echo(FORMATS[style](refused), err=True)
    return worst(of_check(checked.result) for checked in checks)


def _against(baseline: Path, files: list[Path], out: Path, progress: Progress, said: Said) -> list[Checked]:
    """Check a region, and the gains files that are named after its problem; draw what the region has lost."""
    from vctune.api.checking import LOST, remove_lost, write_lost
    from vctune.design.verdict.gains_check import check as check_files
    from vctune.document.reading import read_problem
    from vctune.document.text.output_files import folder_name
    from vctune.study.region_check import check_region

    file = read_problem(files[0])
    said(file.problem)
    checked, again = check_region(file, baseline, progress)
    folder = out / folder_name(checked.name)
    if again.lost and not again.cut:
        write_lost(checked, again, folder)
        click.echo(f"what was lost is listed and drawn in {folder}: {', '.join(LOST)}", err=True)
    elif not again.cut and (gone := remove_lost(folder)):
        click.echo(f"nothing is lost any more: removed {', '.join(gone)} from {folder}", err=True)
    return [checked, *(check_files(files, progress) if len(files) > 1 else [])]


def _admittances(
    problems: list[Path], admittances: list[Path], axes: tuple[str, ...], progress: Progress, said: Said
) -> list[Checked]:
    """Check parameter files of ROS 2 against one problem."""
    from vctune.design.ros.admittance_check import check_admittance
    from vctune.document.reading import read_problem
    from vctune.document.ros import read_admittance
    from vctune.document.text.errors import InputError

    if len(problems) != 1:
        message = f"with {len(problems)} TOML files; name exactly one problem, that of the device, with files of ROS 2"
        raise InputError.of(str(admittances[0]), "ambiguous-files", message)
    problem = read_problem(problems[0])
    said(problem.problem)
    return [
        one for path in admittances for one in check_admittance(problem, path, read_admittance(path), axes, progress)
    ]


def _axes(path: Path) -> AxesFile | None:
    """Return the axes of a problem file that states several."""
    from vctune.document.problem_axes import axes_file
    from vctune.document.text import toml
    from vctune.document.text.errors import InputError

    if not path.is_file() or path.suffix != ".toml":
        return None
    try:
        text = toml.read_text(path)
        toml.parse(text, str(path))
    except InputError:
        return None  # the check of one problem tells
    return axes_file(text, path)


def _of_axes(
    several: AxesFile, files: list[Path], axes: tuple[str, ...], progress: Progress, said: Said
) -> list[Checked]:
    """Check several axes: the numbers that they fix, the gains of `vctune solve`, or the parameters of ROS 2."""
    from vctune.api.axes import check_axes, check_parameters, gains_of_axes
    from vctune.document.ros import is_admittance
    from vctune.document.text.errors import InputError

    said(*(axis.file.problem for axis in several.axes))
    if files and all(map(is_admittance, files)):
        return [one for path in files for one in check_parameters(several, path, axes, progress)]
    if len(files) > 1 or (files and not files[0].is_dir()):
        message = (
            "with a problem of several axes; name the folder of their designs, OUT/NAME of `vctune solve`, or "
            "files of ROS 2"
        )
        raise InputError.of(str(files[0]), "ambiguous-files", message)
    return check_axes(several, gains_of_axes(several, files[0]) if files else None, progress)


def _files(path: Path) -> list[Path]:
    """Return the files that an argument stands for."""
    from vctune.document.text.errors import InputError

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix == ".toml")
    if not files:
        raise InputError.of(str(path), "ambiguous-files", "holds no .toml file")
    return files
