"""`vctune identify`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import out_option, output_options


@click.command(short_help="Identify a device from recordings of it.")
@click.argument("logs", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="LOG...")
@click.option("--config", type=click.Path(path_type=Path), help="A log.toml: which column is what, in which unit.")
@click.option("--servo", is_flag=True, help="The device follows a command: LOG has that command and the position.")
@out_option()
@click.option("--excitation", is_flag=True, help="Suggest a multisine for what is uncertain: excitation.csv, a period.")
@click.option("--no-report", is_flag=True, help="Write no report and no figures.")
@output_options()
def identify(
    logs: tuple[Path, ...],
    config: Path | None,
    servo: bool,
    out: Path,
    excitation: bool,
    no_report: bool,
    style: str,
    quiet: bool,
) -> int:
    """Identify a device from LOG..., CSV files (also .gz) of its motion, all of the same device.

    Writes device.toml, which `vctune solve` takes as it is: the device, how well each number is known, and what no log
    tells. Beside it identification.json and, unless --no-report, report.html with figures.
    """
    from vctune.api.folders import folder_name
    from vctune.api.identifying import identify as run
    from vctune.api.identifying import write_identification
    from vctune.cli.printing.output import answer
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    with progress_on_stderr("vctune identify", shown=not quiet) as progress:
        identified = run(logs, config, servo=servo, excitation=excitation, progress=progress)
        folder = out / folder_name(identified.record.name)
        progress("writing and drawing")
        write_identification(identified, folder, report=not no_report)

    def table() -> None:
        from vctune.cli.printing.identification_table import print_identification

        print_identification(identified.record, folder)

    answer(style, quiet, identified.record.to_json, table)
    return ExitCode.OK
