"""Define the arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from math import inf
from pathlib import Path
from typing import Any

import click

from vctune.running import time_limit_of_command

Added = Callable[[Any], Any]  # A decorator that adds an argument or an option to a command
SHORT = "vctune.json"  # Key of the context's `meta` under which `_short` records whether the user gave --json

problem_argument: Added = click.argument("problem", type=click.Path(path_type=Path))


def out_option(holds: str = "NAME/", default: str | None = "results") -> Added:
    """Return the option `--out`."""
    path, text = click.Path(path_type=Path), f"Folder for OUT/{holds}." if holds else "Output folder."
    return click.option("--out", type=path, default=default, show_default=default is not None, help=text)


def output_options(*more: str) -> Added:
    """Return a decorator that adds the options `--format`, `--json` and `--quiet`; the command receives `style` and
    `quiet`."""
    options = (
        click.option(
            "--format",
            "style",
            type=click.Choice(["text", "json", *more]),
            default="text",
            show_default=True,
            callback=_style,
            help="Output format on stdout.",
        ),
        click.option(
            "--json", is_flag=True, is_eager=True, expose_value=False, callback=_short, help="Short for --format json."
        ),
        click.option(
            "--quiet",
            is_flag=True,
            help="Print no progress and no text. Any other --format is still printed.",
        ),
    )

    def add(command: Any) -> Any:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _short(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    context.meta[SHORT] = value


def _style(context: click.Context, parameter: click.Parameter, value: str) -> str:
    """Return the output format; --json selects JSON and excludes every other format."""
    if not context.meta.get(SHORT):
        return value
    if value not in ("text", "json"):
        raise click.UsageError(f"--json and --format {value} exclude each other; leave one of them out")
    return "json"


def time_limit_option(of: str = "") -> Added:
    """Return a decorator that adds the option `--time-limit`; the command receives `time_limit`, inf by default."""
    text = f"Stop{of} after S seconds, keep the result so far, and exit with code 3."
    return click.option(
        "--time-limit",
        type=click.FloatRange(0),
        default=inf,
        show_default="none",
        metavar="S",
        help=text,
    )


def time_limited(command: Any) -> Any:
    """Add the option `--time-limit` to a command. The command's own code does not handle the time limit."""

    @time_limit_option()
    @wraps(command)
    def within(*args: Any, time_limit: float, **options: Any) -> Any:
        with time_limit_of_command(time_limit):
            return command(*args, **options)

    return within


def worker_options(command: Any) -> Any:
    """Add the options `--executor` and `--jobs`; the command receives `executor`, and `jobs`, which is None by
    default."""
    for option in (
        click.option(
            "--executor",
            default="processes",
            show_default=True,
            metavar="processes|serial|dask|dask:ADDRESS",
            help="Workers that solve the points: processes of this machine, only this process, a new Dask cluster on "
            "this machine, or a running Dask cluster.",
        ),
        click.option("--jobs", type=click.IntRange(1, 512), help="Number of workers.  [default: number of cores]"),
    ):
        command = option(command)
    return command
