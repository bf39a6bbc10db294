"""`vctune report`."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(short_help="Make a design's report again, without solving.")
@click.argument("design", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the report.  [default: beside DESIGN]")
def report(design: Path, out: Path | None) -> int:
    """Make the report of DESIGN, a design.json, again: report.html and its figures. Nothing is solved.

    A simulation.json of the same design beside it is drawn too.
    """
    from vctune.api.files import write_report
    from vctune.exit_codes import ExitCode

    click.echo(f"written to {write_report(design, out)}", err=True)
    return ExitCode.OK
