"""Show progress on stderr, only on a terminal, and erase it when the work is done."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vctune.running import progress_sent_to

Progress = Callable[[str], None]  # Type of a function that receives the current stage


@contextmanager
def progress_on_stderr(title: str, *, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the stage of the work, and yield a function that sets the stage."""
    if not (shown and sys.stderr.isatty()):
        yield lambda stage: None
        return
    from rich.console import Console
    from rich.markup import escape

    at = ""

    def show(stage: str) -> None:
        nonlocal at
        at = stage
        status.update(escape(f"{title}: {stage}"))

    def show_share(share: str) -> None:
        status.update(escape(f"{title}: {at}; {share}"))

    with Console(stderr=True).status(title) as status, progress_sent_to(show_share):
        yield show


@contextmanager
def bar_on_stderr(title: str, total: int, *, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show a bar with the rate, the remaining time and the result so far. Yield a function that adds a finished
    item."""
    if not (shown and sys.stderr.isatty()):
        yield lambda known: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[known]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=total, rate="", known="")

        def advance(known: str) -> None:
            progress.update(task, advance=1, rate=f"{progress.tasks[0].speed or 0:.1f}/s", known=escape(known))

        yield advance
