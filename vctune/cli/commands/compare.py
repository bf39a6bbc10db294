"""Define `vctune compare`."""

from __future__ import annotations

from pathlib import Path

import click

from vctune.cli.printing.options import output_options


@click.command(short_help="Show two designs or problems side by side.")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@output_options()
def compare(a: Path, b: Path, style: str, quiet: bool) -> int:
    """Show the differences between A and B.

    A and B are design.json files or problem files. If you name a problem file, vctune first solves the problem. The
    command prints the keys in which the problems differ, with every default filled in. Then the command prints the
    gains, the error and its terms, the verdicts and the margins of both designs. The command writes no files.
    """
    from vctune.api.comparing import compare as set_side_by_side
    from vctune.cli.printing.output import answer
    from vctune.cli.printing.progress import progress_on_stderr
    from vctune.exit_codes import ExitCode

    with progress_on_stderr(f"vctune compare {a.name} {b.name}", shown=not quiet) as progress:
        found = set_side_by_side(a, b, progress=progress)

    def table() -> None:
        from vctune.cli.printing.side_by_side import print_comparison

        print_comparison(found)

    answer(style, quiet, found.to_json, table)
    return ExitCode.OK
