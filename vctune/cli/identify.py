"""`vctune identify`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import out_option


@click.command(short_help="Identify a device from recordings of it.")
@click.argument("logs", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="LOG...")
@click.option("--config", type=click.Path(path_type=Path), help="A log.toml: which column is what, in which unit.")
@out_option()
@click.option("--excitation", is_flag=True, help="Suggest a multisine for what is uncertain: excitation.csv, a period.")
@click.option("--json", "as_json", is_flag=True, help="Print identification.json instead of the table.")
@click.option("--no-report", is_flag=True, help="Write no report and no figures.")
def identify(
    logs: tuple[Path, ...], config: Path | None, out: Path, excitation: bool, as_json: bool, no_report: bool
) -> int:
    """Identify a device from LOG..., CSV files (also .gz) of its motion, all of the same device.

    Writes device.toml, which `vctune solve` takes as it is: the device, how well each number is known, and what no log
    tells. Beside it identification.json and, unless --no-report, report.html with figures.
    """
    import json

    from vctune.api.identifying import identify as run
    from vctune.api.identifying import write_identification
    from vctune.cli.output import emit, reader_may_leave
    from vctune.cli.progress import progress_on_stderr
    from vctune.document.files import folder_name
    from vctune.exit_codes import ExitCode

    with progress_on_stderr("vctune identify", shown=True) as progress:
        identified = run(logs, config, excitation=excitation, progress=progress)
        folder = out / folder_name(identified.record.name)
        progress("writing and drawing")
        write_identification(identified, folder, report=not no_report)
    if as_json:
        emit(json.dumps(identified.record.to_json(), indent=1, allow_nan=False))
    else:
        from vctune.cli.identification_table import print_identification

        with reader_may_leave():
            print_identification(identified.record, folder)
    return ExitCode.OK
