"""Define `vctune identify`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command, out_option
from vctune.cli.runner import Run


@command("Identify a device from its recordings.")
@click.argument("logs", type=PATH, nargs=-1, required=True, metavar="LOG...")
@click.option("--config", type=PATH, help="A log.toml that names the columns and their units.")
@click.option("--servo", is_flag=True, help="Each LOG holds a servo's command and position.")
@out_option()
@click.option("--no-report", is_flag=True, help="Write no report and no figures.")
def identify(run: Run, logs: tuple[Path, ...], config: Path | None, servo: bool, out: Path, no_report: bool) -> int:
    """Identify a device from recordings of its motion. Each LOG is a CSV file (also .gz).

    The command writes device.toml, a problem file for `vctune solve` with the device, the uncertainty of each parameter
    and what no log shows; identification.json; and report.html with figures.
    """
    from vctune.api.identifying import identify as find
    from vctune.api.identifying import write_identification
    from vctune.api.result import folder_name

    with run.progress() as progress:
        identified = find(logs, config, servo=servo, progress=progress)
        folder = out / folder_name(identified.record.name)
        progress("writing and drawing")
        write_identification(identified, folder, report=not no_report)
    return run.show(identified, identified.record.to_json, folder, identified.steps(folder))
