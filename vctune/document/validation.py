"""From a TOML text to a valid document, or to everything that is wrong with it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from math import isnan
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from vctune.document import toml
from vctune.document.errors import InputError, Mistake

MAX_MISTAKES = 25
TAGS = ("<number>", "<range>", "<text>", "<column>", "<mass>", "<spring>")
"""What tells the forms of a key apart, which is no part of its path."""
LONG = 60

KeyPath = tuple[str | int, ...]
Fault = tuple[KeyPath, str]
"""Path of a key and what is wrong with it."""
MOVED: dict[KeyPath, str] = {
    ("sensors", "velocity"): "is the device's now, of design and simulation alike: write it as [device.velocity] from",
    ("sensors", "filter_hz"): "is the device's now, of design and simulation alike: write it in [device.velocity]",
}
"""Keys that earlier versions had, and where they are now."""
PAIR_LISTS: dict[KeyPath, tuple[str, str]] = {
    ("uncertainty", "unmodelled"): ("[Hz, radius]", "unmodelled = [[1.0, 0.02], [100.0, 0.1]]"),
}
"""Keys that are lists of pairs: what a pair is, and how all of it is written."""
Check = Callable[[dict[str, Any]], list[Fault]]
"""Finds what is wrong between values that are each right, in whatever part of a document is valid."""
Document = TypeVar("Document", bound=BaseModel)


def validated(model: type[Document], text: str, source: str, check: Check) -> Document:
    """Return the document that a TOML text states.

    Parameters
    ----------
    model : class of the document
    text : TOML
    source : what messages call it
    check : finds what is wrong between values that are each right

    Raises
    ------
    InputError
        Listing every mistake in the order of the lines, each with dotted key, value and remedy.
    """
    document, faults = examined(model, toml.parse(text, source), check)
    if document is None or faults:
        raise refusal(faults, text, source)
    return document


def examined(model: type[Document], raw: dict[str, Any], check: Check) -> tuple[Document | None, list[Fault]]:
    """Return the document that parsed TOML states, if it states one, and everything that is wrong with it.

    Parameters
    ----------
    model : class of the document
    raw : tables
    check : finds what is wrong between values that are each right
    """
    try:
        return model.model_validate(raw), check(raw)
    except ValidationError as error:
        return None, [_fault(model, details) for details in error.errors(include_url=False)] + check(raw)


def refusal(faults: list[Fault], text: str | None, source: str) -> InputError:
    """Return the error that lists faults, the first `MAX_MISTAKES` of them, with their lines if there is a text.

    Parameters
    ----------
    faults : at least one
    text : that was read; None if there is no file
    source : what the message calls it
    """
    lines = toml.Lines(text) if text is not None else None
    listed = faults[:MAX_MISTAKES]
    shown = [Mistake(dotted(path), message, _line(lines, path) if lines else None) for path, message in listed]
    more = [Mistake("", f"and {len(faults) - MAX_MISTAKES} more")] if len(faults) > MAX_MISTAKES else []
    return InputError(source, [*sorted(shown, key=lambda mistake: mistake.line or 0), *more])


def _line(lines: toml.Lines, path: KeyPath) -> int:
    """Return the line of a key, or of the nearest table that should have held it."""
    while path:
        line = lines.locate(path)
        if line is not None:
            return line
        path = path[:-1]
    return 1


def dotted(path: KeyPath) -> str:
    """Return a key as it is written: tables joined by dots, elements of lists in brackets."""
    text = ""
    for step in path:
        name = step if isinstance(step, int) or re.fullmatch(r"[\w-]+", step) else json.dumps(step, ensure_ascii=False)
        text += f"[{name}]" if isinstance(step, int) else f".{name}" if text else str(name)
    return _short(text)


def _fault(model: type[BaseModel], details: Any) -> Fault:
    path = untagged(details["loc"])
    value, context, kind = details["input"], details.get("ctx", {}), details["type"]
    if kind == "extra_forbidden":
        return path, MOVED.get(path[-2:], f"unknown key{_suggestion(model, path)}")
    if isinstance(value, float) and isnan(value):
        return path, "nan is not a number; write a number"
    if kind == "value_error":
        return path, str(context["error"])
    if kind == "missing":
        return path, f"is missing; {_documentation(model, path)}"
    messages: dict[str, Callable[[], str]] = {
        "greater_than_equal": lambda: f"{shown(value)} is too small: must be at least {context['ge']:g}",
        "less_than": lambda: f"{shown(value)} is out of range: must be less than {context['lt']:g}",
        "less_than_equal": lambda: f"{shown(value)} is out of range: must be at most {context['le']:g}",
        "float_type": lambda: f"{shown(value)} is not a number; write a number{_or_range(model, path)}",
        "int_type": lambda: f"{shown(value)} is not a whole number; write one without a point",
        "bool_type": lambda: f"{shown(value)} is not true or false",
        "list_type": lambda: f"{shown(value)} is not a list of {_elements(path)}",
        "dict_type": lambda: f"{shown(value)} is not a table",
        "string_type": lambda: f"{shown(value)} is not a text; put it in quotes",
        "literal_error": lambda: f"{shown(value)} is not one of {context['expected']}",
        "model_type": lambda: f"{shown(value)} is not a table",
        "tuple_type": lambda: f"{shown(value)} is not a pair of numbers {_pair(path)}",
        "too_long": lambda: f"{shown(value)} has more than two numbers; write {_pair(path)}",
        "string_pattern_mismatch": lambda: (
            f"{shown(value)} has other characters than letters, digits, spaces and _.,+-"
        ),
        "string_too_short": lambda: f"is empty; {_documentation(model, path)}",
        "string_too_long": lambda: f"{shown(value)} is too long: at most {context['max_length']}",
    }
    return path, messages[kind]() if kind in messages else f"{shown(value)}: {details['msg']}"


def untagged(path: KeyPath) -> KeyPath:
    """Return a path without the tags of what a key may hold."""
    return tuple(step for step in path if step not in TAGS)


def shown(value: Any) -> str:
    """Return a value as a mistake quotes it."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:  # an integer of thousands of digits
        return "this integer"
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= LONG else text[: LONG - 3] + "..."


def _elements(path: KeyPath) -> str:
    """Return what a list consists of, and how it is written."""
    return f"pairs; write {PAIR_LISTS[path][1]}" if path in PAIR_LISTS else f"tables; write [[{dotted(path)}]]"


def _pair(path: KeyPath) -> str:
    """Return how the pair at a path, or that of which it is an element, is written."""
    return next((form for key, (form, _) in PAIR_LISTS.items() if path[: len(key)] == key), "[lower, upper]")


def _or_range(model: type[BaseModel], path: KeyPath) -> str:
    field = _field_at(model, path)
    return " or { min = ..., max = ... }" if field and "Range" in str(field.annotation) else ""


def _field_at(model: type[BaseModel], path: KeyPath) -> FieldInfo | None:
    table = _table_at(model, path[:-1])
    fields = table.model_fields.items() if table else ()
    return next((field for name, field in fields if path[-1] == (field.alias or name)), None)


def _table_at(model: type[BaseModel], path: KeyPath) -> type[BaseModel] | None:
    """Return the table at a path: a key's own, that of each element of a list, or one that may be left out."""
    table = model
    for step in path:
        if isinstance(step, int):
            continue
        field = next((field for name, field in table.model_fields.items() if step == (field.alias or name)), None)
        if field is None:
            return None
        forms = (field.annotation, *get_args(field.annotation))
        found = [form for form in forms if isinstance(form, type) and issubclass(form, BaseModel)]
        if not found or "<number>" in str(field.annotation):
            return None
        table = found[0]
    return table


def _suggestion(model: type[BaseModel], path: KeyPath) -> str:
    table = _table_at(model, path[:-1])
    known = [field.alias or name for name, field in table.model_fields.items()] if table else ["min", "max"]
    meant = get_close_matches(str(path[-1]), known, n=1, cutoff=0.6)
    if meant:
        return f"; did you mean {meant[0]}?"
    owner = next((name for name, field in _tables(model) if path[-1] in field), None)
    return f"; it belongs in [{owner}]" if owner else f"; known here: {', '.join(known)}"


def _tables(model: type[BaseModel]) -> Iterator[tuple[str, set[str]]]:
    for name in model.model_fields:
        table = _table_at(model, (name,))
        if table:
            yield name, set(table.model_fields)


def _documentation(model: type[BaseModel], path: KeyPath) -> str:
    table = _table_at(model, path[:-1])
    if table is None or not isinstance(path[-1], str):
        return f"write two numbers {_pair(path)}" if isinstance(path[-1], int) else "both min and max are needed"
    field = _field_at(model, path)
    text = (field.description if field else None) or (_table_at(model, path) or table).__doc__ or ""
    return f"it is required: {text}" if field is None or field.is_required() else text
