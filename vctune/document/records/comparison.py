"""Compare two designs: list the differences of their problems, and both results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from vctune.document.records.design_json import DesignRecord
from vctune.document.records.gains_json import TransparencyRecord
from vctune.document.records.part import Document, Pair, Part, Shown, filled, how_shown
from vctune.document.records.rows_json import FeltRecord
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import KeyPath, dotted
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.transparency import TERMS

UNCOMPARED = ("name", "description", "experiment")
"""Keys of a problem that do not affect its design."""


class SideRecord(Part):
    """One of the two designs: its origin and its kind."""

    source: str
    name: str
    status: str
    idle: bool
    reason: str | None


class DifferenceRecord(Part):
    """A key with different values in the two problems.

    A value is null if the file does not state it; a range is a pair.
    """

    key: str
    a: Any
    b: Any


class ValueRecord(Part):
    """A number or a verdict of both designs, by its key in design.json. A value that does not exist is null."""

    group: str
    key: str
    label: str
    unit: str
    digits: int
    a: float | int | str | list[Any] | None
    b: float | int | str | list[Any] | None


class ComparisonRecord(Document):
    """The output of `vctune compare`."""

    SCHEMA = "vctune/comparison/1"

    a: SideRecord
    b: SideRecord
    problem: list[DifferenceRecord]
    design: list[ValueRecord]


class MeasuredRecord(TransparencyRecord):
    """The error and its terms on a yardstick, and the yardstick."""

    band_hz: Annotated[Pair, Shown("over a band of", unit="Hz")]
    reference_impedance: Annotated[float, Shown("with Z_0", of="damping")]


@dataclass(frozen=True, slots=True)
class Side:
    """One of two designs to be compared.

    Attributes
    ----------
    source : name of the design in the output
    record : record of the design
    problem : problem for which the design was made, with its yardstick
    felt : how the design feels; None without a design
    measured : error on the common yardstick, or on the yardsticks of A and of B; empty without a design
    """

    source: str
    record: DesignRecord
    problem: Problem
    felt: FeltRecord | None
    measured: tuple[MeasuredRecord | None, ...]


def comparison(a: Side, b: Side) -> ComparisonRecord:
    """Return the comparison of two designs.

    Parameters
    ----------
    a, b : the designs, measured on the same yardsticks
    """
    return ComparisonRecord(
        a=_side(a),
        b=_side(b),
        problem=_differences(a.problem, b.problem),
        design=[value for value in _values(a, b) if not (_absent(value, a.problem) and _absent(value, b.problem))],
    )


def _absent(value: ValueRecord, problem: Problem) -> bool:
    """Return whether a number is always 0 for a kind of display."""
    kind, last = problem.device.kind, value.key.rpartition(".")[2]
    return value.key in kind.absent or (last in TERMS and last not in kind.terms)


def _side(side: Side) -> SideRecord:
    record = side.record
    return SideRecord(
        source=side.source, name=record.problem.name, status=record.status, idle=record.idle, reason=record.reason
    )


def _differences(a: Problem, b: Problem) -> list[DifferenceRecord]:
    """Return the keys that differ, with all defaults written out."""
    one, other = ({dotted(path): value for path, value in _leaves(_stated(problem), ())} for problem in (a, b))
    return [
        DifferenceRecord(key=key, a=one.get(key), b=other.get(key))
        for key in dict.fromkeys([*one, *other])
        if one.get(key) != other.get(key)
    ]


def _stated(problem: Problem) -> dict[str, Any]:
    return {key: value for key, value in statement(problem).items() if key not in UNCOMPARED}


def _leaves(node: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Yield each key of a document with its value. A range { min, max } counts as one value."""
    if isinstance(node, dict) and set(node) == {"min", "max"}:
        yield path, [node["min"], node["max"]]
    elif isinstance(node, dict):
        for name, child in node.items():
            yield from _leaves(child, (*path, name))
    else:
        yield path, node


def _values(a: Side, b: Side) -> Iterator[ValueRecord]:
    """Yield the numbers and verdicts that either design has, by group, with the error on one or on both yardsticks."""
    units = (a.record.units, b.record.units)
    on = ("transparency",) if len(a.measured) == 1 else ("on_a", "on_b")
    titles = {"transparency": "transparency", "on_a": "measured as A", "on_b": "measured as B"}
    for name, title in DesignRecord.GROUPS.items():
        if name != "transparency":
            yield from _compared(
                title, name, list(zip((getattr(a.record, name), getattr(b.record, name)), units, strict=True))
            )
            continue
        for key, *parts in zip(on, a.measured, b.measured, strict=True):
            yield from _compared(titles[key], key, list(zip(parts, units, strict=True)))
        yield from _compared("in the hand", "felt", list(zip((a.felt, b.felt), units, strict=True)))


def _compared(title: str, prefix: str, sides: Sequence[tuple[Part | None, Units]]) -> Iterator[ValueRecord]:
    """Yield the displayed fields of two parts and of the parts inside them."""
    parts = [(part, units) for part, units in sides if part is not None]
    for field, display_of_field in {
        field: display for part, _ in parts for field, display in how_shown(type(part)).items()
    }.items():
        value_a, value_b = (_scaled(getattr(part, field, None), display_of_field) for part, _ in sides)
        having = [(part, units) for part, units in parts if hasattr(part, field)]
        label = _either(units.translated(filled(part, display_of_field.label, units)) for part, units in having)
        unit = _either(units.of(display_of_field.of) for _, units in having) or (
            "" if "{" in display_of_field.unit else display_of_field.unit
        )
        unit = "Hz" if field.endswith("_hz") else unit
        if not display_of_field.detail and (value_a is not None or value_b is not None):
            key = f"{prefix}.{field}"
            yield ValueRecord(
                group=title, key=key, label=label, unit=unit, digits=display_of_field.digits, a=value_a, b=value_b
            )
    inner = [name for part, _ in parts for name, value in part if isinstance(value, Part)]
    for name in dict.fromkeys(inner):
        yield from _compared(title, f"{prefix}.{name}", [(getattr(part, name, None), units) for part, units in sides])


def _either(texts: Iterable[str]) -> str:
    """Return the text if both designs have the same one, or if only one of them has a text."""
    return " or ".join(dict.fromkeys(texts))


def _scaled(value: Any, shown: Shown) -> Any:
    return value * shown.scale if isinstance(value, float) and shown.scale != 1 else value
