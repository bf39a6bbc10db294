"""Rows as CSV, and the page of all benchmarks: one section each, made anew when that one is run."""

from __future__ import annotations

import csv
import re
from dataclasses import asdict
from io import StringIO
from math import isfinite
from pathlib import Path
from typing import Any

from vctune.bench.benchmark import Measured
from vctune.document.files import Content, write_together
from vctune.report.benchmarks import benchmark_figure
from vctune.report.page import svg

PAGE = "index.md"
NAMES = ("sampling", "solvers", "stress", "scaling", "scene")
"""Benchmarks, in the order of the page."""
HEAD = (
    "# Benchmarks\n\nMade by `vctune bench`; each section by the command beside it. "
    "Seconds are processor time, medians of repeats, with one thread.\n"
)
DIGITS = 6


def csv_of(rows: list[Any]) -> str:
    """Return rows of a frozen dataclass as CSV; numbers that do not exist are empty."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(asdict(rows[0]).keys())
    for row in rows:
        writer.writerow(_cell(value) for value in asdict(row).values())
    return stream.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}" if isfinite(value) else "inf" if value > 0 else ""
    return str(value)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def section(name: str, measured: Measured, command: str, machine: str) -> str:
    """Return a benchmark's section of the page."""
    tables = ", ".join(f"[{table}.csv]({table}.csv)" for table in measured.tables)
    lines = [
        f"<!-- {name} -->",
        f"## {measured.title}",
        "",
        f"`{command}` on {machine}: {tables}",
        "",
        f"![{measured.title}]({name}.svg)",
        "",
        measured.reading,
        "",
        *(f"- {fact}" for fact in measured.facts),
        "",
        f"<!-- /{name} -->",
    ]
    return "\n".join(lines) + "\n"


def command_of(page: str, name: str) -> str:
    """Return the command that made a benchmark's section of the page."""
    found = re.search(rf"<!-- {name} -->\n.*?\n`(.*?)`", page, re.DOTALL)
    assert found is not None, name
    return found[1]


def with_section(page: str, name: str, text: str) -> str:
    """Return the page with the section of a benchmark made anew, sections in the order of `NAMES`."""
    known = {found[1]: found[0] for found in re.finditer(r"<!-- (\w+) -->\n.*?<!-- /\1 -->\n", page, re.DOTALL)} | {
        name: text
    }
    return "\n".join([HEAD, *(known[each] for each in NAMES if each in known)])


def write_measured(folder: Path, name: str, measured: Measured, command: str, machine: str) -> None:
    """Write a benchmark's tables and picture, and its section of the page, all of them together.

    Raises
    ------
    InputError
        If a place cannot be written; the older files are then untouched.
    """
    path = folder / PAGE
    page = path.read_text() if path.exists() else ""
    figure = benchmark_figure(measured.panels)
    files: dict[Path, Content] = {folder / f"{table}.csv": csv_of(rows) for table, rows in measured.tables.items()}
    files[folder / f"{name}.svg"] = svg(figure, name)
    files[path] = with_section(page, name, section(name, measured, command, machine))
    write_together(files)
