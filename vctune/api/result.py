"""Define what every command gives back: rows to print, files to write, an object for JSON and an exit code."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

from vctune.document.reading import ProblemFile
from vctune.document.text.errors import Code, InputError, Mistake
from vctune.document.text.output_files import Content, make_folder, write_together
from vctune.document.text.output_files import folder_name as folder_name
from vctune.exit_codes import ExitCode

DESIGN_FILE, GAINS_FILE = "design.json", "gains.toml"

Span = str | tuple[str, str]  # A text, or a text with its style
Line = tuple[Span, ...]
Files = dict[Path, Content | None]  # Contents by path; None stands for a file of an earlier run, to be removed


class Table(NamedTuple):
    """Rows of texts. Without `heads`, the first column is a heading of the rows below it and stands only once."""

    rows: list[tuple[str, ...]]
    heads: tuple[str, ...] = ()
    right: tuple[int, ...] = ()  # columns of numbers


Printed = Iterator[Line | Table]


class Result(Protocol):
    """The result of a command."""

    @property
    def exit_code(self) -> ExitCode: ...
    def rows(self) -> Printed: ...
    def files(self, folder: Path) -> Files: ...


class RefusedError(InputError):
    """Error: the input is valid, but its verdict forbids the work. `exit_code` is the code of this verdict."""

    def __init__(self, source: str, code: Code, message: str, exit_code: ExitCode) -> None:
        self.exit_code = exit_code
        super().__init__(source, [Mistake(code, "", message)])


def code_of(status: str) -> ExitCode:
    """Return the exit code of the status of a problem or a design."""
    return {"certified": ExitCode.OK, "undecided": ExitCode.UNDECIDED}.get(status, ExitCode.FAILED)


def write(files: Files) -> None:
    """Write files together, in place of those of an earlier run."""
    kept = {path: content for path, content in files.items() if content is not None}
    write_together(kept, [path for path in files if path not in kept])


def design_folder(file: ProblemFile, out: Path) -> Path:
    """Create the folder of a problem's design in OUT and return its path."""
    folder = out / folder_name(file.problem.name)
    make_folder(folder)
    return folder
