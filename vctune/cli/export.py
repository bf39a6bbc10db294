"""`vctune export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vctune.cli.options import out_option

if TYPE_CHECKING:
    from vctune.api.exporting import Format
    from vctune.firmware.firmware import Precision


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
def export(source: Path, gains: Path | None, to: Format, precision: Precision, unproved: bool, out: Path) -> int:
    """Make firmware of a design.json of `vctune solve`, of PROBLEM with GAINS, or of a PROBLEM whose numbers are fixed.

    The design is proved again, with the constants that the firmware will have. Exit code 1 or 3 if that refutes it or
    leaves it undecided; nothing is written then, unless --unproved is given.
    """
    from vctune.api.exporting import Exported, files_of, refusal, stated_design, write_export
    from vctune.cli.exits import of_status
    from vctune.cli.output import emit
    from vctune.cli.progress import progress_on_stderr
    from vctune.design.judge import Status
    from vctune.document.errors import printable
    from vctune.document.files import folder_name
    from vctune.firmware.c_source import statement
    from vctune.firmware.firmware import certified, firmware

    file, design = stated_design(source, gains, None)
    with progress_on_stderr(f"vctune export {source.name}", shown=True) as progress:
        progress("proving")
        made = firmware(file, *design, precision)
        if not certified(made) and not unproved:
            click.echo(f"{printable(file.problem.name)}: {printable(refusal(made))}", err=True)
            return of_status(Status(made.record.status))
        files = files_of(file, made, to, progress)
        place = write_export(Exported(file, made, files), out / folder_name(file.problem.name))
    emit("\n".join(printable(line) for line in statement(made) if line))
    click.echo(f"written to {place}: {', '.join(files)}", err=True)
    return 0
