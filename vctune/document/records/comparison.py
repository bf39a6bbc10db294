"""Compare two designs: list the differences of their problems, and both results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any

from vctune.document.records.design_json import DesignRecord
from vctune.document.records.gains_json import TransparencyRecord
from vctune.document.records.part import Document, Pair, Part, filled, how_shown
from vctune.document.records.rows_json import FeltRecord
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import KeyPath, dotted
from vctune.model.fields import Shown
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.transparency import TERMS

UNCOMPARED = ("name", "description", "experiment")  # Keys of a problem that do not affect its design


class SideRecord(Part):
    """One of the two designs."""

    source: str  # path that the caller gave; otherwise the name of the problem
    name: str  # name of the problem
    status: str  # "certified", "violated", "undecided" or "infeasible", as in design.json
    idle: bool  # whether the design is certified and hardly uses its velocity loop
    reason: str | None  # reason why there is no design, or by how much a stable design misses the safety factor


class DifferenceRecord(Part):
    """A key with different values in the two problems."""

    key: str  # key of the problem file, dotted
    a: Any  # its values, with defaults written out
    b: Any


class ValueRecord(Part):
    """A number or a verdict of both designs."""

    group: str  # heading under which `vctune compare` prints the value
    key: str  # key of design.json, dotted, for a value of design.json
    label: str  # name of the value; both names, joined by "or", if they differ between the two kinds of device
    unit: str  # unit of both values, or both units; "" without one
    digits: int  # number of significant digits that `vctune compare` prints
    a: float | int | str | list[Any] | None
    b: float | int | str | list[Any] | None


class ComparisonRecord(Document):
    """The output of `vctune compare`."""

    SCHEMA = "vctune/comparison/1"

    a: SideRecord  # the two designs
    b: SideRecord
    problem: list[DifferenceRecord]  # keys of the problem in which they differ
    design: list[ValueRecord]  # values that at least one of the designs has, equal or not


class YardstickErrorRecord(TransparencyRecord):
    """The error of a design and its terms on a yardstick, with the band and the Z_0 of this yardstick."""

    band_hz: Annotated[Pair, Shown("over a band of", unit="Hz")]
    reference_impedance: Annotated[float, Shown("with Z_0", of="damping")]


@dataclass(frozen=True, slots=True)
class ComparedDesign:
    """One of two designs to be compared, with its errors."""

    source: str  # name of the design in the output
    record: DesignRecord  # record of the design, or of the reason why there is none
    problem: Problem  # problem of the record
    felt: FeltRecord | None  # how the design feels; None without a design
    errors: tuple[YardstickErrorRecord | None, ...]  # the error on each yardstick of the comparison


def comparison_record(a: ComparedDesign, b: ComparedDesign) -> ComparisonRecord:
    """Return the comparison of two designs."""
    return ComparisonRecord(
        a=_side_record(a),
        b=_side_record(b),
        problem=_differences(a.problem, b.problem),
        design=[
            value
            for value in _values_by_group(a, b)
            if not (_always_zero(value, a.problem) and _always_zero(value, b.problem))
        ],
    )


def _always_zero(value: ValueRecord, problem: Problem) -> bool:
    """Return whether a value is 0 in every design of the problem's kind of display: an absent gain or error term."""
    kind, last = problem.device.kind, value.key.rpartition(".")[2]
    return value.key in kind.absent or (last in TERMS and last not in kind.terms)


def _side_record(side: ComparedDesign) -> SideRecord:
    """Return what the output states about a design as a whole."""
    record = side.record
    return SideRecord(
        source=side.source, name=record.problem.name, status=record.status, idle=record.idle, reason=record.reason
    )


def _differences(a: Problem, b: Problem) -> list[DifferenceRecord]:
    """Return the keys with different values, in the order of A, and then the keys that only B has."""
    of_a, of_b = ({dotted(path): value for path, value in _leaves(_stated(problem), ())} for problem in (a, b))
    return [
        DifferenceRecord(key=key, a=of_a.get(key), b=of_b.get(key))
        for key in dict.fromkeys([*of_a, *of_b])
        if of_a.get(key) != of_b.get(key)
    ]


def _stated(problem: Problem) -> dict[str, Any]:
    """Return the document of a problem with all defaults, without the keys that do not affect its design."""
    return {key: value for key, value in statement(problem).items() if key not in UNCOMPARED}


def _leaves(node: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Yield the path of each key with its value, for all keys in a value of a document that has the path `path`."""
    if isinstance(node, dict) and set(node) == {"min", "max"}:
        yield path, [node["min"], node["max"]]
    elif isinstance(node, dict):
        for name, child in node.items():
            yield from _leaves(child, (*path, name))
    else:
        yield path, node


def _values_by_group(a: ComparedDesign, b: ComparedDesign) -> Iterator[ValueRecord]:
    """Yield the values that either design has, group by group, with the errors on each yardstick."""
    units = (a.record.units, b.record.units)
    error_keys = ("transparency",) if len(a.errors) == 1 else ("on_a", "on_b")
    titles = {"transparency": "transparency", "on_a": "measured as A", "on_b": "measured as B"}
    for name, title in DesignRecord.GROUPS.items():
        if name != "transparency":
            yield from _values_of_parts(
                title, name, list(zip((getattr(a.record, name), getattr(b.record, name)), units, strict=True))
            )
            continue
        for key, *errors in zip(error_keys, a.errors, b.errors, strict=True):
            yield from _values_of_parts(titles[key], key, list(zip(errors, units, strict=True)))
        yield from _values_of_parts("in the hand", "felt", list(zip((a.felt, b.felt), units, strict=True)))


def _values_of_parts(title: str, key: str, sides: Sequence[tuple[Any, Units]]) -> Iterator[ValueRecord]:
    """Yield the displayed fields of a part of both designs, and of the parts inside it."""
    parts = [(part, units) for part, units in sides if part is not None]
    shown_of_field = {field: shown for part, _ in parts for field, shown in how_shown(part.__class__).items()}
    for field, shown in shown_of_field.items():
        value_a, value_b = (_in_shown_unit(getattr(part, field, None), shown) for part, _ in sides)
        having = [(part, units) for part, units in parts if hasattr(part, field)]
        label = _joined(units.translated(filled(part, shown.label, units)) for part, units in having)
        # a unit with a field's name in braces is a phrase about one design
        unit = _joined(units.of(shown.of) for _, units in having) or ("" if "{" in shown.unit else shown.unit)
        unit = "Hz" if field.endswith("_hz") else unit
        if not shown.detail and (value_a is not None or value_b is not None):
            yield ValueRecord(
                group=title, key=f"{key}.{field}", label=label, unit=unit, digits=shown.digits, a=value_a, b=value_b
            )
    inner = [name for part, _ in parts if isinstance(part, Part) for name, value in part if isinstance(value, Part)]
    for name in dict.fromkeys(inner):
        parts_inside = [(getattr(part, name, None), units) for part, units in sides]
        yield from _values_of_parts(title, f"{key}.{name}", parts_inside)


def _joined(texts: Iterable[str]) -> str:
    """Return the distinct texts, joined by "or"."""
    return " or ".join(dict.fromkeys(texts))


def _in_shown_unit(value: Any, shown: Shown) -> Any:
    """Return a stored value in the unit in which it is displayed. Only a float has such a unit."""
    if value == inf:
        return None
    return value * shown.scale if isinstance(value, float) and shown.scale != 1 else value
