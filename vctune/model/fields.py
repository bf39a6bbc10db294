"""Define the fields of the tables that are files and model at once: their limits, their texts and their quantities.

A program constructs such a table without checks, so that symbols and enclosures pass; pydantic checks what a file
states.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from math import inf
from typing import Annotated, Any, Literal, TypeVar, dataclass_transform, get_type_hints

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    GetPydanticSchema,
    PlainSerializer,
)
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue, SkipJsonSchema
from pydantic_core import CoreSchema, PydanticKnownError
from pydantic_core.core_schema import float_schema, nullable_schema

T = TypeVar("T")
# Least and greatest positive number of a key that does not permit inf, in the units of the file
LEAST, MOST = 1e-50, 1e50


def _zero_or_sizeable(value: float) -> float:
    if 0 < value < LEAST:
        raise ValueError(f"{value:g} is too small: must be 0 or at least {LEAST:g}")
    return value


def _most_or_inf(value: float) -> float:
    if MOST < value < inf:
        raise ValueError(f"{value:g} is too large: must be at most {MOST:g}, or inf")
    return value


def _number(**limits: Any) -> GetPydanticSchema:
    return GetPydanticSchema(lambda *_: float_schema(strict=True, **limits))


# Numbers of a file; in the model they may be arrays, symbols or enclosures
Positive = Annotated[Any, _number(ge=LEAST, le=MOST)]
NotNegative = Annotated[Any, _number(ge=0, le=MOST), AfterValidator(_zero_or_sizeable)]
# a share is below 1, a portion is above 0 and may be 1; the edge of a band may be inf
Share = Annotated[Any, _number(ge=0, lt=1), AfterValidator(_zero_or_sizeable)]
Portion = Annotated[Any, _number(ge=LEAST, le=1)]
DampingRatio = Annotated[Any, _number(ge=LEAST, le=0.7)]  # below that of a servo and a low-pass of order 2
Real = Annotated[Any, _number()]
Edge = Annotated[Any, _number(ge=0), AfterValidator(_zero_or_sizeable)]
NotNegativeOrInf = Annotated[Any, _number(ge=0), AfterValidator(_zero_or_sizeable), AfterValidator(_most_or_inf)]
# Gains and coupling of a device within these limits: masses over squared times, and small shares of either
Found = Annotated[Any, _number(ge=0, le=MOST**3)]
FoundPositive = Annotated[Any, _number(ge=LEAST**3, le=MOST**3)]
# Such a positive number or inf, which is null in JSON
PositiveOrNull = Annotated[
    Any,
    GetPydanticSchema(lambda _source, handler: nullable_schema(handler(Annotated[Any, _number(ge=LEAST**3)]))),
    AfterValidator(lambda value: inf if value is None else value),
    PlainSerializer(lambda value: None if value == inf else value, when_used="json"),
]
# Such a number that is 0 or more, or inf
NotNegativeOrNull = Annotated[
    NotNegativeOrInf,
    BeforeValidator(lambda value: inf if value is None else value),
    PlainSerializer(lambda value: None if value == inf else value, when_used="json"),
]
Place = Annotated[Any, _number(ge=-MOST, le=MOST)]
Order = Annotated[int, Field(strict=True, ge=1, le=2)]
Text = Annotated[str, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]


def _refused(_value: Any) -> Any:
    raise PydanticKnownError("extra_forbidden")


# A field of the model that no file states
Internal = Annotated[T, SkipJsonSchema(), BeforeValidator(_refused)]
Quantity = Literal["", "mass", "damping", "stiffness", "time", "rate", "ratio"]


@dataclass(frozen=True, slots=True)
class Key:
    """The meaning of a key, and how a report and a repair name a parameter of the device."""

    text: str
    quantity: Quantity = ""  # of a parameter of the device; "" for any other key
    label: str = ""  # name in a report, for a linear device; "" for a number that no report names
    better: str = ""  # phrase that describes a linear device with a better value, such as "a faster actuator"
    order_key: str = ""  # key of the low-pass's order, if the number is a corner frequency that a file may omit
    sampled: bool = False
    certain: bool = False  # whether the number is known exactly, so that no file may call it uncertain
    name: str = ""  # the key itself, in its table

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(core) | {"description": self.text}


@dataclass(frozen=True, slots=True)
class Listed:
    """The mark of a table that a file may also write as a list of so many."""

    most: int

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler(core)
        one, nothing = schema.pop("anyOf")
        several = {"type": "array", "items": one, "minItems": 1, "maxItems": self.most}
        return schema | {"anyOf": [{"oneOf": [one, several]}, nothing]}


@dataclass(frozen=True, slots=True)
class Shown:
    """How a field is displayed."""

    label: str  # name of the field, for a linear device
    unit: str = ""  # text after the number; in label and unit, a field's name in braces is replaced by its value
    digits: int = 5  # number of significant digits
    scale: float = 1.0  # factor from the stored number to the displayed one
    optional: bool = False  # whether to omit the row if the number does not exist
    of: str = ""  # quantity (`vctune.model.numbers.units`) whose unit follows the number instead of `unit`


@dataclass_transform(frozen_default=True)
def record(cls: type[T]) -> type[T]:
    """Return a frozen dataclass that is also a table of a file, which refuses unknown keys."""
    made: Any = dataclass(frozen=True, slots=True)(cls)
    made.__pydantic_config__ = ConfigDict(extra="forbid")
    return with_plain_signature(made)


# Types of the fields of a file, as a signature shows them
PLAIN = dict.fromkeys(("Positive", "NotNegative", "Portion", "Share", "Real", "Number"), "float")
PLAIN |= dict.fromkeys(("Hold", "DisplayName", "UnitSystem", "Rule"), "str")
PLAIN |= {"Order": "int", "Sections": "Sequence[Sequence[float]]"}
MARKED = re.compile(r"Internal\[(?P<internal>.*)\]|Annotated\[(?P<type>[^\[\],]*(?:\[[^\]]*\])?[^,]*),.*\]", re.DOTALL)


def with_plain_signature(made: type[T]) -> type[T]:
    """Return a dataclass whose signature, as `help` shows it, has types without the marks of a file."""
    hints = made.__init__.__annotations__
    for name, hint in hints.items():
        mark = MARKED.fullmatch(hint) if isinstance(hint, str) else None
        if mark is not None:
            hints[name] = re.sub(r"\w+", lambda word: PLAIN.get(word[0], word[0]), mark["internal"] or mark["type"])
    return made


@cache
def keys_of_table(table: Any) -> dict[str, str]:
    """Return the key of each field of a table that a file may state, by the field's name."""
    found = {}
    for name, hint in get_type_hints(table, include_extras=True).items():
        marks = getattr(hint, "__metadata__", ())
        if not any(type(mark) is SkipJsonSchema for mark in marks):
            found[name] = next((mark.alias for mark in marks if isinstance(mark, FieldInfo) and mark.alias), name)
    return found


def table_of(value: Any) -> dict[str, Any]:
    """Return a table as a file states it, without absent keys."""
    keys: dict[str, str] = keys_of_table(value.__class__)
    stated = {keys[field.name]: getattr(value, field.name) for field in fields(value) if field.name in keys}
    return {
        key: table_of(entry) if is_dataclass(entry) else entry for key, entry in stated.items() if entry is not None
    }
