"""Define `vctune report`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command, out_option
from vctune.cli.runner import Run


@command("Make a design's report again, without solving.")
@click.argument("design", type=PATH)
@out_option("report.html; by default the folder of DESIGN", None)
def report(run: Run, design: Path, out: Path | None) -> int:
    """Make report.html and its figures again for DESIGN, a design.json.

    The command does not solve the problem. If the folder has a simulation.json of the same design, the report includes
    the simulation.
    """
    from vctune.api.solving import write_report
    from vctune.document.text.json import printed

    place = str(write_report(design, out))
    if run.style == "json":
        run.say(lambda: printed("report", report=place), lambda: iter(()))
    elif not run.quiet:
        click.echo(f"written to {place}", err=True)
    return 0
