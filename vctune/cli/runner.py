"""Run commands: warn, show progress, print a result as text or JSON, and draw the report.

Data goes to stdout, messages to stderr. If the reader closes the pipe, the command does not fail.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from vctune.running import OutOfTimeError, check_time, progress_sent_to, time_limit

if TYPE_CHECKING:
    from vctune import Problem, ProblemFile
    from vctune.api.result import Printed, Result
    from vctune.document.text.errors import Code

Progress = Callable[[str], None]  # Type of a function that receives the current stage
BETWEEN = 10.0  # Least time between two lines of progress that are not on a terminal, s
PAUSE = 0.2  # Time between two checks of a watched file, s


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a command, with the options that all commands share."""

    command: str
    style: str
    quiet: bool

    def warn(self, code: Code, text: str) -> None:
        """Print a warning on stderr."""
        from vctune.document.text.errors import coded, printable

        click.echo(coded(printable(text), code), err=True)

    def doubt(self, *problems: Problem | ProblemFile) -> None:
        """Print probable mistakes in problems before the work begins, so that nobody waits for a useless answer."""
        if self.quiet:
            return
        from vctune.document.doubts import doubts, file_doubts
        from vctune.document.reading import ProblemFile

        found = (file_doubts(each) if isinstance(each, ProblemFile) else doubts(each) for each in problems)
        for doubt in dict.fromkeys(doubt for each in found for doubt in each):
            self.warn(doubt.code, doubt.text)

    @contextmanager
    def progress(self, *names: str) -> Iterator[Progress]:
        """Show a spinner on a terminal with the stage of the work, elsewhere now and then a line, and yield a function
        that sets the stage."""
        if self.quiet:
            yield lambda stage: None
            return
        if not sys.stderr.isatty():
            tell, part = _now_and_then(" ".join(["vctune", self.command, *names])), ""

            def tell_part(stage: str) -> None:
                nonlocal part
                part = f"{stage}; "
                tell(stage)

            with progress_sent_to(lambda share: tell(f"{part}{share}")):
                yield tell_part
            return
        from rich.console import Console
        from rich.text import Text

        title, at = " ".join(["vctune", self.command, *names]), ""

        def show(stage: str) -> None:
            nonlocal at
            at = stage
            status.update(Text(f"{title}: {stage}"))

        with (
            Console(stderr=True).status(title) as status,
            progress_sent_to(lambda share: status.update(Text(f"{title}: {at}; {share}"))),
        ):
            yield show

    @contextmanager
    def bar(self, name: str, total: int) -> Iterator[Progress]:
        """Show a bar on a terminal with the rate and the remaining time; yield a function that adds a finished item."""
        if self.quiet:
            yield lambda known: None
            return
        if not sys.stderr.isatty():
            tell, done = _now_and_then(f"vctune {self.command} {name}"), count(1)
            yield lambda known: tell(f"{next(done)} of {total}; {known}")
            return
        from rich.console import Console
        from rich.markup import escape
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        fields = [TextColumn(f"{{task.fields[{name}]}}") for name in ("rate", "known")]
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), fields[0])
        with Progress(
            *columns, TimeRemainingColumn(), fields[1], console=Console(stderr=True), transient=True
        ) as progress:
            task = progress.add_task(f"vctune {self.command} {name}", total=total, rate="", known="")

            def advance(known: str) -> None:
                progress.update(task, advance=1, rate=f"{progress.tasks[0].speed or 0:.1f}/s", known=escape(known))

            yield advance

    def report(self, design: Any, folder: Path, progress: Progress, known: str = "") -> bool:
        """Draw the report of a design into its folder and return True; warn if the time limit prevents it."""
        from vctune.api.solving import write_report

        progress(f"drawing the report{known}")
        try:
            check_time()
            write_report(design, folder)
        except OutOfTimeError:
            path = design if isinstance(design, Path) else folder / "design.json"
            self.warn("time-limit", f"there was no time to draw the report; `vctune report {path}` draws it")
            return False
        return True

    def show(
        self, result: Result, data: Callable[[], Any], folder: Path, steps: Sequence[str] = (), *, always: bool = False
    ) -> int:
        """Print an object as JSON, or else a result, the folder of its files and, on a terminal or `always`, the next
        steps. Return the exit code of the result."""
        self.say(data, result.rows, folder, steps, always=always)
        return result.exit_code

    def say(
        self,
        data: Callable[[], Any],
        rows: Callable[[], Printed],
        folder: Path | None = None,
        steps: Sequence[str] = (),
        *,
        always: bool = False,
    ) -> None:
        """Print an object as JSON or rows as text."""
        if self.style == "json":
            emit(json.dumps(data(), indent=2, allow_nan=False))
        elif not self.quiet:
            from vctune.cli.tables import print_rows

            with reader_may_leave():
                print_rows(rows(), folder, steps, always=always)


def _now_and_then(title: str) -> Progress:
    """Return a function that prints the stage of long work on stderr, at most one line in `BETWEEN` seconds."""
    last = time.monotonic()

    def tell(stage: str) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= BETWEEN:
            last = now
            click.echo(f"{title}: {stage}", err=True)

    return tell


@contextmanager
def reader_may_leave() -> Iterator[None]:
    """Allow printing within this block. If the reader closes the pipe, the function drops the rest of the output."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def emit(text: str) -> None:
    """Print a text to stdout."""
    with reader_may_leave():
        sys.stdout.write(text + "\n")


def on_every_save(path: Path, run: Callable[[], object], seconds: float) -> NoReturn:
    """Run a function now, and again each time a file is saved, each time within a limit. Print the file's mistakes."""
    from vctune import InputError

    while True:
        before = _stamp(path)
        try:
            with time_limit(seconds):
                run()
        except InputError as error:
            click.echo(str(error), err=True)
        click.echo(f"waiting for {path} to be saved; Ctrl-C ends", err=True)
        while _stamp(path) == before:
            time.sleep(PAUSE)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return a value that changes when the file is saved; None while an editor has moved the file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def worst(codes: Sequence[int]) -> int:
    """Return the worst of several exit codes: certified, undecided, failed, bad input."""
    return max(codes, key=[0, 3, 1, 2].index)
