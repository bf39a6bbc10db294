"""Turn a TOML text into a valid document, or into a list of all its mistakes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import cache
from math import isnan
from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel, ValidationError

from vctune.document.text import toml
from vctune.document.text.errors import Code, InputError, Mistake
from vctune.document.text.hints import CALLED, commas_meant, number_meant

MAX_MISTAKES = 25  # Greatest number of mistakes that one error lists
# Tags of the alternative forms of a key's value, in pairs: the first and the second form
TAGS = (
    "<number>", "<range>", "<text>", "<column>", "<mass>", "<spring>", "<mechanism>", "<servo>", "<list>", "<spread>",
    "<trapezoid>", "<euler>",
)  # fmt: skip
LONG = 60  # Greatest length of a key or a value that a message quotes, in characters
DIALECT = "https://json-schema.org/draft/2020-12/schema"

KeyPath = tuple[str | int, ...]
Contradiction = tuple[KeyPath, str]  # Path of a key, and a message on how its value contradicts other values
# Function that finds contradictions between values in the valid parts of a document
Check = Callable[[dict[str, Any]], Iterable[Contradiction]]
Document = TypeVar("Document", bound=BaseModel)


class Fault(NamedTuple):
    """A fault in a key of a document."""

    path: KeyPath
    message: str
    code: Code


# Keys whose values are lists of lists, each with an example
PAIR_LISTS: dict[KeyPath, tuple[str, str]] = {
    ("uncertainty", "unmodelled"): ("[Hz, radius]", "unmodelled = [[1.0, 0.02], [100.0, 0.1]]"),
    **dict.fromkeys(
        (("device", "velocity", "sections"), ("device", "force_sensor", "sections")),
        ("[b0, b1, b2, a0, a1, a2]", "sections = [[0.1, 0.0, 0.0, 1.0, -0.9, 0.0]]"),
    ),
}


def validated(model: type[Document], text: str, source: str, check: Check) -> Document:
    """Return the document that a TOML text states."""
    document, faults = examined(model, toml.parse(text, source), check)
    if document is None or faults:
        raise refusal(faults, text, source)
    return document


def examined(
    model: type[Document], raw: dict[str, Any], check: Check | None = None
) -> tuple[Document | None, list[Fault]]:
    """Return the document that parsed TOML states, and all faults."""
    between = [Fault(path, message, "contradiction") for path, message in check(raw)] if check else []
    try:
        return model.model_validate(raw), between
    except ValidationError as error:
        explained = {fault.path[:end] for fault in between for end in range(1, len(fault.path) + 1)}
        alone = [_fault(model, details) for details in error.errors(include_url=False)]
        return None, [fault for fault in alone if fault.code != "unknown-key" or fault.path not in explained] + between


def refusal(faults: list[Fault], text: str | None, source: str) -> InputError:
    """Return the error that lists the first `MAX_MISTAKES` faults, with their lines if there is a text."""
    lines, more = toml.Lines(text) if text is not None else None, len(faults) - MAX_MISTAKES
    mistakes = [
        Mistake(code, dotted(path), message, lines.nearest(path) if lines else None)
        for path, message, code in faults[:MAX_MISTAKES]
    ]
    rest = [Mistake("more-mistakes", "", f"and {more} more")] if more > 0 else []
    return InputError(source, [*sorted(mistakes, key=lambda mistake: mistake.line or 0), *rest])


def dotted(path: KeyPath) -> str:
    """Return a key in its written form: tables joined by dots, indices of lists in brackets."""
    text = ""
    for step in path:
        name = step if isinstance(step, int) or re.fullmatch(r"[\w-]+", step) else json.dumps(step, ensure_ascii=False)
        text += f"[{name}]" if isinstance(step, int) else f".{name}" if text else str(name)
    return _short(text)


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


# Messages on a value and the constraint that it violates, by the kind of pydantic's error: out of range, wrong type
OUT_OF_RANGE: dict[str, str] = {
    "value_error": "{error}",
    "greater_than_equal": "{value} is too small: must be at least {ge:g}",
    "less_than": "{value} is out of range: must be less than {lt:g}",
    "less_than_equal": "{value} is out of range: must be at most {le:g}",
    "too_short": "is empty; {meaning}",
    "too_long": "{value} has more than two numbers{commas}",
    "string_pattern_mismatch": "{value} has other characters than letters, digits, spaces and _.,+-",
    "string_too_short": "is empty; {meaning}",
    "string_too_long": "{value} is too long: at most {max_length}",
    "literal_error": "{value} is not one of {expected}",
}
WRONG_TYPE: dict[str, str] = {
    "float_type": "{value} is not a number{number}",
    "int_type": "{value} is not a whole number; write one without a point",
    "bool_type": "{value} is not true or false",
    "list_type": "{value} is not a list of {elements}",
    "string_type": "{value} is not a text; put it in quotes",
    "tuple_type": "{value} is not a list of numbers {pair}",
    **dict.fromkeys(("model_type", "dict_type", "dataclass_type"), "{value} is not a table"),
}


def _fault(model: type[BaseModel], details: Any) -> Fault:
    """Return an error of pydantic as a fault: the path, what is wrong, and what to write instead."""
    path, value, kind = untagged(details["loc"]), details["input"], details["type"]
    schema = schema_of(model, model.__name__)
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return Fault(path, _unknown(schema, details["loc"]), "unknown-key")
    if isinstance(value, float) and isnan(value):
        return Fault(path, "nan is not a number; write a number", "wrong-type")
    meaning = _meaning(schema, details["loc"])
    if kind == "missing":
        return Fault(path, f"is missing; {meaning}", "missing-key")
    message = OUT_OF_RANGE.get(kind) or WRONG_TYPE.get(kind)
    if message is None:
        return Fault(path, f"{shown(value)}: {details['msg']}", "wrong-type")
    pair = next((form for key, (form, _) in PAIR_LISTS.items() if path[: len(key)] == key), "[lower, upper]")
    elements = f"pairs; write {PAIR_LISTS[path][1]}" if path in PAIR_LISTS else f"tables; write [[{dotted(path)}]]"
    ranged = any({"min", "max"} == set(form.get("properties", ())) for form in _forms(schema, _at(schema, path)))
    number = number_meant(value) if isinstance(value, str) else ""
    said = message.format(
        **details.get("ctx", {}) | {"value": shown(value)},
        meaning=meaning,
        pair=pair,
        elements=elements,
        commas=(isinstance(value, list) and commas_meant(value)) or f"; write {pair}",
        number=number or f"; write a number{' or { min = ..., max = ... }' if ranged else ''}",
    )
    return Fault(path, said, "out-of-range" if kind in OUT_OF_RANGE else "wrong-type")


Schema = dict[str, Any]


@cache
def schema_of(document: type[BaseModel], title: str) -> Schema:
    """Return the JSON Schema of a document, without null forms and defaults of optional keys; not to be changed."""
    schema = document.model_json_schema()
    definitions = schema.pop("$defs", {})
    for table in (schema, *definitions.values()):
        for key in table.get("properties", {}).values():
            if key.get("default", ...) is None:
                del key["default"]
                key.update(next(form for form in key.pop("anyOf") if form.get("type") != "null"))
    return {"$schema": DIALECT, **schema, "title": title, "$defs": definitions}


def _forms(schema: Schema, entry: Schema | None) -> list[Schema]:
    """Return the alternative forms of a key's value, each without references."""
    if entry is None:
        return []
    if "$ref" in entry:
        return _forms(schema, schema["$defs"][entry["$ref"].removeprefix("#/$defs/")])
    return [form for one in entry.get("oneOf", ()) for form in _forms(schema, one)] or [entry]


def _at(schema: Schema, path: KeyPath) -> Schema | None:
    """Return the entry of the schema at a path; tags in the path choose a form, indices pass through lists."""
    entry: Schema = schema
    for step in path:
        forms = _forms(schema, entry)
        if step in TAGS:
            entry = forms[TAGS.index(str(step)) % 2]
            continue
        inner = [form["items"] for form in forms if "items" in form] if isinstance(step, int) else []
        inner += [form["properties"][step] for form in forms if step in form.get("properties", ())]
        inner += [form["additionalProperties"] for form in forms if isinstance(form.get("additionalProperties"), dict)]
        if not inner:
            return None
        entry = inner[0]
    return entry


def _properties(schema: Schema, path: KeyPath) -> Schema:
    """Return the keys of the table at a path."""
    return next((form["properties"] for form in _forms(schema, _at(schema, path)) if "properties" in form), {})


def _unknown(schema: Schema, path: KeyPath) -> str:
    """Return the message on an unknown key."""
    known, key = list(_properties(schema, path[:-1])), str(path[-1])
    usual = CALLED.get(key, key.replace("torque", "force"))
    if usual != key and usual in known:
        return f"unknown key; of a rotary device too it is called {usual}"
    if similar := get_close_matches(key, known, n=1, cutoff=0.6):
        return f"unknown key; did you mean {similar[0]}?"
    tag = path[1:2] if path[1:2] and path[1] in TAGS else ()
    tables = {name: (name, *(tag if (name,) == path[:1] else ())) for name in schema["properties"]}
    owner = next((name for name, at in tables.items() if key in _properties(schema, at)), None)
    return f"unknown key; {f'it belongs in [{owner}]' if owner else 'known here: ' + ', '.join(known)}"


def _meaning(schema: Schema, path: KeyPath) -> str:
    """Return what a key should state, in the words of its documentation."""
    table, key, plain = _at(schema, path[:-1]), path[-1], untagged(path)
    if isinstance(key, int):
        pair = next((form for at, (form, _) in PAIR_LISTS.items() if plain[: len(at)] == at), "[lower, upper]")
        return f"write two numbers {pair}"
    if path[-2:-1] == ("<range>",):
        both = "min" in _required(schema, table)
        alone = "both min and max are needed" if both else "max alone, from 0 to it, is enough"
        return f"a range needs its {key}; {alone}"
    entry = _at(schema, path) or {}
    text = entry.get("description") or next((form.get("description", "") for form in _forms(schema, entry)), "")
    text = " ".join(text.partition("\n\n")[0].split())
    return f"it is required: {text}" if key in _required(schema, table) else text


def _required(schema: Schema, table: Schema | None) -> set[str]:
    """Return the required keys of the forms of a table."""
    return {key for form in _forms(schema, table) for key in form.get("required", ())}
