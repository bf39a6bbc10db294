"""What commands print as JSON that is no file of its own."""

from __future__ import annotations

from typing import Any

from vctune.document.part import Document, Part


class NamedRecord(Part):
    """A problem by its name."""

    name: str


class RefusalRecord(Document):
    """In the list of `vctune check`, input that cannot be used, by its file, the line, and what is wrong."""

    SCHEMA = "vctune/refusal/1"

    problem: NamedRecord
    source: str
    line: int
    status: None = None
    reason: str
    warnings: list[str]


class ReportRecord(Document):
    """What `vctune report` wrote: paths."""

    SCHEMA = "vctune/report/1"

    report: str


class ExportRecord(Document):
    """What `vctune export` wrote."""

    SCHEMA = "vctune/export/1"

    name: str
    status: str
    statement: list[str]
    folder: str
    files: list[str]


class BenchRecord(Document):
    """What a benchmark found: sentences, and the rows of its table."""

    SCHEMA = "vctune/bench/1"

    name: str
    title: str
    machine: str
    facts: list[str]
    table: list[dict[str, Any]]
