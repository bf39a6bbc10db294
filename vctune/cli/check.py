"""`vctune check`."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(short_help="Prove gains that already exist.")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PROBLEM... [GAINS]...")
@click.option(
    "--format",
    "style",
    type=click.Choice(["text", "json", "github", "junit", "sarif"]),
    default="text",
    show_default=True,
    help="What to print.",
)
def check(paths: tuple[Path, ...], style: str) -> int:
    """Prove gains that already exist; the worst exit code of all checks wins.

    PROBLEM files whose numbers are all fixed are checked as they stand. One PROBLEM with GAINS files is checked with
    each of them. A folder stands for the .toml files in it.
    """
    from vctune.cli.formats import FORMATS
    from vctune.cli.output import emit
    from vctune.design.check import check as check_files
    from vctune.exits import ExitCode

    checks = check_files([file for path in paths for file in _files(path)])
    emit(FORMATS[style](checks))
    severity = [ExitCode.OK, ExitCode.UNDECIDED, ExitCode.FAILED, ExitCode.BAD_INPUT]
    return max((checked.exit_code for checked in checks), key=severity.index)


def _files(path: Path) -> list[Path]:
    """Return the files that an argument stands for."""
    from vctune.document.errors import InputError, Mistake

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix == ".toml")
    if not files:
        raise InputError(str(path), [Mistake("", "holds no .toml file")])
    return files
