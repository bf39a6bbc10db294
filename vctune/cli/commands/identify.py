"""Define `vctune identify`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import out_option, output_options


@click.command(short_help="Identify a device from its recordings.")
@click.argument("logs", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="LOG...")
@click.option("--config", type=click.Path(path_type=Path), help="A log.toml that names the columns and their units.")
@click.option(
    "--servo", is_flag=True, help="Identify a servo. Each LOG then contains the servo's command and its position."
)
@out_option()
@click.option("--no-report", is_flag=True, help="Write no report and no figures.")
@output_options()
def identify(
    logs: tuple[Path, ...],
    config: Path | None,
    servo: bool,
    out: Path,
    no_report: bool,
    style: str,
    quiet: bool,
) -> int:
    """Identify a device from recordings of its motion. Each LOG is a CSV file (also .gz).

    The command writes device.toml, a problem file for `vctune solve`. device.toml states the device, the uncertainty of
    each parameter, and the parameters that no log shows. The command also writes identification.json and, without
    --no-report, report.html with figures.
    """
    from vctune.api.folders import folder_name
    from vctune.api.identifying import identify as run
    from vctune.api.identifying import write_identification
    from vctune.cli.printing.output import answer
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    with progress_on_stderr("vctune identify", shown=not quiet) as progress:
        identified = run(logs, config, servo=servo, progress=progress)
        folder = out / folder_name(identified.record.name)
        progress("writing and drawing")
        write_identification(identified, folder, report=not no_report)

    def table() -> None:
        from vctune.cli.printing.identification_table import print_identification

        print_identification(identified.record, folder)

    answer(style, quiet, identified.record.to_json, table)
    return ExitCode.OK
