"""Handle Ctrl-C and SIGTERM.

The module delays them while compiled code runs or files are replaced, notes them where a partial result is useful, and
repeats a KeyboardInterrupt that was lost.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from math import inf
from types import FrameType

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask the process to end."""

RECEIVED: list[int] = []
"""Numbers of the signals for which `raise_interrupt` has raised KeyboardInterrupt, in order.

`raise_lost_interrupt` reads the list, because a KeyboardInterrupt may be lost: compiled code may turn it into an error
of another type, and CPython drops it within a weak reference's callback or a finalizer. The import system has such
callbacks.
"""

RESUMES: list[str] = []
"""Hints for the user who interrupts the process: how to resume the work from the stored results."""


@contextmanager
def resumable(how: str = "running it again resumes") -> Iterator[None]:
    """Make an interrupt within the block tell the user how to resume.

    Parameters
    ----------
    how : hint for the user, such as "running it again resumes"
    """
    RESUMES.append(how)
    yield  # after an interrupt the hint stays, for the code that reports it
    RESUMES.remove(how)


def raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Record a SIGINT or SIGTERM, and raise KeyboardInterrupt.

    Parameters
    ----------
    number : number of the signal
    frame : the interrupted stack frame; not used
    """
    RECEIVED.append(number)
    signal.default_int_handler(number, frame)


def raise_lost_interrupt() -> None:
    """Raise KeyboardInterrupt if an earlier one was lost.

    Long computations call this function often, and so do functions that write files.

    Raises
    ------
    KeyboardInterrupt
        If `raise_interrupt` has raised one in this process.
    """
    if RECEIVED:
        raise KeyboardInterrupt


def report_lost_errors(lost: sys.UnraisableHookArgs) -> None:
    """Report an exception that CPython drops, as `sys.unraisablehook` does, except a KeyboardInterrupt.

    `raise_lost_interrupt` raises the KeyboardInterrupt again.

    Parameters
    ----------
    lost : the exception and where it was dropped
    """
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Record the first SIGINT or SIGTERM within the block, without interrupting it. Yield a function that reports it.

    The block is work whose partial result is useful. A second signal goes to the previous handler, which ends the work
    at once. Python delivers signals to the main thread only, so in another thread the function always returns False.
    """
    with _held(at_most=1) as came:
        yield lambda: bool(came)


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Delay SIGINT and SIGTERM until the block ends, and then deliver them in order to the previous handlers.

    If a previous handler raises an exception, the remaining signals are dropped. In threads other than the main thread
    the block is not protected, because Python delivers signals to the main thread only.

    CasADi checks for signals in the middle of its work and turns a KeyboardInterrupt into failures of other kinds.
    """
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
    """Collect signals during the block and yield the list of their numbers; the code around the block handles them.

    Parameters
    ----------
    at_most : number of signals that the block collects. One signal more restores the previous handlers and goes to them
    """
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
