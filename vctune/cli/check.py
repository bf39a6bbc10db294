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
    from vctune.design.check import check as check_one
    from vctune.exits import ExitCode

    checks = [check_one(problem, gains) for problem, gains in _pairs(paths)]
    emit(FORMATS[style](checks))
    severity = [ExitCode.OK, ExitCode.UNDECIDED, ExitCode.FAILED, ExitCode.BAD_INPUT]
    return max((checked.exit_code for checked in checks), key=severity.index)


def _pairs(paths: tuple[Path, ...]) -> list[tuple[Path, Path | None]]:
    """Return which gains file, if any, goes with which problem."""
    from vctune.document.errors import InputError, Mistake

    files = [file for path in paths for file in (sorted(path.glob("*.toml")) if path.is_dir() else [path])]
    if not files:
        raise InputError(str(paths[0]), [Mistake("", "holds no .toml file")])
    gains = [file for file in files if _is_gains(file)]
    problems = [file for file in files if file not in gains]
    if not gains:
        return [(problem, None) for problem in problems]
    if len(problems) != 1:
        message = f"{len(gains)} gains files with {len(problems)} problems; name exactly one problem with gains files"
        raise InputError(str(gains[0]), [Mistake("", message)])
    return [(problems[0], file) for file in gains]


def _is_gains(path: Path) -> bool:
    """Return whether a file has gains but no device; what cannot be read is left to the check."""
    import tomllib

    try:
        with path.open("rb") as file:
            document = tomllib.load(file)
    except (OSError, ValueError, RecursionError):
        return False
    return "gains" in document and "device" not in document
