"""Print data to stdout. If the reader closes the pipe, the command does not fail."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from vctune.api.messages import Code, coded, printable

if TYPE_CHECKING:
    from vctune import Problem, ProblemFile


@contextmanager
def reader_may_leave() -> Iterator[None]:
    """Allow printing within this block. If the reader closes the pipe, the function drops the rest of the output."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def emit(text: str) -> None:
    """Print a text to stdout."""
    with reader_may_leave():
        sys.stdout.write(text + "\n")


def warn(code: Code, text: str) -> None:
    """Print a warning on stderr."""
    click.echo(coded(printable(text), code), err=True)


def warn_of_doubts(*problems: Problem | ProblemFile, quiet: bool) -> None:
    """Print probable mistakes in problems to stderr before the work begins, so that no user waits for a useless
    answer."""
    from vctune.api.messages import doubts

    for doubt in () if quiet else dict.fromkeys(doubt for problem in problems for doubt in doubts(problem)):
        warn(doubt.code, doubt.text)


def answer(style: str, quiet: bool, data: Callable[[], Any], people: Callable[[], object]) -> None:
    """Print the result of a command."""
    if style == "json":
        import json

        emit(json.dumps(data(), indent=2, allow_nan=False))
    elif not quiet:
        with reader_may_leave():
            people()
