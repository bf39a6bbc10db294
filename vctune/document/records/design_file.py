"""Read the design file, the object that `vctune solve --json` prints (document/README.md, section 3)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vctune.document.records.design_json import DesignRecord
from vctune.document.text.json import as_record, read_json

MAX_BYTES = 10_000_000
KIND = "a design.json of `vctune solve`"


def read_design(path: Path) -> DesignRecord:
    """Return the record in a design.json."""
    return design_of(read_json(path, KIND, MAX_BYTES), str(path))


def design_of(value: Any, source: str) -> DesignRecord:
    """Return the record in the object of a design.json."""
    return as_record(value, DesignRecord, source, kind=KIND, remedy="solve the problem again")
