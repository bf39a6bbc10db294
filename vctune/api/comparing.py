"""Provide `vctune compare` as a function: two columns of the same rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from math import inf, isclose
from pathlib import Path
from typing import Annotated, Any

from vctune.analysis.demands import transparency_error
from vctune.api.result import Rows, Table
from vctune.api.solving import known_record, solve
from vctune.design.prepared import pose
from vctune.design.search.optimum import Progress
from vctune.design.verdict.design_record import felt_record, record_of
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import on_yardstick, parse_problem
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.gains_json import TransparencyRecord
from vctune.document.records.part import Pair, Part, filled, how_shown, text
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import dotted
from vctune.document.text.errors import printable
from vctune.document.text.json import printed
from vctune.model.fields import Shown
from vctune.model.problem import Problem, Transparency
from vctune.model.transparency import TERMS

SAME = 1e-9  # Greatest relative difference of two numbers that count as equal
UNCOMPARED = ("name", "description", "experiment")  # Keys of a problem that do not affect its design


class _Measured(TransparencyRecord):
    """The error of a design on a yardstick, with the band and the Z_0 of this yardstick."""

    band_hz: Annotated[Pair, Shown("over a band of", unit="Hz")]
    reference_impedance: Annotated[float, Shown("with Z_0", of="damping")]


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

    The function measures the errors of both designs on the yardstick of `a`: its transparency band, Z_0, norm and
    weights. If `b` is a problem that states no band or Z_0, the function solves it with those of `a`. If the yardstick
    of `b` differs, the result contains both errors on both yardsticks. If the designs are for different kinds of
    display, or one is linear and one is rotary, each error is on its own yardstick.

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
    sides = [_designed(a, None, progress)]
    sides.append(_designed(b, sides[0][1], progress))
    problems = [problem for _, problem in sides]
    of_a, of_b = (problem.transparency for problem in problems)
    scales: dict[str, Transparency | None] = {"transparency": None}
    if _alike(*problems):
        scales = {"transparency": of_a} if _same(of_a, of_b) else {"on_a": of_a, "on_b": of_b}
    values = list[Record]()
    for name, title in DesignRecord.GROUPS.items():
        if name != "transparency":
            values += _values(title, name, sides, [getattr(record, name) for record, _ in sides])
            continue
        titles = {"transparency": title, "on_a": "measured as A", "on_b": "measured as B"}
        for key, scale in scales.items():
            values += _values(titles[key], key, sides, [_measured(*side, scale) for side in sides])
        felt = [record.design and felt_record(problem.device, *record.design) for record, problem in sides]
        values += _values("in the hand", "felt", sides, felt)
    stated = [dict(_leaves(statement(problem), ())) for problem in problems]
    keys = dict.fromkeys(key for leaves in stated for key in leaves)
    pairs = [{"key": key, **{side: leaves.get(key) for side, leaves in zip("ab", stated, strict=True)}} for key in keys]
    heads = [
        {
            "source": str(source) if isinstance(source, str | Path) else record.problem.name,
            "name": record.problem.name,
            **{key: getattr(record, key) for key in ("status", "idle", "reason")},
        }
        for source, (record, _) in zip((a, b), sides, strict=True)
    ]
    one, other = heads
    return Comparison(one, other, [pair for pair in pairs if pair["a"] != pair["b"]], values)


Sides = list[tuple[DesignRecord, Problem]]


def _designed(source: Any, base: Problem | None, progress: Progress) -> tuple[DesignRecord, Problem]:
    """Return the record of a design with its problem."""
    record = known_record(source)
    if record is not None:
        return record, parse_problem(record.problem.text, record.problem.name, record.problem.name)
    file = problem_of(source)
    if base is not None and _alike(base, file.problem):
        file = on_yardstick(file, base)
    return record_of(file, solve(file, progress=progress)), file.problem


def _alike(a: Problem, b: Problem) -> bool:
    """Return whether the errors of two problems have the same terms in the same units."""
    return (a.device.display, a.device.units) == (b.device.display, b.device.units)


def _same(a: Transparency, b: Transparency) -> bool:
    numbers = [(yardstick.band.min, yardstick.band.max, yardstick.reference_impedance) for yardstick in (a, b)]
    close = all(isclose(*pair, rel_tol=SAME) for pair in zip(*numbers, strict=True))
    return close and (a.norm, a.weights) == (b.norm, b.weights)


def _measured(record: DesignRecord, problem: Problem, yardstick: Transparency | None) -> _Measured | None:
    """Return a design's error on a yardstick, or on its own."""
    yardstick = yardstick or problem.transparency
    if record.design is None or yardstick.band.max > problem.nyquist:
        return None
    error = transparency_error(pose(replace(problem, transparency=yardstick)).problem, *record.design)
    scale: dict[str, Any] = {"band_hz": list(yardstick.band.hz), "reference_impedance": yardstick.reference_impedance}
    return _Measured(**asdict(error), display=problem.device.display, **scale)


def _leaves(node: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield each key of a document, dotted, with its value; a range is one value."""
    if isinstance(node, dict) and set(node) == {"min", "max"}:
        yield dotted(path), [node["min"], node["max"]]
    elif isinstance(node, dict):
        for name in (name for name in node if path or name not in UNCOMPARED):
            yield from _leaves(node[name], (*path, name))
    else:
        yield dotted(path), node


def _values(title: str, key: str, sides: Sides, parts: list[Any]) -> Iterator[Record]:
    """Yield the displayed fields of a part of both designs, and of the parts inside it."""
    there = [(part, record.units) for part, (record, _) in zip(parts, sides, strict=True) if part is not None]
    for field, shown in {name: shown for part, _ in there for name, shown in how_shown(part.__class__).items()}.items():
        values = [_in_shown_unit(getattr(part, field, None), shown) for part in parts]
        kinds = [problem.device.kind for _, problem in sides]
        if all(f"{key}.{field}" in kind.absent or field in set(TERMS) - set(kind.terms) for kind in kinds):
            continue  # 0 in every design of these kinds of display
        having = [(part, units) for part, units in there if hasattr(part, field)]
        labels = dict.fromkeys(units.translated(filled(part, shown.label, units)) for part, units in having)
        of_quantity = " or ".join(dict.fromkeys(units.of(shown.of) for _, units in having))
        # a unit with a field's name in braces is a phrase about one design
        unit = "Hz" if field.endswith("_hz") else of_quantity or ("" if "{" in shown.unit else shown.unit)
        if values != [None, None]:
            said = {"group": title, "key": f"{key}.{field}", "label": " or ".join(labels), "unit": unit}
            yield {**said, "digits": shown.digits, "a": values[0], "b": values[1]}
    inner = [name for part, _ in there if isinstance(part, Part) for name, value in part if isinstance(value, Part)]
    for name in dict.fromkeys(inner):
        yield from _values(title, f"{key}.{name}", sides, [getattr(part, name, None) for part in parts])


def _in_shown_unit(value: Any, shown: Shown) -> Any:
    """Return a stored value in the unit in which it is displayed. Only a float has such a unit."""
    if value == inf:
        return None
    return value * shown.scale if isinstance(value, float) and shown.scale != 1 else value


def _cell(value: Any, digits: int) -> str:
    """Return a value as text; "-" without a value. A list of two numbers is a range."""
    if isinstance(value, list) and len(value) != 2:
        return printable(str(value))
    return "-" if value is None else printable(text(value, digits))
