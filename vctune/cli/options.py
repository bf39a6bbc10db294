"""Define commands: the options that all of them share, and those that several share."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from math import inf
from pathlib import Path
from typing import Any

import click

from vctune.cli.runner import Run
from vctune.running import time_limit_of_command

Added = Callable[[Any], Any]  # A decorator that adds an argument or an option to a command

PATH: Any = click.Path(path_type=Path)


class Share(click.FloatRange):
    """A number of a range, also as a fraction such as 1/16."""

    name = "number or fraction such as 1/16"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        over, slash, under = str(value).partition("/")
        if slash:
            with suppress(ValueError, ZeroDivisionError):
                value = float(over) / float(under)
        return super().convert(value, param, ctx)


problem_argument: Added = click.argument("problem", type=PATH)


def command(short: str, *formats: str) -> Added:
    """Return a decorator that makes a command, called with a `Run`, of a function, and adds the options of output."""

    def made(function: Callable[..., int]) -> click.Command:
        @wraps(function)
        def called(*, style: str, as_json: bool, quiet: bool, **given: Any) -> int:
            if as_json and style not in ("text", "json"):
                raise click.UsageError(f"--json and --format {style} exclude each other; leave one of them out")
            return function(Run(function.__name__, "json" if as_json else style, quiet), **given)

        choice = click.Choice(["text", "json", *formats])
        options = [
            click.option("--format", "style", type=choice, default="text", show_default=True, help="Format of stdout."),
            click.option("--json", "as_json", is_flag=True, help="Short for --format json."),
            click.option("--quiet", is_flag=True, help="No progress and no text; other formats are printed."),
        ]
        for option in reversed(options):
            called = option(called)
        return click.command(short_help=short)(called)

    return made


def out_option(holds: str = "NAME/", default: str | None = "results") -> Added:
    """Return the option `--out`."""
    text = f"Folder for OUT/{holds}."
    return click.option("--out", type=PATH, default=default, show_default=default is not None, help=text)


def time_limit_option(of: str = "") -> Added:
    """Return the option `--time-limit`; the command receives `time_limit`, inf by default."""
    text = f"Stop{of} after S seconds with the result so far; exit code 3."
    return click.option("--time-limit", type=click.FloatRange(0), default=inf, metavar="S", help=text)


def time_limited(function: Any) -> Any:
    """Add the option `--time-limit` to a command. The command's own code does not handle the time limit."""

    @time_limit_option()
    @wraps(function)
    def within(*args: Any, time_limit: float, **options: Any) -> Any:
        with time_limit_of_command(time_limit):
            return function(*args, **options)

    return within


def jobs_option(of: str, most: int, default: int | None = 1) -> Added:
    """Return the option `--jobs`."""
    shown: Any = "number of cores" if default is None else True
    return click.option(
        "--jobs", type=click.IntRange(1, most), metavar="N", default=default, show_default=shown, help=of
    )
