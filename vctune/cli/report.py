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
    from vctune.document.design import read_design
    from vctune.document.files import make_folder
    from vctune.document.simulation import simulation_beside
    from vctune.exits import ExitCode
    from vctune.report.report import write_report

    record = read_design(design)
    folder = out if out is not None else design.parent
    make_folder(folder)
    write_report(record, folder, simulation_beside(design.parent, record))
    click.echo(f"written to {folder}/report.html", err=True)
    return ExitCode.OK
