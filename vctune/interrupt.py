"""Handle Ctrl-C and SIGTERM."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from math import inf
from types import FrameType

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)  # Signals that ask the process to end

RECEIVED: list[int] = []  # Numbers of the signals for which `raise_interrupt` has raised KeyboardInterrupt, in order

RESUMES: list[str] = []  # Hints for the user who interrupts the process: how to resume the work from the stored results


@contextmanager
def resumable(how: str = "running it again resumes") -> Iterator[None]:
    """Make an interrupt within the block tell the user how to resume."""
    RESUMES.append(how)
    yield  # after an interrupt the hint stays, for the code that reports it
    RESUMES.remove(how)


def raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Record a SIGINT or SIGTERM, and raise KeyboardInterrupt."""
    RECEIVED.append(number)
    signal.default_int_handler(number, frame)


def raise_lost_interrupt() -> None:
    """Raise KeyboardInterrupt if an earlier one was lost."""
    if RECEIVED:
        raise KeyboardInterrupt


def report_lost_errors(lost: sys.UnraisableHookArgs) -> None:
    """Report an exception that CPython drops, as `sys.unraisablehook` does, except a KeyboardInterrupt."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Record the first SIGINT or SIGTERM within the block, without interrupting it. Yield a function that reports
    it."""
    with _held(at_most=1) as came:
        yield lambda: bool(came)


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Delay SIGINT and SIGTERM until the block ends, and then deliver them in order to the previous handlers."""
    came: list[int] = []

    def deliver() -> None:
        for number in came:
            signal.raise_signal(number)

    with ExitStack() as stack:
        stack.callback(deliver)  # runs last, when the previous handlers are back
        came = stack.enter_context(_held())
        yield


@contextmanager
def _held(at_most: float = inf) -> Iterator[list[int]]:
    """Collect signals during the block and yield the list of their numbers; the code around the block handles them."""
    came: list[int] = []

    with ExitStack() as stack:

        def remember(number: int, _frame: FrameType | None) -> None:
            came.append(number)
            if len(came) > at_most:
                stack.close()
                signal.raise_signal(number)

        if threading.current_thread() is threading.main_thread():
            for number in INTERRUPTS:
                before = signal.signal(number, remember)
                # None stands for a handler that was not installed from Python; Python cannot restore it
                stack.callback(signal.signal, number, signal.SIG_DFL if before is None else before)
        yield came
