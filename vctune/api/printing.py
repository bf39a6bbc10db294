"""What commands print: records, numbers as text, doubts about a problem, schemas."""

from __future__ import annotations

from typing import Any

from vctune.document.records.gains_json import SpringRecord as SpringRecord
from vctune.document.records.part import text as text
from vctune.document.records.printed_json import ExampleRecord as ExampleRecord
from vctune.document.records.printed_json import ReportRecord as ReportRecord
from vctune.document.records.simulation_json import simulation_of as simulation_of
from vctune.document.schema.plausibility import doubts as doubts


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of document."""
    from vctune.document.records.json_schemas import SCHEMAS

    return SCHEMAS[kind]()
