"""Progress on stderr, for people: only on a terminal, and gone when the work is done."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str], None]


@contextmanager
def progress_on_stderr(title: str, *, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the stage of the work; yield a function that sets the stage."""
    if not (shown and sys.stderr.isatty()):
        yield lambda stage: None
        return
    from rich.console import Console

    with Console(stderr=True).status(title) as status:
        yield lambda stage: status.update(f"{title}: {stage}")
