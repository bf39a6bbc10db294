"""Define the JSON output of the commands that write no file of the same form."""

from __future__ import annotations

from typing import Any, Literal

from vctune.document.records.part import Document, Part


class NamedRecord(Part):
    """A problem, stated by its name."""

    name: str


class RefusalRecord(Document):
    """An entry in the list of `vctune check` for a file that it cannot use or has skipped: the file, the line, and the
    reason."""

    SCHEMA = "vctune/refusal/1"

    problem: NamedRecord
    source: str
    line: int
    status: None = None
    reason: str
    warnings: list[str]


class ReportRecord(Document):
    """The output of `vctune report`: the paths of the written files."""

    SCHEMA = "vctune/report/1"

    report: str


class ExportRecord(Document):
    """The output of `vctune export`: the paths of the written files, and what they realise."""

    SCHEMA = "vctune/export/1"

    name: str
    status: str
    statement: list[str]
    folder: str
    files: list[str]


class BenchRecord(Document):
    """The result of a benchmark: a summary in sentences, and the rows of a table."""

    SCHEMA = "vctune/bench/1"

    name: str
    title: str
    machine: str
    facts: list[str]
    table: list[dict[str, Any]]


class EntryRecord(Part):
    """The text of a guide about a name, in Markdown. In a list of names, the text is absent."""

    kind: Literal["code", "key", "term", "claim"]
    name: str
    text: str
    guide: str


class ExplanationRecord(Document):
    """The output of `vctune explain`. `name` is the argument; it is null for the list of names."""

    SCHEMA = "vctune/explanation/1"

    name: str | None
    entries: list[EntryRecord]


class ExampleRecord(Document):
    """The output of `vctune example`: the written file, or the names of all examples."""

    SCHEMA = "vctune/example/1"

    names: list[str]
    file: str | None
