"""Define the base class of all records."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar, get_type_hints

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from vctune.model.display import DisplayName
from vctune.model.fields import Shown
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.units import Units

T = TypeVar("T")
P = TypeVar("P", bound=BaseModel)
SHOWN_AS_ZERO = 1e-20  # Size below which a number is 0 in a text
GRAMS = 0.1  # Mass below which a mass is told in grams, kg


class Row(NamedTuple):
    """A displayed number: its name, its text, and its unit or place."""

    label: str
    value: str
    unit: str

    def nominal(self) -> Row:
        """Return the row with a note that it is of the nominal device alone, in a problem with a box of devices."""
        return self._replace(unit=f"{self.unit}; nominal" if self.unit else "nominal")


def text(value: Any, digits: int = 5) -> str:
    """Return a value of a record as text."""
    if isinstance(value, list):
        low, high = ("inf" if edge is None else text(edge, digits) for edge in value)
        return f"{low} to {high}"
    if isinstance(value, float):
        return f"{0.0 if abs(value) < SHOWN_AS_ZERO else value:.{digits}g}"
    return "none" if value is None else str(value)


def milli(value: float, unit: str) -> str:
    """Return a small length or angle, or a small speed."""
    return f"{text(1e3 * value, 4)} m{unit}" if value < 1 else f"{text(value, 4)} {unit}"


def _existing(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


# A number; null in the file stands for infinity, for NaN, or for a number that is absent
Nullable = Annotated[float | None, BeforeValidator(_existing)]
Proof = Literal["proved", "refuted", "undecided"]
Pair = Annotated[list[Nullable], Field(min_length=2, max_length=2)]


class RecordPart(BaseModel):
    """Part of a record. A part keeps unknown keys, which other versions may have written. `Document.to_json` does not
    write keys that were not set."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the displayed fields in order, in the words and units of a kind of device."""
        return _rows(self, units)

    def in_words(self, units: Units) -> str:
        """Return the numbers of the part with their units, as a phrase that fits into a sentence."""
        return ", ".join(f"{row.value} {row.unit}".rstrip() for row in self.rows(units))


def filled(part: Any, words: str, units: Units) -> str:
    """Return a text in which each name in braces is replaced by the field, part or property of that name, and each name
    with a key in brackets by an entry of it."""

    def stated(field: re.Match[str]) -> str:
        value = getattr(part, field[1])[field[2]] if field[2] else getattr(part, field[1])
        return value.in_words(units) if isinstance(value, RecordPart | Hand | Hands) else text(value)

    return re.sub(r"{(\w+)(?:\[(\w+)\])?}", stated, words)


class Document(RecordPart):
    """A record that is a whole file, or the whole output of a command."""

    SCHEMA: ClassVar[str]  # name of the object under the key `schema`

    def to_json(self) -> dict[str, Any]:
        """Return the object. Every number in it is finite or null."""
        return {"schema": self.SCHEMA} | self.model_dump(mode="json", exclude_unset=True)


@dataclass(frozen=True, slots=True)
class From:
    """How a field follows from what its record is made of, so that the field alone adds a number everywhere."""

    value: Callable[[Any], Any]
    column: Shown | None = None  # how sweeps show the number, which then have it as a column


@cache
def marks(part: Any, kind: type[T]) -> dict[str, T]:
    """Return the marks of one kind on the fields of a class of records, by the fields' names."""
    hints = get_type_hints(part, include_extras=True)
    order = part.model_fields if issubclass(part, BaseModel) else hints
    each = {name: getattr(hints[name], "__metadata__", ()) for name in order}
    return {name: mark for name, found in each.items() for mark in found if isinstance(mark, kind)}


def how_shown(part: Any) -> dict[str, Shown]:
    """Return how each displayed field of a class of records is displayed."""
    return marks(part, Shown)


def made(part: type[P], of: Any, **given: Any) -> P:
    """Return a part of a record, its fields computed as `From` says; a field that does not exist is left out."""
    found = {name: mark.value(of) for name, mark in marks(part, From).items()} | given
    asked = part.model_fields
    return part(**{name: value for name, value in found.items() if value is not None or asked[name].is_required()})


def rows(part: Any, units: Units) -> Iterator[Row]:
    """Yield the rows of a part of a record, or of a table of the model."""
    return part.rows(units) if isinstance(part, RecordPart) else _rows(part, units)


def _rows(part: Any, units: Units) -> Iterator[Row]:
    for name, shown in how_shown(part.__class__).items():
        value = getattr(part, name)
        if value is not None or not shown.optional:
            label, unit = (filled(part, words, units) for words in (shown.label, shown.unit))
            unit = units.of(shown.of) or unit
            scaled = value * shown.scale if isinstance(value, float) else value
            of_value = ("rigid", "") if value == inf else (text(scaled, shown.digits), unit)
            yield Row(units.translated(label), *of_value)


class DisplayPart(RecordPart):
    """Part of a record whose labels depend on the kind of display."""

    display: DisplayName = "admittance"

    @property
    def coupled(self) -> str:
        """The response of the coupling whose real part the conditions bound from below."""
        return "Re 1/Z_c" if self.display == "impedance" else "Re Z_c"
