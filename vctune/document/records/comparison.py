"""Compare two designs: list the differences of their problems, and both results.

`vctune compare` prints this record. `vctune.api.comparing` measures both designs first.
"""

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
    """One of the two designs.

    The record states its source, the name of its problem, its status, whether it hardly uses its velocity loop, and why
    there is no design.
    """

    source: str
    name: str
    status: str
    idle: bool
    reason: str | None


class DifferenceRecord(Part):
    """A key with different values in the two problems.

    A value is null if the problem does not have the key, for example because its table is absent. A range is a pair.
    """

    key: str
    a: Any
    b: Any


class ValueRecord(Part):
    """A number or a verdict of both designs. A value that does not exist is null.

    The key is that of design.json, or begins with `felt`, `on_a` or `on_b`.
    """

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
class MeasuredDesign:
    """One of two designs to be compared.

    Attributes
    ----------
    source : name of the design in the output
    record : record of the design
    problem : problem for which the design was made, with its yardstick
    felt : how the design feels; None without a design
    measured : error on the common yardstick, or on the yardsticks of A and of B; an error is None without a design, or
        if the band of the yardstick exceeds the Nyquist frequency of the device
    """

    source: str
    record: DesignRecord
    problem: Problem
    felt: FeltRecord | None
    measured: tuple[MeasuredRecord | None, ...]


def comparison(a: MeasuredDesign, b: MeasuredDesign) -> ComparisonRecord:
    """Return the comparison of two designs.

    Parameters
    ----------
    a, b : the designs, measured on the same yardsticks
    """
    return ComparisonRecord(
        a=_side_record(a),
        b=_side_record(b),
        problem=_differences(a.problem, b.problem),
        design=[
            value
            for value in _compared_groups(a, b)
            if not (_always_zero(value, a.problem) and _always_zero(value, b.problem))
        ],
    )


def _always_zero(value: ValueRecord, problem: Problem) -> bool:
    """Return whether a number is always 0 for a kind of display."""
    kind, last = problem.device.kind, value.key.rpartition(".")[2]
    return value.key in kind.absent or (last in TERMS and last not in kind.terms)


def _side_record(side: MeasuredDesign) -> SideRecord:
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
    """Return the problem as a document, without the keys that do not affect its design."""
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


def _compared_groups(a: MeasuredDesign, b: MeasuredDesign) -> Iterator[ValueRecord]:
    """Yield the numbers and verdicts that either design has, by group, with the error on one or on both yardsticks."""
    units = (a.record.units, b.record.units)
    error_keys = ("transparency",) if len(a.measured) == 1 else ("on_a", "on_b")
    titles = {"transparency": "transparency", "on_a": "measured as A", "on_b": "measured as B"}
    for name, title in DesignRecord.GROUPS.items():
        if name != "transparency":
            yield from _compared_fields(
                title, name, list(zip((getattr(a.record, name), getattr(b.record, name)), units, strict=True))
            )
            continue
        for key, *parts in zip(error_keys, a.measured, b.measured, strict=True):
            yield from _compared_fields(titles[key], key, list(zip(parts, units, strict=True)))
        yield from _compared_fields("in the hand", "felt", list(zip((a.felt, b.felt), units, strict=True)))


def _compared_fields(title: str, prefix: str, sides: Sequence[tuple[Part | None, Units]]) -> Iterator[ValueRecord]:
    """Yield the displayed fields of two parts and of the parts inside them."""
    parts = [(part, units) for part, units in sides if part is not None]
    for field, display_of_field in {
        field: display for part, _ in parts for field, display in how_shown(type(part)).items()
    }.items():
        value_a, value_b = (_scaled(getattr(part, field, None), display_of_field) for part, _ in sides)
        having = [(part, units) for part, units in parts if hasattr(part, field)]
        label = _joined(units.translated(filled(part, display_of_field.label, units)) for part, units in having)
        unit = _joined(units.of(display_of_field.of) for _, units in having) or (
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
        parts_inside = [(getattr(part, name, None), units) for part, units in sides]
        yield from _compared_fields(title, f"{prefix}.{name}", parts_inside)


def _joined(texts: Iterable[str]) -> str:
    """Return the distinct texts, joined by "or"."""
    return " or ".join(dict.fromkeys(texts))


def _scaled(value: Any, shown: Shown) -> Any:
    return value * shown.scale if isinstance(value, float) and shown.scale != 1 else value
