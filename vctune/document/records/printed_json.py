"""The JSON that commands print and that is not a file of its own."""

from __future__ import annotations

from typing import Any, Literal

from vctune.document.records.part import Document, Part


class NamedRecord(Part):
    """A problem by its name."""

    name: str


class RefusalRecord(Document):
    """In the list of `vctune check`, input that cannot be used or was not looked at: its file, the line, and why."""

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


class EntryRecord(Part):
    """What a guide says of a name, in Markdown; no text in a list of what there is."""

    kind: Literal["code", "key", "term", "claim"]
    name: str
    text: str
    guide: str


class ExplanationRecord(Document):
    """What `vctune explain` prints; `name` is what was asked for, null for the list of what can be."""

    SCHEMA = "vctune/explanation/1"

    name: str | None
    entries: list[EntryRecord]


class ExampleRecord(Document):
    """What `vctune example` wrote, or can write, by name."""

    SCHEMA = "vctune/example/1"

    names: list[str]
    file: str | None
