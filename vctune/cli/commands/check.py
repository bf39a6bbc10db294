"""`vctune check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.api.argument_ranges import AXES
from vctune.cli.printing.options import out_option, output_options, time_limited

if TYPE_CHECKING:
    from vctune.api.checking import Checked
    from vctune.cli.printing.progress import Progress


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

    With --region one PROBLEM is held against a file of `vctune region`: its feasible cells and its gain sets must still
    be proved.
    """
    from dataclasses import replace

    from vctune.api.checking import check_files, check_parameter_files, is_admittance
    from vctune.cli.printing.exits import of_check
    from vctune.cli.printing.formats import FORMATS
    from vctune.cli.printing.output import emit
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    files = [file for path in paths for file in _files(path)]
    admittances = [file for file in files if is_admittance(file)]
    if axes and not admittances:
        raise click.UsageError("--axis selects axes of a ROS 2 parameter file, and no .yaml file is named")
    with progress_on_stderr("vctune check", shown=not quiet) as progress:
        if admittances and baseline is None:
            found = check_parameter_files([file for file in files if file not in admittances], admittances, axes)
        else:
            found = check_files(files, progress) if baseline is None else _against(baseline, files, out, progress)
    checks = [replace(checked, strict=strict) for checked in found]
    if style != "text" or not quiet:
        emit(FORMATS[style](checks))
    elif refused := [checked for checked in checks if checked.finding is None]:
        click.echo(FORMATS[style](refused), err=True)
    severity = [ExitCode.OK, ExitCode.UNDECIDED, ExitCode.FAILED, ExitCode.BAD_INPUT]
    return max((of_check(checked.result) for checked in checks), key=severity.index)


def _against(baseline: Path, files: list[Path], out: Path, progress: Progress) -> list[Checked]:
    """Check a region, and the gains files that are named after its problem; draw what the region has lost."""
    from vctune import read_problem
    from vctune.api.checking import LOST, check_files, recheck, remove_lost, write_lost
    from vctune.api.folders import folder_name

    checked, again = recheck(read_problem(files[0]), baseline, progress)
    folder = out / folder_name(checked.name)
    if again.lost and not again.cut:
        write_lost(checked, again, folder)
        click.echo(f"what was lost is listed and drawn in {folder}: {', '.join(LOST)}", err=True)
    elif not again.cut and (gone := remove_lost(folder)):
        click.echo(f"nothing is lost any more: removed {', '.join(gone)} from {folder}", err=True)
    return [checked, *(check_files(files, progress) if len(files) > 1 else [])]


def _files(path: Path) -> list[Path]:
    """Return the files that an argument stands for."""
    from vctune import InputError

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix == ".toml")
    if not files:
        raise InputError.of(str(path), "ambiguous-files", "holds no .toml file")
    return files
