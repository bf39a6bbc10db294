"""The JSON output of commands that is not a file of its own."""

from __future__ import annotations

from typing import Any, Literal

from vctune.document.records.part import Document, Part


class NamedRecord(Part):
    """A problem by its name."""

    name: str


class RefusalRecord(Document):
    """In the list of `vctune check`, input that cannot be used or was skipped: its file, the line, and why."""

    SCHEMA = "vctune/refusal/1"

    problem: NamedRecord
    source: str
    line: int
    status: None = None
    reason: str
    warnings: list[str]


class ReportRecord(Document):
    """The output of `vctune report`: paths."""

    SCHEMA = "vctune/report/1"

    report: str


class ExportRecord(Document):
    """The output of `vctune export`."""

    SCHEMA = "vctune/export/1"

    name: str
    status: str
    statement: list[str]
    folder: str
    files: list[str]


class BenchRecord(Document):
    """The result of a benchmark: sentences, and the rows of its table."""

    SCHEMA = "vctune/bench/1"

    name: str
    title: str
    machine: str
    facts: list[str]
    table: list[dict[str, Any]]


class EntryRecord(Part):
    """The text of a guide on a name, in Markdown; no text in a list of names."""

    kind: Literal["code", "key", "term", "claim"]
    name: str
    text: str
    guide: str


class ExplanationRecord(Document):
    """The output of `vctune explain`; `name` is the argument, null for the list of names."""

    SCHEMA = "vctune/explanation/1"

    name: str | None
    entries: list[EntryRecord]


class ExampleRecord(Document):
    """The output of `vctune example`: the file, or the names of all examples."""

    SCHEMA = "vctune/example/1"

    names: list[str]
    file: str | None
