"""Define `vctune example`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.options import PATH, command
from vctune.cli.runner import Run


def _names(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the names that begin with the text that the user has typed."""
    from vctune.api.explaining import example_names

    return [name for name in example_names() if name.startswith(incomplete)]


@command("Write one of the example problems that come with vctune.")
@click.argument("name", required=False, shell_complete=_names)
@click.option("--out", type=PATH, default=".", show_default=True, help="Folder for NAME.toml.")
def example(run: Run, name: str | None, out: Path) -> int:
    """Write the example problem NAME.toml. Without NAME, list the examples."""
    from vctune.api.explaining import example_names, example_purpose, write_example
    from vctune.document.text.json import printed

    names, file = example_names() if name is None else [name], None if name is None else str(write_example(name, out))
    width = max(map(len, names))
    listed = (f"{each:{width}}  {example_purpose(each)}" for each in names)
    lines = [f"written to {file}; next: vctune solve {file}"] if file else listed
    run.say(lambda: printed("example", names=names, file=file), lambda: ((line,) for line in lines))
    return 0
