"""Provide `vctune compare` as a function: two columns of the same rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

from vctune.api.result import Rows, Table
from vctune.api.solving import known_record, solve
from vctune.design.search.optimum import Progress
from vctune.design.verdict.design_record import felt_record, record_of
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import on_yardstick, parse_problem, pose
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.part import Part, filled, how_shown, text
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import dotted
from vctune.document.text.errors import printable
from vctune.document.text.json import printed
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.transparency import TERMS

UNCOMPARED = ("name", "description", "experiment")  # Keys of a problem that do not affect its design


Record = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two designs side by side."""

    a: Record  # source, name, status, idle, reason: why there is no design
    b: Record
    problem: list[Record]  # keys of the problem file in which they differ: key, a, b
    design: list[Record]  # values that at least one has, equal or not: group, key of design.json, label, unit, a, b

    def to_json(self) -> Record:
        """Return the object for JSON."""
        return printed("comparison", **asdict(self))

    def rows(self) -> Rows:
        """Yield the designs as columns, and then the reasons why there is no design."""
        sides = [at | {"status": f"{at['status']}, idle" if at["idle"] else at["status"]} for at in (self.a, self.b)]
        heads = (("file", "source"), ("problem", "name"), ("status", "status"))
        rows = [("", label, *(printable(at[key]) for at in sides), "") for label, key in heads]
        rows += [("differs", at["key"], _cell(at["a"], 8), _cell(at["b"], 8), "") for at in self.problem]
        for at in self.design:
            cells = (_cell(at[side], at["digits"]) for side in "ab")
            rows.append((at["group"], at["label"], *cells, at["unit"]))
        yield Table(rows, ("", "", "A", "B", ""), right=(2, 3), groups=True)
        yield from (
            (f"{name}: {printable(at['reason'])}",) for name, at in zip("AB", sides, strict=True) if at["reason"]
        )


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
        both designs.

    Raises
    ------
    InputError
        If `a` or `b` is invalid.
    """
    first = _designed(a, None, progress)
    sides = [first, _designed(b, first[1], progress)]
    leaves = [dict(_leaves(statement(problem), ())) for _, problem in sides]
    values = [dict(_shown(record, problem)) for record, problem in sides]
    heads = [
        {
            "source": str(source) if isinstance(source, str | Path) else record.problem.name,
            "name": record.problem.name,
            **{key: getattr(record, key) for key in ("status", "idle", "reason")},
        }
        for source, (record, _) in zip((a, b), sides, strict=True)
    ]
    differing = [{"key": key, "a": one, "b": other} for key, one, other in _pairs(*leaves) if one != other]
    return Comparison(heads[0], heads[1], differing, [_beside(one, other) for _, one, other in _pairs(*values)])


def _designed(source: Any, base: Problem | None, progress: Progress) -> tuple[DesignRecord, Problem]:
    """Return the record of a design with its problem."""
    record = known_record(source)
    if record is not None:
        return record, parse_problem(record.problem.text, record.problem.name, record.problem.name)
    file = problem_of(source)
    if base is not None and (base.device.display, base.device.units) == (
        file.problem.device.display,
        file.problem.device.units,
    ):
        posed, _ = pose(on_yardstick(file.document, base), file.problem.name)
        file = file if posed is None else replace(file, problem=posed)
    return record_of(file, solve(file, progress=progress)), file.problem


def _pairs(a: dict[str, Any], b: dict[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """Yield each key of two tables with both values."""
    yield from ((key, a.get(key), b.get(key)) for key in dict.fromkeys((*a, *b)))


def _leaves(node: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield each key of a document, dotted, with its value; a range is one value."""
    if isinstance(node, dict) and set(node) == {"min", "max"}:
        yield dotted(path), [node["min"], node["max"]]
    elif isinstance(node, dict):
        for name in (name for name in node if path or name not in UNCOMPARED):
            yield from _leaves(node[name], (*path, name))
    else:
        yield dotted(path), node


def _shown(record: DesignRecord, problem: Problem) -> Iterator[tuple[str, Record]]:
    """Yield the displayed values of a design, by their keys in design.json."""
    for key, title in DesignRecord.GROUPS.items():
        part = getattr(record, key)
        if key == "felt" and record.design is not None:  # as numbers, which design.json tells as sentences
            part = felt_record(problem.device, *record.design)
        yield from _values(title, key, part, problem, record.units)


def _values(title: str, key: str, part: Any, problem: Problem, units: Units) -> Iterator[tuple[str, Record]]:
    """Yield the displayed fields of a part of a design, and of the parts inside it."""
    kind = problem.device.kind
    for field, shown in how_shown(part.__class__).items():
        value, place = getattr(part, field), f"{key}.{field}"
        if place in kind.absent or field in set(TERMS) - set(kind.terms):
            continue  # 0 in every design of this kind of display
        scaled = value * shown.scale if isinstance(value, float) and shown.scale != 1 else value
        # a unit with a field's name in braces is a phrase about one design
        unit = "Hz" if field.endswith("_hz") else units.of(shown.of) or ("" if "{" in shown.unit else shown.unit)
        said = {"group": title, "key": place, "label": units.translated(filled(part, shown.label, units)), "unit": unit}
        yield place, {**said, "digits": shown.digits, "value": None if scaled == inf else scaled}
    for name in (name for name, value in part if isinstance(value, Part)) if isinstance(part, Part) else ():
        yield from _values(title, f"{key}.{name}", getattr(part, name), problem, units)


def _beside(a: Record | None, b: Record | None) -> Record:
    """Return a value of both designs; None for one that has it not, and both names where they differ."""
    having = [side for side in (a, b) if side is not None]
    either = {name: " or ".join(dict.fromkeys(side[name] for side in having)) for name in ("label", "unit")}
    return {**having[0], **either, "a": a and a["value"], "b": b and b["value"]}


def _cell(value: Any, digits: int) -> str:
    """Return a value as text; "-" without a value. A list of two numbers is a range."""
    if isinstance(value, list) and len(value) != 2:
        return printable(str(value))
    return "-" if value is None else printable(text(value, digits))
