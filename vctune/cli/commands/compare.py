"""Define `vctune compare`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command
from vctune.cli.runner import Run


@command("Show two designs or problems side by side.")
@click.argument("a", type=PATH)
@click.argument("b", type=PATH)
def compare(run: Run, a: Path, b: Path) -> int:
    """Show the differences between A and B.

    A and B are design.json files or problem files; vctune first solves a problem file. The command prints the keys in
    which the problems differ, with defaults filled in, then the numbers and verdicts of both designs. It writes no
    files.
    """
    from vctune.api.comparing import compare as set_side_by_side

    with run.progress(a.name, b.name) as progress:
        found = set_side_by_side(a, b, progress=progress)
    run.say(found.to_json, found.rows)
    return 0
