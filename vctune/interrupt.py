"""Ctrl-C while compiled code runs that would swallow or garble it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Let SIGINT only be noted within the block; yield a function that tells whether there was one.

    For work that is worth something wherever it stops. Only the main thread is ever interrupted.
    """
    noted = False

    def remember(_signal: int, _frame: FrameType | None) -> None:
        nonlocal noted
        noted = True

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    previous = signal.signal(signal.SIGINT, remember)
    try:
        yield lambda: noted
    finally:
        signal.signal(signal.SIGINT, previous)


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Let SIGINT wait until the block is left, then deliver it to whoever handled it before.

    CasADi checks for signals in the middle of its work and turns KeyboardInterrupt into failures of other names.
    """

    def deliver() -> None:
        if interrupted():
            signal.raise_signal(signal.SIGINT)

    with ExitStack() as stack:
        stack.callback(deliver)  # last of all, when the handler from before is back
        interrupted = stack.enter_context(interrupt_noted())
        yield
