"""Strict reading of JSON files: finite numbers, a plausible size, and the records that they state."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from vctune.document.records.part import Document
from vctune.document.schema.validation import MAX_MISTAKES, dotted, untagged
from vctune.document.text.errors import InputError, Mistake

Record = TypeVar("Record", bound=Document)


def read_json(path: Path, kind: str, max_bytes: int) -> Any:
    """Return the content of a JSON file.

    Parameters
    ----------
    path : the file
    kind : expected kind, for the message about a file that is too long
    max_bytes : the most that such a file can have

    Raises
    ------
    InputError
        If it cannot be read, is too long, or is not strict JSON.
    """
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise InputError.of(str(path), "unreadable-file", f"cannot be read: {error.strerror}") from None
    if len(data) > max_bytes:
        message = f"is longer than {max_bytes} bytes; this is not {kind}"
        raise InputError.of(str(path), "unreadable-file", message)
    try:
        return json.loads(data.decode("utf-8-sig"), parse_constant=_finite, parse_float=_finite)
    except RecursionError:
        raise InputError.of(str(path), "not-json", "is not JSON: nested too deeply") from None
    except ValueError as error:
        raise InputError.of(str(path), "not-json", f"is not JSON: {error}") from None


def as_record(value: Any, part: type[Record], source: str, *, kind: str, remedy: str) -> Record:
    """Return the record that the object of a JSON file states.

    Parameters
    ----------
    value : the object
    part : class of the record
    source : name of the file in messages
    kind : the expected object, for the message
    remedy : remedy for one that is damaged

    Raises
    ------
    InputError
        If it is another object, or listing the parts that are missing or wrong.
    """
    if not isinstance(value, dict) or value.get("schema") != part.SCHEMA:
        raise InputError.of(source, "other-document", f"is not {part.SCHEMA}; name {kind}", key="schema")
    try:
        return part.model_validate(value)
    except ValidationError as error:
        faults = error.errors(include_url=False)[:MAX_MISTAKES]
        mistakes = [Mistake("damaged-document", dotted(untagged(fault["loc"])), fault["msg"]) for fault in faults]
        raise InputError(source, [*mistakes, Mistake("damaged-document", "", f"is damaged; {remedy}")]) from None


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f"{text} is no finite number")
    return number
