"""Define `vctune example`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import output_options


def _names(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the names that begin with the text that the user has typed."""
    from vctune.api.examples import example_names

    return [name for name in example_names() if name.startswith(incomplete)]


@click.command(short_help="Write one of the example problems that come with vctune.")
@click.argument("name", required=False, shell_complete=_names)
@click.option("--out", type=click.Path(path_type=Path), default=".", show_default=True, help="Folder for NAME.toml.")
@output_options()
def example(name: str | None, out: Path, style: str, quiet: bool) -> int:
    """Write the example problem NAME.toml. Without NAME, list the examples."""
    from vctune.api.examples import ExampleRecord, example_names, write_example
    from vctune.cli.printing.output import answer
    from vctune.exit_codes import ExitCode

    if name is None:
        names, file = list(example_names()), None
        lines = names
    else:
        names, file = [name], str(write_example(name, out))
        lines = [f"written to {file}; next: vctune solve {file}"]
    answer(style, quiet, ExampleRecord(names=names, file=file).to_json, lambda: click.echo("\n".join(lines)))
    return ExitCode.OK
