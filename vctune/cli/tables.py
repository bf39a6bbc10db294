"""Print rows: lines of styled text and tables, which fit narrow terminals too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from vctune.api.result import Printed, Table

NARROW = 80  # Width, characters, below which the headings of groups have lines of their own on a terminal
WIDE = 120  # Width of a table without heads if stdout is not a terminal: its last column wraps
ENDLESS = 1000  # Width of tables that must not be wrapped


def print_rows(rows: Printed, folder: Path | None, steps: Sequence[str], *, always: bool) -> None:
    """Print either all rows or nothing, the folder of the files and, on a terminal or `always`, the next steps."""
    console = Console(highlight=False)
    terminal, width = console.is_terminal, console.width
    with console.capture() as page:
        for row in rows:
            if isinstance(row, Table):
                console.width = width if terminal else ENDLESS if row.heads else max(width, WIDE)
                for grid in _grids(row, console.width):
                    console.print(grid)
                console.width = width
            else:
                console.print(Text.assemble(*row), soft_wrap=not terminal)
        if folder is not None:
            console.print(Text.assemble("written to ", _linked(folder, console)), soft_wrap=True)
        if steps and (always or terminal):
            between = "\n      " if terminal else "; "
            shown = [part for step in steps for part in (between, *_with_link(step, console))][1:]
            console.print(Text.assemble("next: ", *shown), soft_wrap=True)
    console.file.write("".join(f"{line.rstrip()}\n" for line in page.get().splitlines()))


def _linked(path: Path, console: Console) -> str | tuple[str, str]:
    """Return a path, as a link (OSC 8) if the output is a terminal."""
    return (str(path), f"link {path.resolve().as_uri()}") if console.file.isatty() else str(path)


def _with_link(step: str, console: Console) -> list[str | tuple[str, str]]:
    """Return a next step. The path in a step "open PATH" becomes a link."""
    verb, _, rest = step.partition(" ")
    return [f"{verb} ", _linked(Path(rest), console)] if verb == "open" else [step]


def _grids(table: Table, width: int) -> Iterator[Grid]:
    """Return a table for a width; several tables, a row as a column of each, if it has heads and does not fit."""
    if not table.rows:
        return
    needed = (
        sum(2 + max(map(len, column)) for column in zip(*table.rows, table.heads, strict=True)) if table.heads else 0
    )
    if needed > width:
        yield from _stacked(table)
        return
    narrow = not table.heads and width < NARROW
    rows = list(table.rows) if table.heads else list(_grouped(table, narrow=narrow))
    heads = table.heads or ("",) * len(rows[0])
    grid = Grid(show_header=bool(table.heads), box=None, pad_edge=False)
    for number, head in enumerate(heads):
        to_right, wraps = number + narrow in table.right, not table.heads and number == len(heads) - 1
        grid.add_column(
            head,
            style="" if table.heads else "bold" if to_right else "dim" if number == 0 and not narrow else "",
            header_style="dim",
            justify="right" if to_right else "left",
            no_wrap=not wraps,
            min_width=None if wraps else max(len(row[number]) for row in rows),
            overflow="fold",
        )
    for row in rows:
        grid.add_row(*map(Text, row))
    yield grid


def _grouped(table: Table, *, narrow: bool) -> Iterator[tuple[str, ...]]:
    """Yield the rows with the heading of each group in its first row or, on a narrow terminal, in a row of its own."""
    group = None
    for first, *cells in table.rows:
        if narrow and first and first != group:
            yield first, *("" for _ in cells[1:])
        label = f"  {cells[0]}" if first else cells[0]
        yield (label, *cells[1:]) if narrow else (first if first != group else "", *cells)
        group = first


def _stacked(table: Table) -> Iterator[Grid]:
    """Yield a table for each text of the first column, with a column for each of its rows."""
    for name in dict.fromkeys(row[0] for row in table.rows):
        rows = [row for row in table.rows if row[0] == name]
        grid = Grid(box=None, pad_edge=False)
        grid.add_column(Text(name), header_style="bold", min_width=13, overflow="fold")
        for row in rows:
            grid.add_column(Text(row[1]), header_style="dim", overflow="fold")
        for number, head in enumerate(table.heads[2:], 2):
            if any(row[number] for row in rows):
                grid.add_row(f"  {head}", *(Text(row[number]) for row in rows))
        yield grid
