"""Progress on stderr, for people: only on a terminal, and gone when the work is done."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str], None]


@contextmanager
def progress_on_stderr(title: str, *, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the stage of the work; yield a function that sets the stage.

    Parameters
    ----------
    title : before the stage
    shown : whether to show it, on a terminal

    Returns
    -------
    context manager
        Of the function, which takes the stage.
    """
    if not (shown and sys.stderr.isatty()):
        yield lambda stage: None
        return
    from rich.console import Console

    with Console(stderr=True).status(title) as status:
        yield lambda stage: status.update(f"{title}: {stage}")


@contextmanager
def bar_on_stderr(title: str, total: int, *, shown: bool) -> Iterator[Callable[[], None]]:
    """Show a bar with the rate and the time left; yield a function that counts one more done.

    Parameters
    ----------
    title : before the bar
    total : how many there are to do
    shown : whether to show it, on a terminal

    Returns
    -------
    context manager
        Of the function, which takes nothing.
    """
    if not (shown and sys.stderr.isatty()):
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=total, rate="")

        def advance() -> None:
            progress.update(task, advance=1, rate=f"{progress.tasks[0].speed or 0:.1f}/s")

        yield advance
