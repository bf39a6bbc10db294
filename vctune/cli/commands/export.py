"""Define `vctune export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from vctune.api.argument_ranges import Format
from vctune.cli.printing.options import out_option, output_options

if TYPE_CHECKING:
    from vctune.api.exporting import Precision


@click.command(short_help="Export a design as firmware, or as data for your own.")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="DESIGN|PROBLEM... [GAINS]")
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
    paths: tuple[Path, ...],
    to: Format,
    precision: Precision,
    unproved: bool,
    out: Path,
    style: str,
    quiet: bool,
) -> int:
    """Export a design as firmware.

    The design is a DESIGN.json of `vctune solve`, a PROBLEM with GAINS, or a PROBLEM that fixes all gains and the whole
    coupling. `--to ros2` writes the parameter file of an admittance_controller that commands a servo. Only this format
    accepts several designs. They share the axes of the file: linear devices are for x, y and z, rotary ones for rx, ry
    and rz, and a problem whose name is one of these is only for this axis.

    vctune proves the design again with the constants of the firmware. If the design is refuted, the exit code is 1; if
    it is undecided, 3. In both cases the command writes files only with --unproved.
    """
    from vctune.api.exporting import (
        NotCertifiedError,
        export_parameters,
        export_record,
        is_source,
        read_gains,
        require_double,
        write_export,
    )
    from vctune.api.exporting import export as make
    from vctune.api.folders import folder_name
    from vctune.cli.printing.exits import of_status
    from vctune.cli.printing.output import answer, warn
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    source, *others = paths
    gains = others.pop() if len(others) == 1 and (to != "ros2" or not is_source(others[0])) else None
    if others and to != "ros2":
        raise click.UsageError(f"--to {to} exports one design; only --to ros2 makes one file of several")
    given = read_gains(gains) if gains else None
    try:
        with progress_on_stderr(f"vctune export {source.name}", shown=not quiet) as progress:
            if others:
                require_double(precision)
                exported = export_parameters(paths, unproved=unproved, progress=progress)
            else:
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
