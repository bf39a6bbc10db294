"""Define the base class of all records."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from vctune.model.display import DisplayName
from vctune.model.hands import Hands
from vctune.model.numbers.units import Units

NOTHING = 1e-20  # Size below which a number is 0 in a text: no file states smaller ones


@dataclass(frozen=True, slots=True)
class Shown:
    """How a field is displayed."""

    label: str  # name of the field, for a linear device
    unit: str = ""  # text after the number; in label and unit, a field's name in braces is replaced by its value
    digits: int = 5  # number of significant digits
    scale: float = 1.0  # factor from the stored number to the displayed one
    optional: bool = False  # whether to omit the row if the number does not exist
    detail: bool = False  # whether only the report shows it, because it is too long for a terminal
    of: str = ""  # quantity (`vctune.model.numbers.units`) whose unit follows the number instead of `unit`


class Row(NamedTuple):
    """A displayed number: its name, its text, its unit or place, and `detail` as in `Shown`."""

    label: str
    value: str
    unit: str
    detail: bool = False


def text(value: Any, digits: int = 5) -> str:
    """Return a value of a record as text."""
    if isinstance(value, list):
        low, high = ("inf" if edge is None else text(edge, digits) for edge in value)
        return f"{low} to {high}"
    if isinstance(value, float):
        return f"{0.0 if abs(value) < NOTHING else value:.{digits}g}"
    return "none" if value is None else str(value)


def _existing(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


# A number; null in the file stands for infinity, for NaN, or for a number that is absent
Number = Annotated[float | None, BeforeValidator(_existing)]
Proof = Literal["proved", "refuted", "undecided"]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Part(BaseModel):
    """Part of a record. A part keeps unknown keys, which other versions may have written. `Document.to_json` does not
    write keys that were not set."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the displayed fields in order, in the words and units of a kind of device."""
        for name, shown in how_shown(type(self)).items():
            value = getattr(self, name)
            if value is not None or not shown.optional:
                scaled = value * shown.scale if isinstance(value, float) else value
                label, unit = (filled(self, words, units) for words in (shown.label, shown.unit))
                yield Row(units.translated(label), text(scaled, shown.digits), units.of(shown.of) or unit, shown.detail)

    def in_words(self, units: Units) -> str:
        """Return the numbers of the part with their units, as a phrase that fits into a sentence."""
        return ", ".join(f"{row.value} {row.unit}".rstrip() for row in self.rows(units))


def filled(part: Part, words: str, units: Units) -> str:
    """Return a text in which each name in braces is replaced by the field, part or property of that name."""

    def stated(field: re.Match[str]) -> str:
        value = getattr(part, field[1])
        return value.in_words(units) if isinstance(value, Part | Hands) else text(value)

    return re.sub(r"{(\w+)}", stated, words)


class Document(Part):
    """A record that is a whole file, or the whole output of a command."""

    SCHEMA: ClassVar[str]  # name of the object under the key `schema`

    def to_json(self) -> dict[str, Any]:
        """Return the object. Every number in it is finite or null."""
        return {"schema": self.SCHEMA} | self.model_dump(mode="json", exclude_unset=True)


def how_shown(part: type[Part]) -> dict[str, Shown]:
    """Return how each displayed field of a part is displayed."""
    return {
        name: each for name, field in part.model_fields.items() for each in field.metadata if isinstance(each, Shown)
    }


class DisplayPart(Part):
    """Part of a record whose labels depend on the kind of display."""

    display: DisplayName = "admittance"

    @property
    def coupled(self) -> str:
        """The response of the coupling whose real part the conditions bound from below."""
        return "Re 1/Z_c" if self.display == "impedance" else "Re Z_c"
