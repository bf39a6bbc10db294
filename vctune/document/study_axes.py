"""Read the axes of a study: numbers of a problem by dotted key, and their values."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from math import inf
from typing import Any, Literal

from vctune.document.schema.problem_schema import json_schema
from vctune.document.schema.study_schema import MOST_VALUES
from vctune.document.schema.validation import Contradiction, KeyPath, dotted, shown

Scale = Literal["list", "linear", "log"]
SPANS: tuple[Scale, ...] = ("linear", "log")  # Rules that divide a range
MOST = 1e300  # Greatest finite magnitude of a value
FORMS = "write a list of numbers, { linear = [a, b], n = ... } or { log = [a, b], n = ... }"


@dataclass(frozen=True, slots=True)
class Axis:
    """One number of the problem that varies."""

    key: str  # dotted key
    path: KeyPath  # path of the key in the problem
    scale: Scale  # "list", or the rule that divides a range
    values: tuple[float, ...]  # values of a list, or the two ends of a range, in the unit of the problem file
    n: int | None  # number of values; None for a range that is only sampled


def number_keys() -> dict[str, KeyPath]:
    """Return the dotted keys of all numbers that a problem file may have, with their paths."""
    return _keys_of("number") | whole_number_keys()


def whole_number_keys() -> dict[str, KeyPath]:
    """Return the dotted keys of the numbers that must be whole, with their paths."""
    return _keys_of("integer")


@cache
def _keys_of(kind: str) -> dict[str, KeyPath]:
    """Return the dotted keys of one type of the schema, with their paths."""
    schema = json_schema()

    def walk(entry: dict[str, Any], path: KeyPath) -> Iterator[KeyPath]:
        if "$ref" in entry:
            entry = schema["$defs"][entry["$ref"].removeprefix("#/$defs/")]
        if entry.get("type") == kind:
            yield path
        for form in entry.get("oneOf", []):
            yield from walk(form, path)
        for i, element in enumerate(entry.get("prefixItems", [])):
            yield from walk(element, (*path, i))
        for name, child in entry.get("properties", {}).items():
            yield from walk(child, (*path, name))

    return {dotted(path): path for path in walk(schema, ())}


def read_axis(key: str, value: Any, *, sampled: bool) -> tuple[Axis | None, list[Contradiction]]:
    """Return the axis that a study states under a key and no faults, or None and its faults."""
    at: KeyPath = ("axes", key)
    path = number_keys().get(re.sub(r"\s", "", key))
    faults = [] if path is not None else [(at, _unknown(key, value))]
    if path is None and isinstance(value, dict) and not set(value) & {*SPANS, "n"}:
        return None, faults
    scale: Scale = "list"
    n: int | None = None
    numbers: list[Any] = []
    if isinstance(value, list):
        faults += _list_faults(at, value)
        numbers, n = value, len(value)
    elif isinstance(value, dict):
        found, scale, numbers, n = _range(at, value, sampled=sampled)
        faults += found
    else:
        faults.append((at, f"{shown(value)} is no set of values; {FORMS}"))
    if path is not None and dotted(path) in whole_number_keys():
        faults += _not_whole(at, scale, numbers)
    if faults or path is None:
        return None, faults
    number = int if dotted(path) in whole_number_keys() else float
    return Axis(dotted(path), path, scale, tuple(map(number, numbers)), n), []


def _not_whole(at: KeyPath, scale: Scale, numbers: list[Any]) -> list[Contradiction]:
    """Return why the values of an axis are not whole numbers."""
    if scale != "list":
        return [(at, "is a whole number, and a range has others between its ends; write a list of whole numbers")]
    fractions = ((i, number) for i, number in enumerate(numbers) if _is_number(number) and number % 1 != 0)
    return [((*at, i), f"{shown(number)} is not a whole number") for i, number in fractions]


def _unknown(key: str, value: Any) -> str:
    """Return the message on a key that is not a number of a problem, with the key that was probably meant."""
    if isinstance(value, dict) and any(isinstance(step, str) and step.startswith(f"{key}.") for step in number_keys()):
        inner = next(iter(value), "")
        return f'is a table of the problem; write the whole key in quotes, "{key}.{inner}" = ...'
    elements = [key_of_element for key_of_element in number_keys() if key_of_element.startswith(f"{key}[")]
    if elements:
        return f'is a list; write "{elements[0]}" or "{elements[-1]}"'
    similar = get_close_matches(key, number_keys(), n=1, cutoff=0.6)
    hint = f'; did you mean "{similar[0]}"?' if similar else "; `vctune schema` lists the keys"
    return f"is no number of a problem file{hint}"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and (value == inf or abs(value) <= MOST)


def _list_faults(at: KeyPath, values: list[Any]) -> list[Contradiction]:
    if not values:
        return [(at, "is empty; give it at least one value")]
    return [((*at, i), f"{shown(value)} is not a number") for i, value in enumerate(values) if not _is_number(value)]


def _range(
    at: KeyPath, table: dict[str, Any], *, sampled: bool
) -> tuple[list[Contradiction], Scale, list[Any], int | None]:
    """Return the faults of { linear or log = [a, b], n }, and the scale, the ends and n."""
    faults: list[Contradiction] = []
    for name in table:
        if name not in (*SPANS, "n"):
            meant = get_close_matches(name, (*SPANS, "n"), n=1, cutoff=0.4)
            faults.append(((*at, name), f"unknown key; {f'did you mean {meant[0]}?' if meant else FORMS}"))
    scales = [scale for scale in SPANS if scale in table]
    if len(scales) != 1:
        return [*faults, (at, f"has {'both' if scales else 'neither'} linear and log; {FORMS}")], "list", [], None
    scale, ends, n = scales[0], table[scales[0]], table.get("n")
    place: KeyPath = (*at, scale)
    if not (isinstance(ends, list) and len(ends) == 2 and all(_is_number(end) and abs(end) < inf for end in ends)):
        faults.append((place, f"{shown(ends)} is not a pair of numbers [from, to]"))
    elif ends[0] >= ends[1]:
        faults.append((place, f"{ends[0]:g} is not below {ends[1]:g}; swap or widen the ends"))
    elif scale == "log" and ends[0] <= 0:
        faults.append((place, f"{ends[0]:g} has no logarithm; start above 0 or use linear"))
    if n is None and not sampled:
        faults.append((at, "lacks n, the number of values"))
    elif n is not None and (not isinstance(n, int) or isinstance(n, bool) or not 2 <= n <= MOST_VALUES):
        faults.append(((*at, "n"), f"{shown(n)} is not a whole number from 2 to {MOST_VALUES}"))
    return faults, scale, ends, n
