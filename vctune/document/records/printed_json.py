"""Define the JSON that commands only print: refusals of `check`, and the output of `report`, `export`, `bench`,
`explain` and `example`."""

from __future__ import annotations

from typing import Any, Literal

from vctune.document.records.part import Document, Part


class NamedRecord(Part):
    """A problem, stated by its name."""

    name: str


class RefusalRecord(Document):
    """An entry in the list of `vctune check` for a file that it cannot use or has skipped.

    Attributes
    ----------
    problem : name, as in a design
    source : the file
    line : line of the file to which the reason refers, from 1
    status : null, so that every entry of the list has this key
    reason : why vctune cannot use the file, or has skipped it
    warnings : always empty
    """

    SCHEMA = "vctune/refusal/1"

    problem: NamedRecord
    source: str
    line: int
    status: None = None
    reason: str
    warnings: list[str]


class ReportRecord(Document):
    """The output of `vctune report`: the path of the written page."""

    SCHEMA = "vctune/report/1"

    report: str


class ExportRecord(Document):
    """The output of `vctune export`.

    Attributes
    ----------
    name : name of the controller
    status : as in design.json
    statement : lines that state what is proved; the exported files contain the same lines
    folder : folder of the files
    files : their names in the folder
    """

    SCHEMA = "vctune/export/1"

    name: str
    status: str
    statement: list[str]
    folder: str
    files: list[str]


class BenchRecord(Document):
    """The result of a benchmark.

    Attributes
    ----------
    name : name of the benchmark
    title : what it measures
    machine : the machine on which it ran
    facts : summary, in sentences
    table : one object for each measured row; its keys depend on the benchmark
    """

    SCHEMA = "vctune/bench/1"

    name: str
    title: str
    machine: str
    facts: list[str]
    table: list[dict[str, Any]]


class EntryRecord(Part):
    """The text of a guide about a name, in Markdown. The list of all names contains this record with an empty text.

    `guide` is the file of the guide.
    """

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
    """The output of `vctune example`.

    Attributes
    ----------
    names : the written example, or all examples
    file : path of the written file; null for the list
    """

    SCHEMA = "vctune/example/1"

    names: list[str]
    file: str | None
