"""Define `vctune export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from vctune.api.argument_ranges import Format
from vctune.cli.options import PATH, command, out_option
from vctune.cli.runner import Run

if TYPE_CHECKING:
    from vctune.api.exporting import Precision


@command("Export a design as firmware, or as data for your own.")
@click.argument("paths", type=PATH, nargs=-1, required=True, metavar="DESIGN|PROBLEM... [GAINS]")
@click.option("--to", type=click.Choice(get_args(Format)), default="c", show_default=True, help="Output format.")
@click.option(
    "--precision",
    type=click.Choice(["double", "single"]),
    default="double",
    show_default=True,
    help="Precision of the firmware's constants.",
)
@click.option("--unproved", is_flag=True, help="Export an unproved design too; each file says so.")
@out_option("NAME/firmware/")
def export(run: Run, paths: tuple[Path, ...], to: Format, precision: Precision, unproved: bool, out: Path) -> int:
    """Export a design as firmware.

    The design is a DESIGN.json of `vctune solve`, a PROBLEM with GAINS, or a PROBLEM that fixes all gains and the whole
    coupling. `--to ros2` writes the parameter file of an admittance_controller that commands a servo. It alone accepts
    several designs: linear ones are for x, y, z, rotary ones for rx, ry, rz, and one with such a name is only for it.

    vctune proves the design again with the firmware's constants. The exit code is 1 if it is refuted, 3 if undecided.
    """
    from vctune.api.exporting import export as make
    from vctune.api.exporting import is_source, read_gains, write_export
    from vctune.api.result import folder_name

    source, *others = paths
    gains = others.pop() if len(others) == 1 and (to != "ros2" or not is_source(others[0])) else None
    if others and to != "ros2":
        raise click.UsageError(f"--to {to} exports one design; only --to ros2 makes one file of several")
    given = read_gains(gains) if gains else None
    with run.progress(source.name) as progress:
        exported = make(
            paths if others else source, given, to=to, precision=precision, unproved=unproved, progress=progress
        )
        place = write_export(exported, out / folder_name(exported.firmware.name))
    if given and given.sha256 not in (None, exported.firmware.problem_sha256):
        run.warn("other-version", f"{gains}: made for another version of the problem (sha256 differs)")
    run.say(lambda: exported.to_json(place), lambda: ((line,) for line in exported.statement))
    if not run.quiet:
        click.echo(f"written to {place}: {', '.join(exported.files)}", err=True)
    return 0
