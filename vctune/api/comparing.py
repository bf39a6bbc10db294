"""Provide `vctune compare` as a function: two designs side by side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from vctune.api.result import Printed, Table
from vctune.api.solving import known_record, solve
from vctune.design.records.design import DesignRecord, record_of
from vctune.design.search.optimum import Progress
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import on_yardstick, parse_problem, problem_at
from vctune.document.records.part import Row, text
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import KeyPath, dotted
from vctune.document.text.json import printed
from vctune.exit_codes import ExitCode
from vctune.model.problem import Problem

COMPARED = {"status", "idle", "reason", *DesignRecord.GROUPS}  # Keys of design.json that are compared

Record = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two designs side by side: records of a key, its value in `a` and its value in `b`; None for an absent value."""

    problem: list[Record]  # keys of the problem file in which they differ
    design: list[Record]  # keys of design.json, equal or not
    a: DesignRecord = field(repr=False)
    b: DesignRecord = field(repr=False)

    @property
    def exit_code(self) -> ExitCode:
        """Zero: a difference is no failure."""
        return ExitCode.OK

    def to_json(self) -> Record:
        """Return the object for JSON."""
        return printed("comparison", problem=self.problem, design=self.design)

    def rows(self) -> Printed:
        """Yield the keys of the problem that differ, and each number of the designs, as tables."""
        names = tuple(record.problem.name for record in (self.a, self.b))
        if self.problem:
            rows = [(row["key"], *(_in_file(row[side]) for side in "ab")) for row in self.problem]
            yield Table(rows, ("in the problem", *names), (1, 2))
        one, other = ({"": [Row("status", each.status, "")], **each.groups()} for each in (self.a, self.b))
        rows = list[tuple[str, ...]]()
        for title in one | other:
            shown, beside = (
                {row.label: f"{row.value} {row.unit}".strip() for row in of.get(title, ())} for of in (one, other)
            )
            labels = list(shown | beside)
            rows += [
                (title if label == labels[0] else "", label, shown.get(label, ""), beside.get(label, ""))
                for label in labels
            ]
        yield Table(rows, ("", "", *names))


def compare(
    a: ProblemSource | DesignRecord, b: ProblemSource | DesignRecord, *, progress: Progress = lambda stage: None
) -> Comparison:
    """Compare two designs. If an argument is a problem without a design, vctune first solves the problem. The function
    writes no files.

    If `b` is a problem that states no band or Z_0, the function solves it with those of `a`, so that the errors of both
    can be compared.

    Parameters
    ----------
    a, b : ProblemSource or DesignRecord
        Path of a design.json or of a problem file, the tables of a problem, a problem, or the record of a
        design.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    Comparison
        `problem` contains the keys that differ, with defaults written out; `design` contains the values and verdicts of
        both designs. Each entry is a dict of `key`, `a` and `b`.

    Raises
    ------
    InputError
        If `a` or `b` is invalid.
    """
    one, problem = _designed(a, None, progress)
    other, changed = _designed(b, problem, progress)
    stated = (statement(replace(each, name="", description="", experiments=())) for each in (problem, changed))
    designs = (record.model_dump(mode="json", include=COMPARED) for record in (one, other))
    return Comparison([each for each in _beside(*stated) if each["a"] != each["b"]], _beside(*designs), one, other)


def _designed(source: Any, base: Problem | None, progress: Progress) -> tuple[DesignRecord, Problem]:
    """Return the record of a design with its problem."""
    if (record := known_record(source)) is not None:
        return record, parse_problem(record.problem.text, record.problem.name, record.problem.name)
    file = problem_of(source)
    device = file.problem.device
    if base is not None and (base.device.display, base.device.units) == (device.display, device.units):
        posed, _ = problem_at(on_yardstick(file.document, base), file.problem.name)
        file = file if posed is None else replace(file, problem=posed)
    return record_of(file, solve(file, progress=progress)), file.problem


def _in_file(value: Any) -> str:
    """Return a value of a problem file as text; "" for one that the file has not."""
    value = [value["min"], value["max"]] if isinstance(value, dict) and value.keys() == {"min", "max"} else value
    return "" if value is None else text(value, 9)


def _beside(a: Record, b: Record) -> list[Record]:
    """Return the values of two documents by their dotted keys."""
    one, other = dict(_leaves(a, ())), dict(_leaves(b, ()))
    return [{"key": key, "a": one.get(key), "b": other.get(key)} for key in one | other]


def _leaves(node: Any, path: KeyPath) -> Iterator[tuple[str, Any]]:
    """Yield each key of a document, dotted, with its value; a list and a range are one value."""
    if isinstance(node, dict) and set(node) != {"min", "max"}:
        for name in node:
            yield from _leaves(node[name], (*path, name))
    elif node is not None:
        yield dotted(path), node
