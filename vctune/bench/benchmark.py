"""Define the common parts of all benchmarks: a table of frozen rows, findings, a picture, and their files."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import asdict, dataclass
from io import StringIO
from math import isfinite
from pathlib import Path
from typing import Any

from vctune.document.text.json import printed
from vctune.document.text.output_files import Content, write_together
from vctune.report.benchmark_figure import Panel, benchmark_figure
from vctune.report.style import svg

Tick = Callable[[str], None]  # Type of a function that receives the name of the current stage of the measurement
DIGITS = 6  # Number of significant digits of a number in the CSV table


@dataclass(frozen=True, slots=True)
class Measured:
    """The result of a benchmark."""

    title: str  # title of the benchmark
    how_to_read: str  # instructions for reading the picture
    rows: list[Any]  # the rows of the table, at least one, all of one frozen dataclass
    facts: list[str]  # the findings, one sentence each
    panels: list[Panel]  # panels of the picture; the picture omits panels without points


def csv_of(rows: list[Any]) -> str:
    """Return the CSV text of rows of a frozen dataclass: a heading, and one line for each row."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(asdict(rows[0]).keys())
    for row in rows:
        writer.writerow(_cell(value) for value in asdict(row).values())
    return stream.getvalue()


def _cell(value: Any) -> str:
    """Return a value as a cell of the CSV table."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}" if isfinite(value) else "inf" if value > 0 else ""
    return str(value)


def page(name: str, measured: Measured, command: str, machine: str) -> str:
    """Return a benchmark's page in Markdown: the picture, how to read it, the findings, and how to repeat the run."""
    lines = [
        f"# {measured.title}",
        "",
        f"`{command}` on {machine}: [{name}.csv]({name}.csv). Seconds are processor time with one thread.",
        "",
        f"![{measured.title}]({name}.svg)",
        "",
        measured.how_to_read,
        "",
        *(f"- {fact}" for fact in measured.facts),
    ]
    return "\n".join(lines) + "\n"


def record_of(name: str, measured: Measured, machine: str) -> dict[str, Any]:
    """Return a benchmark's result as an object for JSON."""
    said: dict[str, Any] = {"title": measured.title, "machine": machine, "facts": measured.facts}
    return printed("bench", name=name, **said, table=measured.rows)


def write_measured(folder: Path, name: str, measured: Measured, command: str, machine: str) -> None:
    """Write a benchmark's table (CSV), picture (SVG) and page (Markdown): all three, or none."""
    files: dict[Path, Content] = {
        folder / f"{name}.csv": csv_of(measured.rows),
        folder / f"{name}.svg": svg(benchmark_figure(measured.panels), name),
        folder / f"{name}.md": page(name, measured, command, machine),
    }
    write_together(files)
