"""Long work: when it has to end, and who receives its progress.

Both are context, not arguments: between the command that sets a limit and the loop that ends lie ten calls, most of
which have nothing to do with time. Without a limit no result depends on the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from time import perf_counter, process_time
from typing import TypeVar

SELDOM = 0.1
"""Seconds between two messages about the same work. Nobody reads faster, and half as many seconds would cost nothing
yet."""

Listener = Callable[[str], None]
Item = TypeVar("Item")


class OutOfTimeError(Exception):
    """The time limit has ended the work. Each stage that has a result by then catches it and returns that result."""


_END: ContextVar[float] = ContextVar("end", default=inf)
_BEGAN: ContextVar[float | None] = ContextVar("began", default=None)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)
_ALOUD: ContextVar[bool] = ContextVar("aloud", default=False)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Let work within the block end after so many seconds, or earlier if an outer limit ends it.

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
    """Note when this process began, for `time_limit_of_command`; the time since then is known."""
    _BEGAN.set(perf_counter() - process_time())


@contextmanager
def time_limit_of_command(seconds: float) -> Iterator[None]:
    """Let a command end after so many seconds of its process, including the start of the interpreter and the imports.

    Parameters
    ----------
    seconds : seconds from the beginning of the process, if it is known; inf for no limit
    """
    began = _BEGAN.get()
    with time_limit(seconds if began is None else seconds - (perf_counter() - began)):
        yield


@contextmanager
def unlimited() -> Iterator[None]:
    """Let work within the block take its time: the little that is needed to report the result."""
    token = _END.set(inf)
    try:
        yield
    finally:
        _END.reset(token)


def seconds_left() -> float:
    """Return the seconds until the limit, 0 after it, inf without one."""
    end = _END.get()
    return inf if end == inf else max(end - perf_counter(), 0.0)


def out_of_time() -> bool:
    """Return whether the time limit has passed."""
    end = _END.get()
    return end < inf and perf_counter() >= end


def in_time(items: Iterable[Item]) -> Iterator[Item]:
    """Yield the first item, and the others as long as there is time.

    Parameters
    ----------
    items : work items; the first is always done, the others only in time
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
        If it has.
    """
    if out_of_time():
        raise OutOfTimeError


@contextmanager
def told(listener: Listener) -> Iterator[None]:
    """Let work within the block report its progress.

    Parameters
    ----------
    listener : function that receives words, every `SELDOM` seconds at most
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
def aloud() -> Iterator[None]:
    """Let `tell` be heard within the block; proofs within a search are not reported."""
    token = _ALOUD.set(True)
    try:
        yield
    finally:
        _ALOUD.reset(token)


def tell(words: Callable[[], str]) -> None:
    """Report progress to the listener, if it listens `aloud`.

    Parameters
    ----------
    words : function that makes the text, if somebody listens
    """
    listener = _LISTENER.get()
    if listener is not None and _ALOUD.get():
        listener(words())
