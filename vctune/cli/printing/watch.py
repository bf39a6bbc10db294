"""Run a command again each time a file is saved."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import click

PAUSE = 0.2  # Time between two checks of the file, s


def on_every_save(path: Path, run: Callable[[], object]) -> NoReturn:
    """Run a function now, and again each time a file is saved, until Ctrl-C. Print the mistakes of the file."""
    from vctune import InputError

    while True:
        before = _stamp(path)
        try:
            run()
        except InputError as error:
            click.echo(str(error), err=True)
        click.echo(f"waiting for {path} to be saved; Ctrl-C ends", err=True)
        while _stamp(path) == before:
            time.sleep(PAUSE)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return a value that changes when the file is saved. Return None while the file is absent because an editor has
    moved it."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
