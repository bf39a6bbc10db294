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

    kinds = [(file, _kind(file)) for path in paths for file in _files(path)]
    problems, gains, broken = ([file for file, kind in kinds if kind == wanted] for wanted in ("problem", "gains", ""))
    if not gains:
        return [(file, None) for file, _ in kinds]
    if len(problems) == 1:
        return [*((file, None) for file in broken), *((problems[0], file) for file in gains)]
    if broken:
        return [(file, None) for file in broken]
    message = f"{len(gains)} gains files with {len(problems)} problems; name exactly one problem with gains files"
    raise InputError(str(gains[0]), [Mistake("", message)])


def _files(path: Path) -> list[Path]:
    """Return the files that an argument stands for."""
    from vctune.document.errors import InputError, Mistake

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix == ".toml")
    if not files:
        raise InputError(str(path), [Mistake("", "holds no .toml file")])
    return files


def _kind(path: Path) -> str:
    """Return what a file is: "gains" if it has gains but no device; "" if it cannot be read, as its check will say."""
    from vctune.document import toml
    from vctune.document.errors import InputError

    try:
        document = toml.parse(toml.read_text(path), str(path))
    except InputError:
        return ""
    return "gains" if "gains" in document and "device" not in document else "problem"
