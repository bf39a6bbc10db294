"""Ctrl-C while compiled code runs that would swallow or garble it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Let SIGINT wait until the block is left, then deliver it to whoever handled it before.

    CasADi checks for signals in the middle of its work and turns KeyboardInterrupt into failures of other names.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending = False

    def remember(_signal: int, _frame: FrameType | None) -> None:
        nonlocal pending
        pending = True

    previous = signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
        if pending:
            signal.raise_signal(signal.SIGINT)


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Let SIGINT only be noted within the block; yield a function that tells whether there was one.

    For work that is worth something wherever it stops.
    """
    noted = False

    def remember(_signal: int, _frame: FrameType | None) -> None:
        nonlocal noted
        noted = True

    previous = signal.signal(signal.SIGINT, remember)
    try:
        yield lambda: noted
    finally:
        signal.signal(signal.SIGINT, previous)
