"""Print an identification as a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vctune.api.messages import printable

if TYPE_CHECKING:
    from vctune.document.records.identification_json import IdentificationRecord

WIDTH = 140  # Least width of a line, characters, even if the terminal is narrower


def print_identification(record: IdentificationRecord, folder: Path) -> None:
    """Print the recordings, the parameters with their intervals, the warnings and remarks, and the
    folder of the files."""
    console = Console(highlight=False)
    console.width = max(console.width, WIDTH)
    console.print(f"[bold]{escape(printable(record.name))}[/bold]")
    for each in record.recordings:
        left = "" if each.residual_share is None else f", residual {each.residual_share:.2%}"
        console.print(
            escape(f"{printable(each.source)}: {each.kind}, {each.used} of {each.samples} samples{left}"),
            soft_wrap=True,
        )
    table = Table(box=None, pad_edge=False)
    for heading in ("number", "value", "from", "to", "", "limited by"):
        right = heading in ("value", "from", "to")
        table.add_column(heading, header_style="dim", justify="right" if right else "left")
    for number in record.numbers:
        cells = (f"{value:.5g}" for value in (number.value, number.low, number.high))
        table.add_row(number.key, *cells, number.unit, escape(number.limit))
    console.print(table)
    if record.unmodelled:
        worst = max(record.unmodelled, key=lambda point: point[1] or 0.0)
        console.print(f"unmodelled: up to {worst[1]:.3g} of the response, at {worst[0]:.4g} Hz")
    for warning in record.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(printable(warning))}", soft_wrap=True)
    for remark in record.remarks:
        console.print(f"[dim]{escape(printable(remark))}[/dim]", soft_wrap=True)
    console.print(f"written to {escape(str(folder))}", soft_wrap=True)
