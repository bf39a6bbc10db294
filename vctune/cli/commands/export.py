"""`vctune export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.cli.printing.options import out_option, output_options

if TYPE_CHECKING:
    from vctune.api.exporting import Format
    from vctune.simulation.firmware.stepped import Precision


@click.command(short_help="Make firmware of a design: C99, an FMU, or JSON.")
@click.argument("source", type=click.Path(path_type=Path), metavar="DESIGN.json|PROBLEM.toml")
@click.argument("gains", type=click.Path(path_type=Path), required=False)
@click.option("--to", type=click.Choice(["c", "fmu", "json"]), default="c", show_default=True, help="What to make.")
@click.option(
    "--precision",
    type=click.Choice(["double", "single"]),
    default="double",
    show_default=True,
    help="Of the firmware's numbers; the constants are proved again as they are rounded.",
)
@click.option("--unproved", is_flag=True, help="Export what is not proved too; every file says so at its top.")
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
    """Make firmware of a design.json of `vctune solve`, of PROBLEM with GAINS, or of a PROBLEM whose numbers are fixed.

    The design is proved again, with the constants that the firmware will have. Exit code 1 or 3 if that refutes it or
    leaves it undecided; nothing is written then, unless --unproved is given.
    """
    from vctune.api.exporting import NotCertifiedError, write_export
    from vctune.api.exporting import export as make
    from vctune.cli.printing.exits import of_status
    from vctune.cli.printing.output import answer, warn
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.document.reading import read_gains
    from vctune.document.records.printed_json import ExportRecord
    from vctune.document.text.errors import printable
    from vctune.document.text.output_files import folder_name
    from vctune.exit_codes import ExitCode
    from vctune.firmware.preamble import statement

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
    made = exported.firmware
    lines = [printable(line) for line in statement(made) if line]
    record = ExportRecord(
        name=made.name, status=made.record.status, statement=lines, folder=str(place), files=list(exported.files)
    )
    answer(style, quiet, record.to_json, lambda: click.echo("\n".join(lines)))
    if not quiet:
        click.echo(f"written to {place}: {', '.join(exported.files)}", err=True)
    return ExitCode.OK
