"""Ctrl-C and SIGTERM while compiled code runs that would swallow or garble them, or while files change places."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from math import inf
from types import FrameType

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)

RECEIVED: list[int] = []
"""Signals that have interrupted this process: compiled code may turn KeyboardInterrupt into errors of other names."""


RESUMES: list[str] = []
"""What to tell somebody who has interrupted the process, where its work goes on from what is kept."""


@contextmanager
def resumable(how: str = "running it again resumes") -> Iterator[None]:
    """Have an interrupt within the block say how to go on.

    Parameters
    ----------
    how : what continues the work
    """
    RESUMES.append(how)
    yield  # an interrupt leaves it there for who reports it
    RESUMES.remove(how)


def raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Handle SIGINT or SIGTERM by KeyboardInterrupt, and remember it.

    Parameters
    ----------
    number : number of the signal
    frame : that it came in; of no meaning
    """
    RECEIVED.append(number)
    signal.default_int_handler(number, frame)


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Only note the first SIGINT or SIGTERM within the block; yield a function that returns whether it came.

    This is for work whose partial result is useful. The second is for whoever handled it before: it ends the work at
    once. Only the main thread is ever interrupted.
    """
    with _held(at_most=1) as came:
        yield lambda: bool(came)


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the block is left, then deliver the first to whoever handled it before.

    CasADi checks for signals in the middle of its work and turns KeyboardInterrupt into failures of other names.
    """
    came: list[int] = []

    def deliver() -> None:
        if came:
            signal.raise_signal(came[0])

    with ExitStack() as stack:
        stack.callback(deliver)  # last of all, when the handlers from before are back
        came = stack.enter_context(_held())
        yield


@contextmanager
def _held(at_most: float = inf) -> Iterator[list[int]]:
    """Yield the list of the received signals, which only the code around the block handles."""
    came: list[int] = []

    with ExitStack() as stack:

        def remember(number: int, _frame: FrameType | None) -> None:
            came.append(number)
            if len(came) > at_most:
                stack.close()
                signal.raise_signal(number)

        if threading.current_thread() is threading.main_thread():
            for number in INTERRUPTS:
                stack.callback(signal.signal, number, signal.signal(number, remember))
        yield came
