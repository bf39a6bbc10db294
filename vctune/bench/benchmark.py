"""The parts of every benchmark: a table of frozen rows, its interpretation, a picture, and their files."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import asdict, dataclass
from io import StringIO
from math import isfinite
from pathlib import Path
from typing import Any

from vctune.document.records.printed_json import BenchRecord
from vctune.document.text.output_files import Content, write_together
from vctune.report.figures.benchmark_figures import Panel, benchmark_figure
from vctune.report.page.page import svg

Tick = Callable[[str], None]
"""A function that receives the current stage of the measurement."""
DIGITS = 6


@dataclass(frozen=True, slots=True)
class Measured:
    """The result of a benchmark.

    Attributes
    ----------
    title, reading : title of the benchmark, and how to read its picture
    rows : rows of one frozen dataclass
    facts : the findings, a sentence each
    panels : panels of the picture
    """

    title: str
    reading: str
    rows: list[Any]
    facts: list[str]
    panels: list[Panel]


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


def page(name: str, measured: Measured, command: str, machine: str) -> str:
    """Return a benchmark's page in Markdown.

    Parameters
    ----------
    name : stem of the benchmark's files
    measured : its result
    command : command that makes it again
    machine : machine of the run
    """
    lines = [
        f"# {measured.title}",
        "",
        f"`{command}` on {machine}: [{name}.csv]({name}.csv). Seconds are processor time with one thread.",
        "",
        f"![{measured.title}]({name}.svg)",
        "",
        measured.reading,
        "",
        *(f"- {fact}" for fact in measured.facts),
    ]
    return "\n".join(lines) + "\n"


def record_of(name: str, measured: Measured, machine: str) -> BenchRecord:
    """Return a benchmark as an object; a number that does not exist is null.

    Parameters
    ----------
    name : name of the benchmark
    measured : its result
    machine : machine of the run
    """
    rows = [{key: _existing(value) for key, value in asdict(row).items()} for row in measured.rows]
    return BenchRecord(name=name, title=measured.title, machine=machine, facts=measured.facts, table=rows)


def _existing(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


def write_measured(folder: Path, name: str, measured: Measured, command: str, machine: str) -> None:
    """Write a benchmark's table, picture and page together.

    Parameters
    ----------
    folder : folder for the files
    name : their stem
    measured : the result
    command : command that makes it again
    machine : machine of the run

    Raises
    ------
    InputError
        If a place cannot be written; the older files are then untouched.
    """
    files: dict[Path, Content] = {
        folder / f"{name}.csv": csv_of(measured.rows),
        folder / f"{name}.svg": svg(benchmark_figure(measured.panels), name),
        folder / f"{name}.md": page(name, measured, command, machine),
    }
    write_together(files)
