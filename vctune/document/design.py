"""The design file: the object that `vctune solve --json` prints (document/README.md, section 3), read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from vctune.document.errors import InputError, Mistake
from vctune.document.json import read_json
from vctune.document.record import SCHEMA, DesignRecord
from vctune.document.validation import MAX_MISTAKES, dotted

MAX_BYTES = 10_000_000


def read_design(path: Path) -> DesignRecord:
    """Return the record that a design.json holds.

    Raises
    ------
    InputError
        If it cannot be read or is not one, listing the parts that are missing or wrong.
    """
    return design_of(read_json(path, "a design.json of `vctune solve`", MAX_BYTES), str(path))


def design_of(value: Any, source: str) -> DesignRecord:
    """Return the record that the object of a design.json holds.

    Parameters
    ----------
    value : the object
    source : what messages call it

    Raises
    ------
    InputError
        If it is not one, listing the parts that are missing or wrong.
    """
    if not isinstance(value, dict) or value.get("schema") != SCHEMA:
        raise InputError(source, [Mistake("schema", f"is not {SCHEMA}; name a design.json of `vctune solve`")])
    try:
        return DesignRecord.model_validate(value)
    except ValidationError as error:
        faults = error.errors(include_url=False)[:MAX_MISTAKES]
        mistakes = [Mistake(dotted(fault["loc"]), fault["msg"]) for fault in faults]
        raise InputError(source, [*mistakes, Mistake("", "is damaged; solve the problem again")]) from None
