"""Define `vctune report`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import out_option, output_options


@click.command(short_help="Make a design's report again, without solving.")
@click.argument("design", type=click.Path(path_type=Path))
@out_option("report.html; by default the folder of DESIGN", None)
@output_options()
def report(design: Path, out: Path | None, style: str, quiet: bool) -> int:
    """Make report.html and its figures again for DESIGN, a design.json.

    The command does not solve the problem. If the folder has a simulation.json of the same design, the report includes
    the simulation.
    """
    from vctune.api.design_files import ReportRecord, write_report
    from vctune.cli.printing.output import answer
    from vctune.exit_codes import ExitCode

    place = str(write_report(design, out))
    answer(style, quiet, ReportRecord(report=place).to_json, lambda: click.echo(f"written to {place}", err=True))
    return ExitCode.OK
