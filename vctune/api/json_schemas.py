"""The JSON Schema of each kind of file, from the class that reads and writes it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vctune.design.records.design import DesignRecord
from vctune.document.records.identification_json import IdentificationRecord
from vctune.document.records.part import Document
from vctune.document.records.region_json import RegionDocument
from vctune.document.schema.log_schema import LogDocument
from vctune.document.schema.problem_schema import GainsDocument, ServoGainsDocument, SpringGainsDocument, json_schema
from vctune.document.schema.study_schema import StudyDocument
from vctune.document.schema.validation import DIALECT, schema_of
from vctune.simulation.simulation_record import SimulationRecord
from vctune.study.row_record import RowRecord, RowsHeader


def _of(*parts: type[Document] | type[RowRecord]) -> dict[str, Any]:
    """Return the schema of an object that is one of several records."""
    schemas = []
    for part in parts:
        schema = part.model_json_schema()
        if issubclass(part, Document):
            schema["properties"] = {"schema": {"const": part.SCHEMA}, **schema["properties"]}
            schema["required"] = ["schema", *schema.get("required", [])]
        schemas.append(schema)
    return _one_of(schemas)


def _one_of(schemas: list[dict[str, Any]], **also: str) -> dict[str, Any]:
    definitions = {name: found for schema in schemas for name, found in schema.pop("$defs", {}).items()}
    one = schemas[0] if len(schemas) == 1 else {"anyOf": schemas}
    return {"$schema": DIALECT, **also, **one, "$defs": definitions}


def _of_gains() -> dict[str, Any]:
    """Return the schema of a gains file of any kind of display."""
    schemas = [schema_of(kind, kind.__name__) for kind in (GainsDocument, ServoGainsDocument, SpringGainsDocument)]
    kinds = [{key: value for key, value in schema.items() if key != "$schema"} for schema in schemas]
    return _one_of(kinds, title="vctune gains")


# Function that makes the schema, for each kind of file
SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "problem": json_schema,
    "gains": _of_gains,
    "study": lambda: schema_of(StudyDocument, "vctune study"),
    "log": lambda: schema_of(LogDocument, "vctune log"),
    "design": lambda: _of(DesignRecord),
    "region": lambda: _of(RegionDocument),
    "rows": lambda: _of(RowsHeader, RowRecord),
    "simulation": lambda: _of(SimulationRecord),
    "identification": lambda: _of(IdentificationRecord),
}
