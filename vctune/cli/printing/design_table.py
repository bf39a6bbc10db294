"""Print a design as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vctune.api.design_files import SpringRecord, text
from vctune.api.messages import printable

if TYPE_CHECKING:
    from vctune.document.records.comparison import ComparisonRecord
    from vctune.document.records.design_json import DesignRecord, RepairRecord
    from vctune.document.records.rows_json import Cells, CornerRecord, SweepRecord
    from vctune.document.records.simulation_json import DifferenceRecord, LeastVirtualRecord, SimulationRecord
    from vctune.model.numbers.units import Units

LEAST_WIDTH = 80
"""Width of the terminal, in characters, below which each group heading of a design's table gets a line of its own."""
WIDE = 120
WIDEST = 1000
"""Width, in characters, of tables that must not be wrapped."""
COLOURS = {"certified": "green", "violated": "red", "infeasible": "red", "undecided": "yellow"}


@contextmanager
def page(least_width: int, folder: Path, steps: Sequence[str] = ()) -> Iterator[Console]:
    """Print either all of the output of this block or none.

    The folder of the files and the next steps follow at the end.

    Parameters
    ----------
    least_width : least width of a line, characters, even if the terminal is narrower
    folder : folder of the files
    steps : next steps for the user

    Returns
    -------
    context manager of Console
        Yields the console to print with.
    """
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
    """Return a path as a link (OSC 8) if the terminal can open it; otherwise its text.

    A notebook accepts colours like a terminal, but would show the control characters of a link.
    """
    text = escape(str(path))
    return f"[link={path.resolve().as_uri()}]{text}[/link]" if console.file.isatty() else text


def _with_links(step: str, console: Console) -> str:
    verb, _, rest = step.partition(" ")
    return f"{verb} {_linked(Path(rest), console)}" if verb == "open" else escape(step)


def _write(console: Console, text: str) -> None:
    """Write a text without the blanks at the ends of lines, which a table leaves."""
    console.file.write("".join(f"{line.rstrip()}\n" for line in text.splitlines()))


def print_design(record: DesignRecord, folder: Path, steps: Sequence[str] = (), *, verbose: bool = False) -> None:
    """Print the proved claims of a design, its gains, the active constraints, and the folder of its files.

    Parameters
    ----------
    record : record of the design, or of the reason why there is none
    folder : folder of the files, which the last lines name
    steps : next steps for the user
    verbose : whether to print the parts that the search omitted
    """
    narrow = Console().is_terminal  # a terminal's lines wrap at words; a file's lines do not wrap
    with page(0 if narrow else WIDE, folder, steps) as console:

        def say(text: str) -> None:
            console.print(text, soft_wrap=not narrow)

        idle = ", but it hardly uses its velocity loop" if record.idle else ""
        colour = COLOURS["undecided" if idle else record.status]
        say(f"[bold]{escape(printable(record.problem.name))}[/bold]: [bold {colour}]{record.status}{idle}[/]")
        if record.promise:
            say(escape(record.promise))
        if record.reason:
            say(escape(record.reason))
        if record.gains is not None:
            console.print(_table(record, console.width))
        for line in record.compared:
            say(escape(line))
        if record.repairs:
            say("any one of these alone would do:")
            say(_repairs(record.repairs))
        elif record.repairs is not None:
            say("vctune found no change of one number that makes the problem feasible")
        for warning in record.warnings:
            say(f"[yellow]warning:[/yellow] {escape(warning)}")
        for line in record.left_out if verbose else ():
            say(f"[dim]left out: {escape(line)}[/dim]")


def print_simulation(record: SimulationRecord, folder: Path) -> None:
    """Print the measures of a simulation and the folder of its files.

    Parameters
    ----------
    record : record of the simulation
    folder : folder of the files, which the last line names
    """
    from vctune.api.experiments import HEADINGS, dwell_line, measured_rows

    with page(WIDE, folder) as console:
        console.print(f"[bold]{escape(printable(record.problem.name))}[/bold]")
        table = Table(box=None, pad_edge=False)
        for heading in HEADINGS:
            table.add_column(heading, no_wrap=True, header_style="dim")
        for row in measured_rows(record):
            table.add_row(*(escape(printable(cell)) for cell in row))
        console.print(table)
        for one in record.experiments:
            if one.difference is not None:
                apart = _apart(one.difference, record.command_unit)
                console.print(f"{escape(printable(one.name))}: {apart}", soft_wrap=True)
            if one.quiet_stiffness is not None and isinstance(record.coupling, SpringRecord):
                console.print(
                    f"{escape(printable(one.name))}: {_quiet(one.quiet_stiffness, record.coupling, record.units)}",
                    soft_wrap=True,
                )
            if one.least_virtual is not None:
                console.print(
                    f"{escape(printable(one.name))}: {_least(one.least_virtual, record.units)}", soft_wrap=True
                )
        if line := dwell_line(record):
            console.print(line, soft_wrap=True)


def _apart(difference: DifferenceRecord, unit: str) -> str:
    own = f"the design's own in {difference.precision} precision on the same measurements"
    if difference.force is None or difference.tolerance is None:
        return "[red]FAILED[/red], the firmware's commands are not finite"
    if difference.force == 0:
        return f"the firmware's commands are {own} to the last bit"
    apart = f"{difference.force:.3g} {unit} of {own}, farthest at {difference.time_s:.4g} s"
    allowed = f"the tolerance is {difference.tolerance:.3g} {unit}"
    if difference.passes:
        return f"the firmware's commands are within {apart}; {allowed}"
    return f"[red]FAILED[/red], the firmware's commands are only within {apart}; {allowed}"


def _quiet(stiffness: float, coupling: SpringRecord, units: Units) -> str:
    return (
        f"the encoder's resolution alone sustains no limit cycle up to {stiffness:.4g} {units.stiffness} (Abbott and "
        f"Okamura); the coupling has {coupling.stiffness:.4g} {units.stiffness}"
    )


def _least(least: LeastVirtualRecord, units: Units) -> str:
    if least.share == 0:
        return f"the regular PID is stable without a virtual {units.mass_name} and damping"
    return (
        f"the regular PID is stable from a virtual {units.mass_name} of {least.mass:.4g} {units.mass} and a damping of "
        f"{least.damping:.4g} {units.damping} on"
    )


def _repairs(repairs: list[RepairRecord]) -> str:
    """Return one line for each repair: the new text in the file, the old value, the meaning, and the resulting
    error."""
    width = max(len(repair.needs) for repair in repairs)
    lines = []
    for repair in repairs:
        old = "inf" if repair.old is None else text(repair.old, 12)
        lines.append(
            f"  [bold]{escape(repair.needs.ljust(width))}[/bold]  instead of {old}: {escape(repair.change)}, "
            f"error {text(repair.error, 4)}"
        )
    return "\n".join(lines)


def _table(record: DesignRecord, width: int) -> Table:
    """Return the rows of a design.

    The name of a group stands in front of its rows or, on a narrow terminal, above them.
    """
    groups, short = _ordered(record), width < LEAST_WIDTH
    rows: list[tuple[str, ...]] = []
    for group, found in groups.items():
        if short:
            rows += [(group, "", ""), *((f"  {label}", *others) for label, *others in found)]
        else:
            rows += [(group if number == 0 else "", *row) for number, row in enumerate(found)]
    table = Table(show_header=False, box=None, pad_edge=False)
    for column, style in enumerate(("", "bold") if short else ("dim", "", "bold")):
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
        group: [(row.label, row.value, row.unit) for row in found if not row.detail]
        for group, found in record.groups().items()
    }
    limits = [("", "", line) for line in record.limits]
    ordered = {name: groups.pop(name) for name in ("gains", "coupling") if name in groups}
    return ordered | ({"limited by": limits} if limits else {}) | groups


def print_sweep(found: SweepRecord, folder: Path) -> None:
    """Print the results of a sweep and the folder of its files.

    Parameters
    ----------
    found : summary of the sweep
    folder : folder of the files, which the last line names
    """
    with page(LEAST_WIDTH, folder) as console:
        idle = {"certified": f" ({found.idle} idle)" if found.idle else ""}
        counts = ", ".join(f"{count} {status}{idle.get(status, '')}" for status, count in found.status.items())
        console.print(f"[bold]{escape(printable(found.study))}[/bold]: {found.points} points, {counts}")
        for label, row in (("best", found.best), ("worst", found.worst)):
            if row:
                console.print(f"{label:<5}  {_design_line(row)}", soft_wrap=True)
        console.print(f"over   {_yardstick_line(found)}", soft_wrap=True)
        if found.corner:
            console.print(_corner_line(found.corner), soft_wrap=True)


def _design_line(row: Cells) -> str:
    axes = ", ".join(f"{key} = {text(value, 6)}" for key, value in row.items() if "." in key)
    return escape(f"error {text(row['error'])} at {axes}{', idle' if row['idle'] else ''}")


def _yardstick_line(found: SweepRecord) -> str:
    """Return a line on the yardstick of a sweep's errors."""
    on, unit = found.yardstick, found.units["reference_impedance"]
    shared = f"{text(on.band_hz)} Hz with Z_0 = {text(on.reference_impedance)} {unit}"
    if not on.varied:
        return escape(f"{shared}, at every point")
    return escape(f"{shared}, but for {', '.join(on.varied)}: errors at different values of it do not compare")


def _corner_line(corner: CornerRecord) -> str:
    spans = ", ".join(
        f"{key} from {text(low, 6)} to {text(high, 6)}"
        for (key, low), high in zip(corner.low.items(), corner.high.values(), strict=True)
    )
    where = f"none   at {corner.points} points, {corner.share:.0%} of those with {spans}"
    return escape(f"{where}\n       most often: {printable(corner.reason)}")


def print_comparison(found: ComparisonRecord) -> None:
    """Print two designs side by side: first the keys in which the problems differ, then both results.

    Parameters
    ----------
    found : comparison, as `vctune compare --json` prints it
    """
    console = Console(highlight=False, width=WIDEST)
    table = Table(box=None, pad_edge=False)
    for heading in ("", "", "A", "B", ""):
        table.add_column(heading, no_wrap=True, justify="right" if heading in ("A", "B") else "left")
    sides = (found.a, found.b)
    for label, values in (
        ("file", [side.source for side in sides]),
        ("problem", [side.name for side in sides]),
        ("status", [f"{side.status}, idle" if side.idle else side.status for side in sides]),
    ):
        table.add_row("", label, *(escape(printable(value)) for value in values), "")
    for number, differs in enumerate(found.problem):
        table.add_row("[dim]differs[/dim]" if number == 0 else "", differs.key, *map(_cell, (differs.a, differs.b)), "")
    group = ""
    for value in found.design:
        shown = f"[dim]{value.group}[/dim]" if value.group != group else ""
        table.add_row(
            shown, escape(value.label), *(_cell(each, value.digits) for each in (value.a, value.b)), value.unit
        )
        group = value.group
    with console.capture() as page:
        console.print(table)
    _write(console, page.get())
    for name, side in zip("AB", sides, strict=True):
        if side.reason:
            console.print(escape(f"{name}: {printable(side.reason)}"), soft_wrap=True)


def _cell(value: Any, digits: int = 8) -> str:
    if isinstance(value, list) and len(value) != 2:
        return escape(printable(str(value)))
    return "-" if value is None else escape(printable(text(value, digits)))
