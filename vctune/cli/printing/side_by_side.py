"""Print runs of experiments and pairs of designs side by side, on wide and on narrow terminals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vctune.api.design_files import REPORT, text
from vctune.api.messages import printable
from vctune.cli.printing.design_table import WIDE, page

if TYPE_CHECKING:
    from rich.console import JustifyMethod

    from vctune.document.records.comparison import ComparisonRecord
    from vctune.document.records.simulation_json import SimulationRecord

LEAST = {"": 6, "A": 8, "B": 8}  # Least width of the columns under each heading on a narrow terminal
WIDEST = 1000  # Width, in characters, of tables that must not be wrapped


def print_simulation(record: SimulationRecord, folder: Path) -> None:
    """Print the measures of a simulation and the folder of its files; on a terminal, a next step follows."""
    from vctune.api.experiments import HEADINGS, measured_rows

    narrow = Console().is_terminal and Console().width < WIDE
    with page(0 if narrow else WIDE, folder, _after_simulation(folder) if Console().is_terminal else []) as console:
        console.print(f"[bold]{escape(printable(record.problem.name))}[/bold]")
        rows = [tuple(escape(printable(cell)) for cell in row) for row in measured_rows(record)]
        for table in _stacked(rows, HEADINGS) if narrow else [_wide(rows, HEADINGS)]:
            console.print(table)


def _wide(rows: list[tuple[str, ...]], headings: Sequence[str]) -> Table:
    """Return the runs as one table with a line for each run, for wide terminals and other outputs."""
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading, no_wrap=True, header_style="dim")
    for row in rows:
        table.add_row(*row)
    return table


def _stacked(rows: list[tuple[str, ...]], headings: Sequence[str]) -> Iterator[Table]:
    """Yield a table for each experiment, with a column for each controller, for narrow terminals."""
    for name in dict.fromkeys(row[0] for row in rows):
        runs = [row for row in rows if row[0] == name]
        table = Table(box=None, pad_edge=False)
        table.add_column(name, header_style="bold", min_width=13, overflow="fold")
        for run in runs:
            table.add_column(run[1], header_style="dim", overflow="fold")
        for number, heading in enumerate(headings[2:], 2):
            if any(run[number] for run in runs):
                table.add_row(f"  {heading}", *(run[number] for run in runs))
        yield table


def _after_simulation(folder: Path) -> list[str]:
    """Return the next step: open the report or the figure; empty if neither exists."""
    shown = next((name for name in (REPORT, "simulation.svg") if (folder / name).exists()), "")
    return [f"open {folder / shown}"] if shown else []


def print_comparison(comparison: ComparisonRecord) -> None:
    """Print two designs side by side: their files and status, the keys in which the problems differ, then both results.
    Reasons why there is no design follow, and on a terminal the next step."""
    terminal = Console()
    narrow = terminal.is_terminal and terminal.width < WIDE
    console = Console(highlight=False, width=terminal.width if narrow else WIDEST)
    table = Table(box=None, pad_edge=False, show_header=True)
    for heading in ("", "A", "B", "") if narrow else ("", "", "A", "B", ""):
        to: JustifyMethod = "right" if heading in ("A", "B") else "left"
        table.add_column(
            heading, no_wrap=not narrow, justify=to, overflow="fold", min_width=LEAST[heading] if narrow else None
        )
    group = ""
    for row in _compared(comparison):
        if narrow:
            if row[0] != group:
                table.add_row(f"[dim]{row[0]}[/dim]", "", "", "")
            table.add_row(f"  {row[1]}" if row[0] else row[1], *row[2:])
        else:
            table.add_row(f"[dim]{row[0]}[/dim]" if row[0] != group else "", *row[1:])
        group = row[0]
    with console.capture() as page:
        console.print(table)
    console.file.write("".join(f"{line.rstrip()}\n" for line in page.get().splitlines()))
    sides = {"A": comparison.a, "B": comparison.b}
    for name, side in sides.items():
        if side.reason:
            console.print(escape(f"{name}: {printable(side.reason)}"), soft_wrap=not narrow)
    if terminal.is_terminal:
        console.print(f"next: {_after_comparison(comparison)}", soft_wrap=True)


def _compared(comparison: ComparisonRecord) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield group, label, both values and unit of each row, as markup."""
    sides = (comparison.a, comparison.b)
    for label, values in (
        ("file", [side.source for side in sides]),
        ("problem", [side.name for side in sides]),
        ("status", [f"{side.status}, idle" if side.idle else side.status for side in sides]),
    ):
        yield "", label, escape(printable(values[0])), escape(printable(values[1])), ""
    for differs in comparison.problem:
        yield "differs", differs.key, _cell(differs.a), _cell(differs.b), ""
    for value in comparison.design:
        a, b = (_cell(each, value.digits) for each in (value.a, value.b))
        yield value.group, escape(value.label), a, b, value.unit


def _after_comparison(comparison: ComparisonRecord) -> str:
    """Return the next step for the certified design with the least error, or for both designs if neither is
    certified."""
    errors = next(((each.a, each.b) for each in comparison.design if each.label == "error"), (None, None))
    certified = [
        (error, side.source)
        for error, side in zip(errors, (comparison.a, comparison.b), strict=True)
        if side.status == "certified" and isinstance(error, float)
    ]
    if not certified:
        return "neither is certified; vctune solve reports repairs"
    source = min(certified)[1]
    return f"vctune {'export' if source.endswith('.json') else 'solve'} {quote(source)}"


def _cell(value: Any, digits: int = 8) -> str:
    """Return a value as markup; "-" without a value. A list of two numbers is a range."""
    if isinstance(value, list) and len(value) != 2:
        return escape(printable(str(value)))
    return "-" if value is None else escape(printable(text(value, digits)))
