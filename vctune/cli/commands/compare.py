"""Define `vctune compare`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command, time_limited
from vctune.cli.runner import Run


@command("Show two designs side by side.")
@click.argument("a", type=PATH)
@click.argument("b", type=PATH)
@time_limited
def compare(run: Run, a: Path, b: Path) -> int:
    """Show the designs A and B side by side: what differs in their problems, and every number of both.

    A and B are files design.json, or problem files, which vctune then solves; B with the bands and the Z_0 of A if it
    states none. The command writes no files.
    """
    from vctune.api.comparing import compare as find

    with run.progress(a.name, b.name) as progress:
        found = find(a, b, progress=progress)
    run.say(found.to_json, found.rows)
    return found.exit_code
