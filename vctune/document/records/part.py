"""The base of all records: fields that are checked when read, written as JSON and shown as rows."""

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


@dataclass(frozen=True, slots=True)
class Shown:
    """How a field is shown.

    Attributes
    ----------
    label : its name for a linear device
    unit : text behind the number; in label and unit, a field's name in braces is replaced by its value
    digits : significant digits
    scale : scale of the number in that unit
    optional : whether to leave out the row if the number does not exist
    detail : whether it is for the report alone, too much for a terminal
    of : which quantity it is (`vctune.model.numbers.units`), whose unit is then behind it
    """

    label: str
    unit: str = ""
    digits: int = 5
    scale: float = 1.0
    optional: bool = False
    detail: bool = False
    of: str = ""


class Row(NamedTuple):
    """A number for people: its name, the number as text, its unit or place, `detail` as in `Shown`."""

    label: str
    value: str
    unit: str
    detail: bool = False


def text(value: Any, digits: int = 5) -> str:
    """Return a value of a record as text.

    Parameters
    ----------
    value : a number, a pair of numbers, a text, or None if it does not exist
    digits : significant ones of a float
    """
    if isinstance(value, list):
        low, high = ("inf" if edge is None else text(edge, digits) for edge in value)
        return f"{low} to {high}"
    return "none" if value is None else f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def _existing(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_existing)]
"""Null in the file if it does not exist."""
Proof = Literal["proved", "refuted", "undecided"]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Part(BaseModel):
    """Part of a record. It keeps unknown keys, of other versions; unset keys are not written."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the fields that are shown, in their order, in the words and units of a kind of device."""
        for name, shown in how_shown(type(self)).items():
            value = getattr(self, name)
            if value is not None or not shown.optional:
                scaled = value * shown.scale if isinstance(value, float) else value
                label, unit = (filled(self, words, units) for words in (shown.label, shown.unit))
                yield Row(units.translated(label), text(scaled, shown.digits), units.of(shown.of) or unit, shown.detail)

    def in_words(self, units: Units) -> str:
        """Return the part as a phrase of a sentence."""
        return ", ".join(f"{row.value} {row.unit}".rstrip() for row in self.rows(units))


def filled(part: Part, words: str, units: Units) -> str:
    """Return the text of a field with the names in braces replaced: other fields, parts or properties of the part.

    Parameters
    ----------
    part : part whose fields are named
    words : text with names in braces, as in "of {band}"
    units : units of the shown numbers
    """

    def stated(field: re.Match[str]) -> str:
        value = getattr(part, field[1])
        return value.in_words(units) if isinstance(value, Part | Hands) else text(value)

    return re.sub(r"{(\w+)}", stated, words)


class Document(Part):
    """A part that is a file of its own, or the output of a command.

    Attributes
    ----------
    SCHEMA : name of the object under the key `schema`
    """

    SCHEMA: ClassVar[str]

    def to_json(self) -> dict[str, Any]:
        """Return the object; every number in it is finite or null."""
        return {"schema": self.SCHEMA} | self.model_dump(mode="json", exclude_unset=True)


def how_shown(part: type[Part]) -> dict[str, Shown]:
    """Return how the fields of a part are shown, those that are."""
    return {
        name: each for name, field in part.model_fields.items() for each in field.metadata if isinstance(each, Shown)
    }


class DisplayPart(Part):
    """Part of a record whose words depend on the display."""

    display: DisplayName = "admittance"

    @property
    def coupled(self) -> str:
        """The response of the coupling that must be resistive enough."""
        return "Re 1/Z_c" if self.display == "impedance" else "Re Z_c"
