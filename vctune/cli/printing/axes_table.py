"""Print the designs of several axes as one table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from vctune.api.design_files import REPORT
from vctune.api.messages import printable
from vctune.api.uncoupled_axes import HEADINGS, axis_row, promises
from vctune.cli.printing.design_table import COLOURS, WIDE, page

if TYPE_CHECKING:
    from vctune.document.records.design_json import DesignRecord


def print_axes(name: str, designs: Mapping[str, DesignRecord], folder: Path) -> None:
    """Print the proved claims, one line for each axis, then the reasons and warnings, then the folder of the files."""
    report = folder / REPORT
    with page(WIDE, folder, [f"open {report}"] if report.exists() else []) as console:
        console.print(f"[bold]{escape(printable(name))}[/bold]")
        for promise in promises(designs):
            console.print(escape(promise), soft_wrap=True)
        table = Table(box=None, pad_edge=False)
        for heading in HEADINGS:
            table.add_column(heading, no_wrap=True, header_style="dim")
        for axis, record in designs.items():
            first, status, *others = map(escape, axis_row(axis, record))
            table.add_row(first, f"[bold {COLOURS[record.status]}]{status}[/]", *others)
        console.print(table)
        for axis, record in designs.items():
            for said in (record.reason, *record.warnings):
                if said:
                    console.print(escape(f"{axis}: {said}"), soft_wrap=True)
