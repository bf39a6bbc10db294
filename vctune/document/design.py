"""The design file: the object that `vctune solve --json` prints (DESIGN 2.3), read back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from vctune.document.errors import InputError, Mistake

SCHEMA = "vctune/design/1"
TABLES = ("problem", "gains", "coupling", "transparency", "certificate", "inner_loop", "solver", "versions", "seconds")


def read_design(path: Path) -> dict[str, Any]:
    """Return the object of a design.json.

    Raises
    ------
    InputError
        If it cannot be read or is not one.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), [Mistake("", f"cannot be read: {error.strerror}")]) from None
    except ValueError as error:
        raise InputError(str(path), [Mistake("", f"is not JSON: {error}")]) from None
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise InputError(str(path), [Mistake("schema", f"is not {SCHEMA}; name a design.json of `vctune solve`")])
    missing = [table for table in TABLES if table not in record]
    if missing or not isinstance(record["problem"], dict) or "text" not in record["problem"]:
        lacking = ", ".join(missing) or "problem.text"
        raise InputError(str(path), [Mistake("", f"lacks {lacking}; solve the problem again")])
    return record
