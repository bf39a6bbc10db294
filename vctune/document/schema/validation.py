"""Turn a TOML text into a valid document, or into a list of all its mistakes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from functools import cache, partial
from math import isnan
from typing import Any, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, Tag, ValidationError
from pydantic.fields import FieldInfo

from vctune.document.text import toml
from vctune.document.text.codes import Code
from vctune.document.text.errors import InputError, Mistake
from vctune.document.text.hints import CALLED, commas_meant, number_meant

MAX_MISTAKES = 25  # Greatest number of mistakes that one error lists
# Tags of the alternative forms of a key's value
TAGS = ("<number>", "<range>", "<text>", "<column>", "<mass>", "<spring>", "<mechanism>", "<servo>")
LONG = 60  # Greatest length of a key or a value that a message quotes, in characters

KeyPath = tuple[str | int, ...]
Contradiction = tuple[KeyPath, str]  # Path of a key, and a message on how its value contradicts other values


class Fault(NamedTuple):
    """A fault in a key of a document."""

    path: KeyPath
    message: str
    code: Code


# Keys whose values are lists of pairs, each with an example
PAIR_LISTS: dict[KeyPath, tuple[str, str]] = {
    ("uncertainty", "unmodelled"): ("[Hz, radius]", "unmodelled = [[1.0, 0.02], [100.0, 0.1]]"),
}
# Function that finds contradictions between values in the valid parts of a document
Check = Callable[[dict[str, Any]], list[Contradiction]]
Document = TypeVar("Document", bound=BaseModel)


def validated(model: type[Document], text: str, source: str, check: Check) -> Document:
    """Return the document that a TOML text states."""
    document, faults = examined(model, toml.parse(text, source), check)
    if document is None or faults:
        raise refusal(faults, text, source)
    return document


def examined(model: type[Document], raw: dict[str, Any], check: Check) -> tuple[Document | None, list[Fault]]:
    """Return the document that parsed TOML states, and all faults."""
    between = [Fault(path, message, "contradiction") for path, message in check(raw)]
    try:
        return model.model_validate(raw), between
    except ValidationError as error:
        explained = {fault.path for fault in between}

        @cache
        def means(table: KeyPath, name: str) -> bool:
            """Return whether a key of a table has a meaning: stating it there gives no contradiction at the key."""
            return all(at != (*table, name) for at, _ in check(_with(raw, (*table, name))))

        alone = [_fault(model, details, means) for details in error.errors(include_url=False)]
        return None, [fault for fault in alone if fault.code != "unknown-key" or fault.path not in explained] + between


def refusal(faults: list[Fault], text: str | None, source: str) -> InputError:
    """Return the error that lists the first `MAX_MISTAKES` faults, with their lines if there is a text."""
    lines = toml.Lines(text) if text is not None else None
    listed = faults[:MAX_MISTAKES]
    mistakes = [
        Mistake(code, dotted(path), message, _line(lines, path) if lines else None) for path, message, code in listed
    ]
    more = (
        [Mistake("more-mistakes", "", f"and {len(faults) - MAX_MISTAKES} more")] if len(faults) > MAX_MISTAKES else []
    )
    return InputError(source, [*sorted(mistakes, key=lambda mistake: mistake.line or 0), *more])


def _line(lines: toml.Lines, path: KeyPath) -> int:
    """Return the line of a key or, if it is absent, of the nearest table that should contain it."""
    while path:
        line = lines.locate(path)
        if line is not None:
            return line
        path = path[:-1]
    return 1


def dotted(path: KeyPath) -> str:
    """Return a key in its written form: tables joined by dots, indices of lists in brackets."""
    text = ""
    for step in path:
        name = step if isinstance(step, int) or re.fullmatch(r"[\w-]+", step) else json.dumps(step, ensure_ascii=False)
        text += f"[{name}]" if isinstance(step, int) else f".{name}" if text else str(name)
    return _short(text)


def _fault(model: type[BaseModel], details: Any, means: Callable[[KeyPath, str], bool]) -> Fault:
    """Return an error of pydantic as a fault: the path, what is wrong, and what to write instead."""
    path = untagged(details["loc"])
    value, context, kind = details["input"], details.get("ctx", {}), details["type"]
    if kind == "extra_forbidden":
        return Fault(path, _unknown(model, details["loc"], partial(means, path[:-1])), "unknown-key")
    if isinstance(value, float) and isnan(value):
        return Fault(path, "nan is not a number; write a number", "wrong-type")
    if kind == "missing":
        return Fault(path, f"is missing; {_documentation(model, path)}", "missing-key")
    of_range, of_type = _range_messages(model, path), _type_messages(model, path)
    if kind in of_range:
        return Fault(path, of_range[kind](value, context), "out-of-range")
    message = of_type[kind](value, context) if kind in of_type else f"{shown(value)}: {details['msg']}"
    return Fault(path, message, "wrong-type")


# Function that makes a message from a value and the constraint that it violates
Message = Callable[[Any, dict[str, Any]], str]


def _range_messages(model: type[BaseModel], path: KeyPath) -> dict[str, Message]:
    """Return the messages on values outside a permitted range, by the kind of pydantic's error."""
    return {
        "value_error": lambda value, constraint: str(constraint["error"]),
        "greater_than_equal": lambda value, constraint: (
            f"{shown(value)} is too small: must be at least {constraint['ge']:g}"
        ),
        "less_than": lambda value, constraint: (
            f"{shown(value)} is out of range: must be less than {constraint['lt']:g}"
        ),
        "less_than_equal": lambda value, constraint: (
            f"{shown(value)} is out of range: must be at most {constraint['le']:g}"
        ),
        "too_long": lambda value, constraint: (
            f"{shown(value)} has more than two numbers{commas_meant(value) or '; write ' + _pair(path)}"
        ),
        "string_pattern_mismatch": lambda value, constraint: (
            f"{shown(value)} has other characters than letters, digits, spaces and _.,+-"
        ),
        "string_too_short": lambda value, constraint: f"is empty; {_documentation(model, path)}",
        "string_too_long": lambda value, constraint: f"{shown(value)} is too long: at most {constraint['max_length']}",
        "literal_error": lambda value, constraint: f"{shown(value)} is not one of {constraint['expected']}",
    }


def _type_messages(model: type[BaseModel], path: KeyPath) -> dict[str, Message]:
    """Return the messages on values of a wrong type, by the kind of pydantic's error."""
    return {
        "float_type": lambda value, constraint: f"{shown(value)} is not a number{_number(model, path, value)}",
        "int_type": lambda value, constraint: f"{shown(value)} is not a whole number; write one without a point",
        "bool_type": lambda value, constraint: f"{shown(value)} is not true or false",
        "list_type": lambda value, constraint: f"{shown(value)} is not a list of {_elements(path)}",
        "dict_type": lambda value, constraint: f"{shown(value)} is not a table",
        "string_type": lambda value, constraint: f"{shown(value)} is not a text; put it in quotes",
        "model_type": lambda value, constraint: f"{shown(value)} is not a table",
        "tuple_type": lambda value, constraint: f"{shown(value)} is not a pair of numbers {_pair(path)}",
    }


def untagged(path: KeyPath) -> KeyPath:
    """Return a path without the tags of a key's alternative forms."""
    return tuple(step for step in path if step not in TAGS)


def shown(value: Any) -> str:
    """Return a value as JSON, in the form in which a mistake quotes it: at most `LONG` characters."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:  # an integer with thousands of digits
        return "this integer"
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= LONG else text[: LONG - 3] + "..."


def _elements(path: KeyPath) -> str:
    """Return the names of a list's elements, and how to write the list."""
    return f"pairs; write {PAIR_LISTS[path][1]}" if path in PAIR_LISTS else f"tables; write [[{dotted(path)}]]"


def _pair(path: KeyPath) -> str:
    """Return the written form of the pair at a path, or of the pair that contains the path."""
    return next((form for key, (form, _) in PAIR_LISTS.items() if path[: len(key)] == key), "[lower, upper]")


def _number(model: type[BaseModel], path: KeyPath, value: Any) -> str:
    """Return a hint on how to write an invalid number."""
    meant = number_meant(value) if isinstance(value, str) else ""
    return meant or f"; write a number{_or_range(model, path)}"


def _or_range(model: type[BaseModel], path: KeyPath) -> str:
    field = _field_at(model, path)
    return " or { min = ..., max = ... }" if field and "Range" in str(field.annotation) else ""


def _field_at(model: type[BaseModel], path: KeyPath) -> FieldInfo | None:
    """Return the field of the schema at a path; None if there is no such key."""
    table = _table_at(model, path[:-1])
    fields = table.model_fields.items() if table else ()
    return next((field for name, field in fields if path[-1] == (field.alias or name)), None)


def _table_at(model: type[BaseModel], path: KeyPath) -> type[BaseModel] | None:
    """Return the table at a path: the value of the key, an element of its list, or an optional table."""
    tables, annotation = [model], None
    for step in path:
        if isinstance(step, int):
            continue
        if step in TAGS:
            tables = _tables_in(annotation, step) or tables
            continue
        fields = (
            field for table in tables for name, field in table.model_fields.items() if step == (field.alias or name)
        )
        field = next(fields, None)
        if field is None or "<number>" in str(field.annotation):
            return None
        annotation = field.annotation
        tables = _tables_in(annotation)
        if not tables:
            return None
    return tables[0]


def _tables_in(annotation: Any, tag: str | None = None) -> list[type[BaseModel]]:
    """Return the tables that a key may hold, or only those with a given tag."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    parts = get_args(annotation)
    if tag is not None and Tag(tag) in parts:
        return _tables_in(parts[0])
    if tag is not None and any(isinstance(part, Tag) for part in parts):
        return []
    return [table for part in parts for table in _tables_in(part, tag)]


def _with(raw: Any, path: KeyPath) -> Any:
    """Return tables with a number set at a path, to find out whether the key at the path has a meaning."""
    if not path:
        return 0.1  # an arbitrary number: only the presence of the key matters
    if isinstance(raw, list):
        return [_with(element, path[1:]) if place == path[0] else element for place, element in enumerate(raw)]
    table = raw if isinstance(raw, dict) else {}
    return {**table, path[0]: _with(table.get(path[0]), path[1:])}


def _unknown(model: type[BaseModel], path: KeyPath, has_a_meaning: Callable[[str], bool]) -> str:
    """Return the message on an unknown key."""
    table = _table_at(model, path[:-1])
    known_keys = [field.alias or name for name, field in table.model_fields.items()] if table else ["min", "max"]
    known_keys = [name for name in known_keys if has_a_meaning(name)]
    usual_name = CALLED.get(str(path[-1]), str(path[-1]).replace("torque", "force"))
    if usual_name != path[-1] and usual_name in known_keys:
        return f"unknown key; of a rotary device too it is called {usual_name}"
    similar = get_close_matches(str(path[-1]), known_keys, n=1, cutoff=0.6)
    if similar:
        return f"unknown key; did you mean {similar[0]}?"
    tag = path[1:2] if path[1:2] and path[1] in TAGS else ()
    owner = next((name for name, fields in _tables(model, path[:1], tag) if path[-1] in fields), None)
    where = f"it belongs in [{owner}]" if owner else f"known here: {', '.join(known_keys)}"
    return f"unknown key; {where}"


def _tables(model: type[BaseModel], tagged: KeyPath, tag: KeyPath) -> Iterator[tuple[str, set[str]]]:
    """Yield the name and the keys of each table at the top of a document."""
    for name in model.model_fields:
        table = _table_at(model, (name, *(tag if (name,) == tagged else ())))
        if table:
            yield name, {field.alias or key for key, field in table.model_fields.items()}


def _documentation(model: type[BaseModel], path: KeyPath) -> str:
    """Return what a missing key should state, in the words of its documentation."""
    table = _table_at(model, path[:-1])
    if table is None or not isinstance(path[-1], str):
        return f"write two numbers {_pair(path)}" if isinstance(path[-1], int) else "both min and max are needed"
    field = _field_at(model, path)
    text = (field.description if field else None) or (_table_at(model, path) or table).__doc__ or ""
    return f"it is required: {text}" if field is None or field.is_required() else text
