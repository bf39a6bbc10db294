"""Arguments and options that several commands have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

Added = Callable[[Any], Any]
"""Adds an argument or an option to a command."""

problem_argument: Added = click.argument("problem", type=click.Path(path_type=Path))


def out_option(holds: str = "NAME/") -> Added:
    """Return the option `--out`, with what the folder holds."""
    path, text = click.Path(path_type=Path), f"Folder for OUT/{holds}."
    return click.option("--out", type=path, default=Path("results"), show_default=True, help=text)


def worker_options(command: Any) -> Any:
    """Add the options of every command that has workers."""
    for option in (
        click.option(
            "--executor",
            default="processes",
            show_default=True,
            metavar="processes|serial|dask|dask:ADDRESS",
            help="Who does the work: processes, this process alone, a local Dask cluster, or a running one.",
        ),
        click.option(
            "--jobs", type=click.IntRange(1, 512), help="Number of workers.  [default: the cores that there are]"
        ),
    ):
        command = option(command)
    return command
