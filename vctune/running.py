"""The time limit of long work, and the listener that receives its progress.

Both are context variables, not arguments. About ten calls lie between the command that sets a limit and the loop that
obeys it, and most of them have nothing to do with time. Without a limit no result depends on the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from time import perf_counter, process_time
from typing import TypeVar

from vctune.interrupt import raise_lost_interrupt

SELDOM = 0.1
"""Least number of seconds between two messages about the same work. Nobody reads faster."""

Listener = Callable[[str], None]
Item = TypeVar("Item")


class OutOfTimeError(Exception):
    """The time limit has ended the work.

    Each stage that has a partial result catches this error and returns the result.
    """


# _END and _BEGAN are times of `perf_counter`
_END: ContextVar[float] = ContextVar("end", default=inf)
_BEGAN: ContextVar[float | None] = ContextVar("began", default=None)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)
_REPORTING: ContextVar[bool] = ContextVar("reporting", default=False)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limit the time of the work within the block. If an outer limit ends earlier, the outer limit applies.

    Parameters
    ----------
    seconds : seconds from now on; inf for no limit
    """
    token = _END.set(min(_END.get(), perf_counter() + seconds))
    try:
        yield
    finally:
        _END.reset(token)


def process_began() -> None:
    """Record when this process began, so that `time_limit_of_command` can count from there.

    The beginning is the present time minus the processor time so far. Waiting before this call therefore does not
    count.
    """
    _BEGAN.set(perf_counter() - process_time())


@contextmanager
def time_limit_of_command(seconds: float) -> Iterator[None]:
    """Limit the time of a command since its process began, including the interpreter's start and the imports.

    Parameters
    ----------
    seconds : seconds since the process began, or from now on if its beginning is unknown; inf for no limit
    """
    began = _BEGAN.get()
    with time_limit(seconds if began is None else seconds - (perf_counter() - began)):
        yield


@contextmanager
def unlimited() -> Iterator[None]:
    """Suspend the time limit within the block, for the short work that reports the result."""
    token = _END.set(inf)
    try:
        yield
    finally:
        _END.reset(token)


def seconds_left() -> float:
    """Return the seconds until the limit: 0 after the limit, inf if there is no limit."""
    end = _END.get()
    return inf if end == inf else max(end - perf_counter(), 0.0)


def out_of_time() -> bool:
    """Return whether the time limit has passed."""
    end = _END.get()
    return end < inf and perf_counter() >= end


def in_time(items: Iterable[Item]) -> Iterator[Item]:
    """Yield the first item, and further items until the time limit.

    Parameters
    ----------
    items : work items; the first is always processed
    """
    for number, item in enumerate(items):
        if number and out_of_time():
            return
        yield item


def check_time() -> None:
    """End the work if the time limit has passed.

    Raises
    ------
    OutOfTimeError
        If the time limit has passed.
    KeyboardInterrupt
        If an interrupt was lost.
    """
    raise_lost_interrupt()
    if out_of_time():
        raise OutOfTimeError


@contextmanager
def progress_sent_to(listener: Listener) -> Iterator[None]:
    """Send the progress of the work within the block to a listener.

    Parameters
    ----------
    listener : function that receives a text, at most once every `SELDOM` seconds
    """
    last = -inf

    def seldom(text: str) -> None:
        nonlocal last
        if perf_counter() - last >= SELDOM:
            last = perf_counter()
            listener(text)

    token = _LISTENER.set(seldom)
    try:
        yield
    finally:
        _LISTENER.reset(token)


@contextmanager
def reporting_progress() -> Iterator[None]:
    """Let messages of `report_progress` reach the listener within the block.

    A search runs its inner proofs outside such a block, so that they report nothing.
    """
    token = _REPORTING.set(True)
    try:
        yield
    finally:
        _REPORTING.reset(token)


def report_progress(words: Callable[[], str]) -> None:
    """Send progress to the listener, if the current work runs within `reporting_progress`.

    Parameters
    ----------
    words : function that makes the text; called only if there is a listener and the work runs within
        `reporting_progress`
    """
    listener = _LISTENER.get()
    if listener is not None and _REPORTING.get():
        listener(words())
