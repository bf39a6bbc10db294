"""The values of a record, by their paths in its JSON Schema, beside what an oracle says that they mean."""

from __future__ import annotations

from collections.abc import Iterator
from math import isclose
from typing import Any

import meaning
from meaning import Case, Holds, Said, Within

Schema = dict[str, Any]


def _resolved(schema: Schema, root: Schema) -> Schema:
    while "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    return schema


def _choices(schema: Schema, root: Schema) -> list[Schema]:
    of = schema.get("anyOf", schema.get("oneOf"))
    return [schema] if of is None else [found for each in of for found in _choices(_resolved(each, root), root)]


def paths(schema: Schema, root: Schema | None = None, path: str = "") -> Iterator[str]:
    """Yield the path of each leaf: keys joined by dots, `[]` for an element, `{}` for a key that is free."""
    root = schema if root is None else root
    for each in _choices(_resolved(schema, root), root):
        kind, free = each.get("type"), each.get("additionalProperties")
        if kind == "array":
            items = [*each.get("prefixItems", []), *([each["items"]] if "items" in each else [])]
            for item in items:
                yield from paths(item, root, f"{path}[]")
        elif "properties" in each or isinstance(free, dict):
            for name, part in each.get("properties", {}).items():
                yield from paths(part, root, f"{path}.{name}" if path else name)
            if isinstance(free, dict):
                yield from paths(free, root, f"{path}.{{}}")
        elif kind != "null":
            yield path


def _fits(value: Any, schema: Schema) -> bool:
    kind = schema.get("type")
    if isinstance(value, dict):
        return kind == "object" and set(schema.get("required", ())) <= value.keys()
    return kind == "array" if isinstance(value, list) else kind not in ("object", "array")


def leaves(
    value: Any, schema: Schema, root: Schema | None = None, part: Any = None, path: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """Yield the path of each leaf of an object, the part that holds it (above lists and free keys), and its value."""
    root = schema if root is None else root
    part = value if part is None else part
    fitting = [each for each in _choices(_resolved(schema, root), root) if _fits(value, each)]
    if value is None or not fitting:
        yield path, part, value
        return
    each = fitting[0]
    if isinstance(value, list):
        for k, item in enumerate(value):
            items = [*each.get("prefixItems", []), *([each["items"]] if "items" in each else [])]
            yield from leaves(item, items[min(k, len(items) - 1)] if items else {}, root, part, f"{path}[]")
    elif isinstance(value, dict):
        known, free = each.get("properties", {}), each.get("additionalProperties")
        if not known and not isinstance(free, dict):
            yield path, part, value
        for name, item in value.items():
            if name in known:
                yield from leaves(item, known[name], root, value, f"{path}.{name}" if path else name)
            elif isinstance(free, dict):
                yield from leaves(item, free, root, part, f"{path}.{{}}")
    else:
        yield path, part, value


def agrees(expected, value):
    """Return whether a value is the expected one."""
    if isinstance(expected, Holds):
        return bool(expected.value)
    if isinstance(expected, Said):
        return expected.value == value
    if value is None or isinstance(value, str):
        return False
    if isinstance(expected, Within):
        near = 1e-9 * max(abs(expected.low), abs(expected.high))
        return expected.low - near <= value <= expected.high + near
    return isclose(value, getattr(expected, "value", expected), rel_tol=getattr(expected, "rel", 1e-6))


def wrong(case: Case, table, schema, record=None) -> list[str]:
    """Return what is not as its oracle says, in the record of a case or in another."""
    found, known = [], {}
    for path, part, value in leaves(case.record if record is None else record, schema):
        oracle = table.get(path)
        if not callable(oracle) or (value is None and path not in meaning.NULL_IS_SAID):
            continue
        known.setdefault((path, id(part)), None)
        known[path, id(part)] = expected = known[path, id(part)] or oracle(case, part)
        if not agrees(expected, value):
            found.append(f"{path} is {value}, and {expected} is meant")
    return found
