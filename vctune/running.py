"""The time limit of long work, and the listener that receives its progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from time import perf_counter, process_time

from vctune.interrupt import interrupt_noted, raise_lost_interrupt

SELDOM = 0.1  # Least number of seconds between two messages about the same work

Listener = Callable[[str], None]


class OutOfTimeError(Exception):
    """The time limit has ended the work."""


# _END and _BEGAN are times of `perf_counter`
_END: ContextVar[float] = ContextVar("end", default=inf)
_BEGAN: ContextVar[float | None] = ContextVar("began", default=None)
_MOST_BOXES: ContextVar[float] = ContextVar("most boxes", default=inf)
_STOPPED: ContextVar[Callable[[], bool]] = ContextVar("stopped", default=lambda: False)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)
_REPORTING: ContextVar[bool] = ContextVar("reporting", default=False)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limit the time of the work within the block. If an outer limit ends earlier, the outer limit applies."""
    token = _END.set(min(_END.get(), perf_counter() + seconds))
    try:
        yield
    finally:
        _END.reset(token)


def process_began() -> None:
    """Record when this process began, so that `time_limit_of_command` can count from there."""
    _BEGAN.set(perf_counter() - process_time())


@contextmanager
def time_limit_of_command(seconds: float) -> Iterator[None]:
    """Limit the time of a command since its process began, including the interpreter's start and the imports."""
    began = _BEGAN.get()
    with time_limit(seconds if began is None else seconds - (perf_counter() - began)):
        yield


@contextmanager
def ended_by_interrupt() -> Iterator[None]:
    """Let Ctrl-C end the time of the work within the block, so that what it has found is kept; a second one
    interrupts."""
    with interrupt_noted() as came, ended_by(came):
        yield


@contextmanager
def ended_by(stopped: Callable[[], bool]) -> Iterator[None]:
    """End the time of the work within the block when a function returns true."""
    token = _STOPPED.set(stopped)
    try:
        yield
    finally:
        _STOPPED.reset(token)


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
    return 0.0 if out_of_time() else inf if end == inf else end - perf_counter()


def out_of_time() -> bool:
    """Return whether the time limit has passed."""
    end = _END.get()
    return _STOPPED.get()() or (end < inf and perf_counter() >= end)


def check_time() -> None:
    """End the work if the time limit has passed."""
    raise_lost_interrupt()
    if out_of_time():
        raise OutOfTimeError


@contextmanager
def boxes_at_most(number: float) -> Iterator[None]:
    """Limit the boxes of each proof in the block, the same on every machine; the least of several limits applies."""
    token = _MOST_BOXES.set(min(_MOST_BOXES.get(), number))
    try:
        yield
    finally:
        _MOST_BOXES.reset(token)


def most_boxes() -> float:
    """Return the number of boxes after which a proof stays open; inf if there is no limit."""
    return _MOST_BOXES.get()


@contextmanager
def progress_sent_to(listener: Listener) -> Iterator[None]:
    """Send the progress of the work within the block to a listener."""
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
    """Let messages of `report_progress` reach the listener within the block."""
    token = _REPORTING.set(True)
    try:
        yield
    finally:
        _REPORTING.reset(token)


def report_progress(words: Callable[[], str]) -> None:
    """Send progress to the listener, if the current work runs within `reporting_progress`."""
    listener = _LISTENER.get()
    if listener is not None and _REPORTING.get():
        listener(words())
