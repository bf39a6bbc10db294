"""Define the JSON that commands only print: refusals of `check`, and the output of `report`, `export`, `bench`,
`explain` and `example`."""

from __future__ import annotations

from typing import Any, Literal

from vctune.document.records.part import Document, Part


class NamedRecord(Part):
    """A problem, stated by its name."""

    name: str


class RefusalRecord(Document):
    """An entry in the list of `vctune check` for a file that it cannot use or has skipped."""

    SCHEMA = "vctune/refusal/1"

    problem: NamedRecord  # name, as in a design
    source: str  # the file
    line: int  # line of the file to which the reason refers, from 1
    status: None = None  # null, so that every entry of the list has this key
    reason: str  # why vctune cannot use the file, or has skipped it
    warnings: list[str]  # always empty


class ReportRecord(Document):
    """The output of `vctune report`: the path of the written page."""

    SCHEMA = "vctune/report/1"

    report: str


class ExportRecord(Document):
    """The output of `vctune export`."""

    SCHEMA = "vctune/export/1"

    name: str  # name of the controller
    status: str  # as in design.json
    statement: list[str]  # lines that state what is proved; the exported files contain the same lines
    folder: str  # folder of the files
    files: list[str]  # their names in the folder


class BenchRecord(Document):
    """The result of a benchmark."""

    SCHEMA = "vctune/bench/1"

    name: str  # name of the benchmark
    title: str  # what it measures
    machine: str  # the machine on which it ran
    facts: list[str]  # summary, in sentences
    table: list[dict[str, Any]]  # one object for each measured row; its keys depend on the benchmark


class EntryRecord(Part):
    """The text of a guide about a name, in Markdown. The list of all names contains this record with an empty text."""

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
    """The output of `vctune example`."""

    SCHEMA = "vctune/example/1"

    names: list[str]  # the written example, or all examples
    file: str | None  # path of the written file; null for the list
