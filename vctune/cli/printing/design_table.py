"""Print a design as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vctune.api.design_files import text
from vctune.api.messages import printable

if TYPE_CHECKING:
    from vctune.document.records.design_json import DesignRecord, RepairRecord
    from vctune.document.records.rows_json import Cells, CornerRecord, SweepRecord

# Width of the terminal, in characters, below which each group heading of a design's table has a separate line
LEAST_WIDTH = 80
WIDE = 120  # Width of tables, in characters, if stdout is not a terminal
COLOURS = {"certified": "green", "violated": "red", "infeasible": "red", "undecided": "yellow"}  # Colour of each status


@contextmanager
def page(least_width: int, folder: Path, steps: Sequence[str] = ()) -> Iterator[Console]:
    """Print either the whole output of this block or nothing."""
    console = Console(highlight=False)
    console.width = max(console.width, least_width)
    with console.capture() as page:
        yield console
        console.print(f"written to {_linked(folder, console)}", soft_wrap=True)
        if steps:
            between = "\n      " if console.is_terminal else "; "
            console.print(f"next: {between.join(_with_links(step, console) for step in steps)}", soft_wrap=True)
    _write(console, page.get())


def _linked(path: Path, console: Console) -> str:
    """Return a path as a link (OSC 8) if the output is a terminal; otherwise its text."""
    text = escape(str(path))
    return f"[link={path.resolve().as_uri()}]{text}[/link]" if console.file.isatty() else text


def _with_links(step: str, console: Console) -> str:
    """Return a next step as markup. The path in a step "open PATH" becomes a link."""
    verb, _, rest = step.partition(" ")
    return f"{verb} {_linked(Path(rest), console)}" if verb == "open" else escape(step)


def _write(console: Console, text: str) -> None:
    """Write a text without the blanks that a table leaves at the ends of lines."""
    console.file.write("".join(f"{line.rstrip()}\n" for line in text.splitlines()))


def print_design(record: DesignRecord, folder: Path, steps: Sequence[str] = ()) -> None:
    """Print the status and the proved claims of a design, its numbers, its repairs, its warnings, and the folder of its
    files."""
    on_terminal = Console().is_terminal  # lines wrap at words on a terminal, but not in a file
    with page(0 if on_terminal else WIDE, folder, steps) as console:

        def say(text: str) -> None:
            console.print(text, soft_wrap=not on_terminal)

        idle = ", but it hardly uses its velocity loop" if record.idle else ""
        limp = ", but its K_p holds no static force" if record.felt and record.felt.limp and not idle else ""
        colour = COLOURS["undecided" if idle else record.status]
        say(f"[bold]{escape(printable(record.problem.name))}[/bold]: [bold {colour}]{record.status}{idle}[/]{limp}")
        if record.promise:
            say(escape(record.promise))
        if record.reason:
            say(escape(record.reason))
        if record.gains is not None:
            console.print(_table(record, console.width))
        if record.repairs:
            say("any one of these alone would do:")
            say(_repairs(record.repairs))
        elif record.repairs is not None:
            say("vctune found no change of a single value that makes the problem feasible")
        for warning in record.warnings:
            say(f"[yellow]warning:[/yellow] {escape(warning)}")


def _repairs(repairs: list[RepairRecord]) -> str:
    """Return one line for each repair: the new text in the file, the old value, the meaning, and the resulting
    error."""
    width = max(len(repair.needs) for repair in repairs)
    lines = []
    for repair in repairs:
        old = "true" if repair.turns_off else "inf" if repair.old is None else text(repair.old, 12)
        lines.append(
            f"  [bold]{escape(repair.needs.ljust(width))}[/bold]  instead of {old}: {escape(repair.change)}, "
            f"error {text(repair.error, 4)}"
        )
    return "\n".join(lines)


def _table(record: DesignRecord, width: int) -> Table:
    """Return the rows of a design."""
    groups, narrow = _ordered(record), width < LEAST_WIDTH
    rows: list[tuple[str, ...]] = []
    for group, group_rows in groups.items():
        if narrow:
            rows += [(group, "", ""), *((f"  {label}", *others) for label, *others in group_rows)]
        else:
            rows += [(group if number == 0 else "", *row) for number, row in enumerate(group_rows)]
    table = Table(show_header=False, box=None, pad_edge=False)
    for column, style in enumerate(("", "bold") if narrow else ("dim", "", "bold")):
        # the table never cuts numbers; the columns after them wrap
        least = max((len(row[column]) for row in rows), default=0)
        table.add_column(style=style, no_wrap=True, min_width=least, justify="right" if style == "bold" else "left")
    table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def _ordered(record: DesignRecord) -> dict[str, list[tuple[str, str, str]]]:
    """Return label, value and unit of the rows by group: the design, the constraints that limit it, the rest."""
    groups: dict[str, list[tuple[str, str, str]]] = {
        group: [(row.label, row.value, row.unit) for row in rows if not row.detail]
        for group, rows in record.groups().items()
    }
    limits = [("", "", line) for line in record.limits]
    ordered = {name: groups.pop(name) for name in ("gains", "coupling") if name in groups}
    return ordered | ({"limited by": limits} if limits else {}) | groups


def print_lines(lines: Sequence[str], folder: Path, steps: Sequence[str]) -> None:
    """Print lines and the folder of the files; on a terminal, wrap the lines at words and print the next steps."""
    if not Console().is_terminal:
        click.echo("\n".join([*lines[:-1], f"{lines[-1]}; written to {folder}"]))
        return
    with page(0, folder, steps) as console:
        for line in lines:
            console.print(escape(line))


def print_sweep(rows: SweepRecord, folder: Path) -> None:
    """Print the results of a sweep and the folder of its files."""
    on_terminal = Console().is_terminal
    shown = "error.svg" if (folder / "error.svg").exists() else "table.csv"
    with page(0, folder, [f"open {folder / shown}"] if on_terminal else []) as console:

        def say(line: str) -> None:
            console.print(line, soft_wrap=not on_terminal)

        idle = {"certified": f" ({rows.idle} idle)" if rows.idle else ""}
        counts = ", ".join(f"{count} {status}{idle.get(status, '')}" for status, count in rows.status.items())
        say(f"[bold]{escape(printable(rows.study))}[/bold]: {rows.points} points, {counts}")
        for label, row in (("best", rows.best), ("worst", rows.worst)):
            if row:
                say(f"{label:<5}  {_design_line(row)}")
        say(f"over   {_yardstick_line(rows)}")
        if rows.corner:
            say(_corner_line(rows.corner))


def _design_line(row: Cells) -> str:
    """Return the error of a row and its point. Only the keys of axes contain a dot."""
    axes = ", ".join(f"{key} = {text(value, 6)}" for key, value in row.items() if "." in key)
    return escape(f"error {text(row['error'])} at {axes}{', idle' if row['idle'] else ''}")


def _yardstick_line(rows: SweepRecord) -> str:
    """Return the line that states the yardstick of a sweep's errors."""
    on, unit = rows.yardstick, rows.units["reference_impedance"]
    shared = f"{text(on.band_hz)} Hz with Z_0 = {text(on.reference_impedance)} {unit}"
    if not on.varied:
        return escape(f"{shared}, at every point")
    return escape(f"{shared}, except {', '.join(on.varied)}: errors at different values of it are not comparable")


def _corner_line(corner: CornerRecord) -> str:
    """Return the lines that state the smallest box with all points without a certified design, and the most frequent
    reason."""
    spans = ", ".join(
        f"{key} from {text(low, 6)} to {text(high, 6)}"
        for (key, low), high in zip(corner.low.items(), corner.high.values(), strict=True)
    )
    where = f"none   at {corner.points} points, {corner.share:.0%} of those with {spans}"
    return escape(f"{where}\n       most often: {printable(corner.reason)}")
