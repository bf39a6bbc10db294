"""Define `vctune export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from vctune.api.argument_ranges import Format
from vctune.cli.printing.options import out_option, output_options

if TYPE_CHECKING:
    from vctune import AxesFile
    from vctune.api.exporting import Precision


@click.command(short_help="Export a design as firmware, or as data for your own.")
@click.argument("source", type=click.Path(path_type=Path), metavar="DESIGN.json|PROBLEM.toml")
@click.argument("gains", type=click.Path(path_type=Path), required=False)
@click.option("--to", type=click.Choice(get_args(Format)), default="c", show_default=True, help="Output format.")
@click.option(
    "--precision",
    type=click.Choice(["double", "single"]),
    default="double",
    show_default=True,
    help="Precision of the firmware. vctune proves the design again with the rounded constants.",
)
@click.option(
    "--unproved",
    is_flag=True,
    help="Export the design even if it is not proved. The head of every file then warns that the design is not proved.",
)
@out_option("NAME/firmware/")
@output_options()
def export(
    source: Path,
    gains: Path | None,
    to: Format,
    precision: Precision,
    unproved: bool,
    out: Path,
    style: str,
    quiet: bool,
) -> int:
    """Export a design as firmware.

    The design is a DESIGN.json of `vctune solve`, a PROBLEM with GAINS, or a PROBLEM that fixes all gains and the whole
    coupling. For a PROBLEM with several [[axis]] tables, GAINS is OUT/NAME, the folder of `vctune solve`. `--to ros2`
    writes the parameter file of an admittance_controller that commands a servo.

    vctune proves the design again with the constants of the firmware. If the design is refuted, the exit code is 1; if
    it is undecided, 3. In both cases the command writes files only with --unproved.
    """
    from vctune import read_axes
    from vctune.api.exporting import NotCertifiedError, export_record, read_gains, write_export
    from vctune.api.exporting import export as make
    from vctune.api.folders import folder_name
    from vctune.cli.printing.exits import of_status
    from vctune.cli.printing.output import answer, warn
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    axes = read_axes(source)
    if axes is not None:
        return _export_axes(axes, gains, out, to=to, precision=precision, unproved=unproved, style=style, quiet=quiet)
    given = read_gains(gains) if gains else None
    try:
        with progress_on_stderr(f"vctune export {source.name}", shown=not quiet) as progress:
            exported = make(source, given, to=to, precision=precision, unproved=unproved, progress=progress)
            place = write_export(exported, out / folder_name(exported.firmware.name))
    except NotCertifiedError as refused:
        click.echo(str(refused), err=True)
        return of_status(refused.status)
    if given and given.sha256 not in (None, exported.firmware.problem_sha256):
        warn("other-version", f"{gains}: made for another version of the problem (sha256 differs)")
    record = export_record(exported, place)
    answer(style, quiet, record.to_json, lambda: click.echo("\n".join(record.statement)))
    if not quiet:
        click.echo(f"written to {place}: {', '.join(record.files)}", err=True)
    return ExitCode.OK


def _export_axes(
    axes: AxesFile,
    gains: Path | None,
    out: Path,
    *,
    to: Format,
    precision: Precision,
    unproved: bool,
    style: str,
    quiet: bool,
) -> int:
    """Export the designs of several axes, print the results, and return the exit code."""
    from vctune.api.exporting import NotCertifiedError, export_record
    from vctune.api.uncoupled_axes import export_axes, gains_of_axes
    from vctune.cli.printing.exits import of_status
    from vctune.cli.printing.output import answer
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    gains_by_axis = gains_of_axes(axes, gains) if gains else None
    try:
        with progress_on_stderr(f"vctune export {axes.name}", shown=not quiet) as progress:
            exported = export_axes(
                axes, gains_by_axis, out, to=to, precision=precision, unproved=unproved, progress=progress
            )
    except NotCertifiedError as refused:
        click.echo(str(refused), err=True)
        return of_status(refused.status)
    records = [export_record(firmware, place) for firmware, place in exported]
    answer(
        style,
        quiet,
        lambda: [record.to_json() for record in records],
        lambda: click.echo("\n".join(line for record in records for line in record.statement)),
    )
    for record in () if quiet else records:
        click.echo(f"written to {record.folder}: {', '.join(record.files)}", err=True)
    return ExitCode.OK
