"""Progress on stderr, for people: only on a terminal, and erased when the work is done.

The line says what is being done, what is known by now and, where the work itself tells, how far it is.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vctune.running import told

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
    from rich.markup import escape

    at = ""

    def show(stage: str) -> None:
        nonlocal at
        at = stage
        status.update(escape(f"{title}: {stage}"))

    def show_share(share: str) -> None:
        status.update(escape(f"{title}: {at}; {share}"))

    with Console(stderr=True).status(title) as status, told(show_share):
        yield show


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
