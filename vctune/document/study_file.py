"""Read the study file: a problem, the numbers that vary, and how they form points."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from hashlib import sha256
from itertools import combinations, pairwise
from math import inf, prod
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from vctune.document.building import plain
from vctune.document.reading import ProblemFile, on_yardstick, pose
from vctune.document.schema.problem_schema import ProblemDocument, Table, json_schema
from vctune.document.schema.statement import statement
from vctune.document.schema.validation import Contradiction, Fault, KeyPath, dotted, examined, refusal, shown
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.document.text.toml import placed
from vctune.model.fields import Text
from vctune.model.problem import Problem, Transparency

Scale = Literal["list", "linear", "log"]
MOST_VALUES = 10_000_000  # Greatest number of values of an axis, and of points of a Latin hypercube
MOST = 1e300  # Greatest finite magnitude of a value
FORMS = "write a list of numbers, { linear = [a, b], n = ... } or { log = [a, b], n = ... }"
# Written form that the problem must use for a key so that one of its elements or ends can vary
FORM_OF = dict.fromkeys((0, 1), "[lower, upper]") | dict.fromkeys(("min", "max"), "{ min = ..., max = ... }")


class Sample(Table):
    """The rule by which the axes form points."""

    kind: Literal["grid", "lhs", "list"] = Field(
        "grid",
        description="Sampling rule: every combination of values, a Latin hypercube, or the lists of the axes "
        "element by element.",
    )
    n: Annotated[int, Field(strict=True, ge=1, le=MOST_VALUES)] | None = Field(
        None, description="Number of points of a Latin hypercube."
    )
    seed: Annotated[int, Field(strict=True, ge=0)] | None = Field(
        None, description="Random seed of a Latin hypercube. Default 0."
    )


class StudyDocument(Table):
    """A vctune study file: a problem solved at many points."""

    problem: Text = Field(min_length=1, description="Path of the problem file, relative to the study file's folder.")
    axes: dict[str, Any] = Field(
        min_length=1,
        description='Numbers of the problem that vary, by dotted key. "stability.band_hz[1]" is the key of an '
        "element of a list. Each is a list of numbers, { linear = [a, b], n = ... } or { log = [a, b], n = ... }.",
    )
    sample: Sample = Sample()


@dataclass(frozen=True, slots=True)
class Axis:
    """One number of the problem that varies."""

    key: str  # dotted key
    path: KeyPath  # path of the key in the problem
    scale: Scale  # "list", or the rule that divides a range
    values: tuple[float, ...]  # values of a list, or the two ends of a range, in the unit of the problem file
    n: int | None  # number of values; None for a range that is only sampled


@dataclass(frozen=True, slots=True)
class Study:
    """A problem solved at many points."""

    name: str  # name of the study
    document: dict[str, Any]  # parsed problem file, with the yardstick stated
    axes: tuple[Axis, ...]  # axes that vary
    yardstick: Transparency  # scale of the errors, unless an axis states its values
    sample: Sample  # how the axes form points

    @property
    def count(self) -> int:
        """The number of points."""
        if self.sample.kind == "lhs":
            return self.sample.n or 0
        sizes = [axis.n or 0 for axis in self.axes]
        return prod(sizes) if self.sample.kind == "grid" else sizes[0]

    @property
    def sha256(self) -> str:
        """The digest that ties rows to their study."""
        content = {key: value for key, value in self.document.items() if key not in ("name", "description")}
        text = json.dumps([content, [axis.key for axis in self.axes]], sort_keys=True, default=str)
        return sha256(text.encode()).hexdigest()

    def posed(self, values: Iterable[float]) -> dict[str, Any]:
        """Return the document of the problem at a point. The document may be invalid."""
        return _posed(self.document, self.axes, values)

    def extremes(self) -> Iterator[Problem]:
        """Yield, for each axis, the problem at its greatest value and the first values of the others, if it is one."""
        first = [axis.values[0] for axis in self.axes]
        for place, axis in enumerate(self.axes):
            problem, _ = self.at([*first[:place], max(axis.values), *first[place + 1 :]])
            if problem is not None:
                yield problem

    def at(self, values: Sequence[float]) -> tuple[Problem | None, list[Fault]]:
        """Return the problem at a point, or None, and its faults."""
        return pose(self.posed(values), self.name)


def read_study(path: Path) -> Study:
    """Read a study file and the problem file that it names."""
    text = toml.read_text(path)
    axes, document = _planned(toml.parse(text, str(path)), text, str(path))
    target = path.parent / document.problem
    try:
        problem_text = toml.read_text(target)
    except InputError as error:
        unread = Fault(("problem",), f"{target}: {error.mistakes[0].message}", "unreadable-file")
        raise refusal([unread], text, str(path)) from None
    problem = toml.parse(problem_text, str(target))
    _check_places(problem, axes, text, str(path))
    if faults := _problem_faults(problem, axes):
        raise refusal(faults, problem_text, str(target))
    base, faults = _base(problem, axes)
    if base is None:
        raise refusal(faults, text, str(path))
    return _study(path.stem.encode("utf-8", "replace").decode(), problem, axes, base, document.sample)


def _study(name: str, problem: dict[str, Any], axes: tuple[Axis, ...], base: Problem, sample: Sample) -> Study:
    return Study(name, on_yardstick(problem, base), axes, base.transparency, sample)


def build_study(
    problem: ProblemFile, axes: Mapping[str, Any], sample: Mapping[str, Any] | None = None, name: str = "study"
) -> Study:
    """Return the study of a problem. Axes and sample have the form of a study file's tables."""
    raw = {"problem": problem.problem.name, "axes": plain(axes), "sample": plain(sample or {})}
    planned, document = _planned(raw, None, name)
    _check_places(problem.document, planned, None, name)
    return _study(name, problem.document, planned, problem.problem, document.sample)


def _planned(raw: dict[str, Any], text: str | None, source: str) -> tuple[tuple[Axis, ...], StudyDocument]:
    """Return the axes and the document of a study, or refuse it."""
    document, faults = examined(StudyDocument, raw, _contradictions)
    if document is None or faults:
        raise refusal(faults, text, source)
    axes = [read_axis(key, value, sampled=document.sample.kind == "lhs")[0] for key, value in document.axes.items()]
    return tuple(axis for axis in axes if axis), document


def number_keys() -> dict[str, KeyPath]:
    """Return the dotted keys of all numbers that a problem file may have, with their paths."""
    return _keys_of("number") | _keys_of("integer")


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
        for step, inner in (*enumerate(entry.get("prefixItems", [])), *entry.get("properties", {}).items()):
            yield from walk(inner, (*path, step))

    return {dotted(path): path for path in walk(schema, ())}


def read_axis(key: str, value: Any, *, sampled: bool) -> tuple[Axis | None, list[Contradiction]]:
    """Return the axis that a study states under a key and no faults, or None and its faults."""
    at: KeyPath = ("axes", key)
    path = number_keys().get(re.sub(r"\s", "", key))
    faults = [] if path is not None else [(at, _unknown(key, value))]
    if path is None and isinstance(value, dict) and not set(value) & {"linear", "log", "n"}:
        return None, faults
    scale, numbers, n = _values(value)
    faults += _list_faults(at, numbers) if isinstance(value, list) else _range_faults(at, value, sampled=sampled)
    whole = path is not None and dotted(path) in _keys_of("integer")
    if whole and scale != "list":
        faults.append((at, "is a whole number, and a range has others between its ends; write a list of whole numbers"))
    elif whole:
        fractions = ((i, number) for i, number in enumerate(numbers) if _is_number(number) and number % 1 != 0)
        faults += [((*at, i), f"{shown(number)} is not a whole number") for i, number in fractions]
    if faults or path is None:
        return None, faults
    return Axis(dotted(path), path, scale, tuple(map(int if whole else float, numbers)), n), []


def _values(value: Any) -> tuple[Scale, list[Any], int | None]:
    """Return the scale of an axis, its values or ends, and their number, of a value that may be invalid."""
    if isinstance(value, list):
        return "list", value, len(value)
    scale: Scale = "log" if isinstance(value, dict) and "log" in value else "linear"
    return (scale, value.get(scale, []), value.get("n")) if isinstance(value, dict) else ("list", [], None)


def _unknown(key: str, value: Any) -> str:
    """Return the message on a key that is not a number of a problem, with the key that was probably meant."""
    keys = number_keys()
    if isinstance(value, dict) and any(known.startswith(f"{key}.") for known in keys):
        return f'is a table of the problem; write the whole key in quotes, "{key}.{next(iter(value), "")}" = ...'
    elements = [known for known in keys if known.startswith(f"{key}[")]
    if elements:
        return f'is a list; write "{elements[0]}" or "{elements[-1]}"'
    similar = get_close_matches(key, keys, n=1, cutoff=0.6)
    hint = f'; did you mean "{similar[0]}"?' if similar else "; `vctune schema` lists the keys"
    return f"is no number of a problem file{hint}"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and (value == inf or abs(value) <= MOST)


def _list_faults(at: KeyPath, values: list[Any]) -> list[Contradiction]:
    if not values:
        return [(at, "is empty; give it at least one value")]
    return [((*at, i), f"{shown(value)} is not a number") for i, value in enumerate(values) if not _is_number(value)]


def _range_faults(at: KeyPath, table: Any, *, sampled: bool) -> list[Contradiction]:
    """Return the faults of { linear or log = [a, b], n }."""
    if not isinstance(table, dict):
        return [(at, f"{shown(table)} is no set of values; {FORMS}")]
    names, faults = ("linear", "log", "n"), list[Contradiction]()
    for name in (name for name in table if name not in names):
        meant = get_close_matches(name, names, n=1, cutoff=0.4)
        faults.append(((*at, name), f"unknown key; {f'did you mean {meant[0]}?' if meant else FORMS}"))
    scales = [scale for scale in names[:2] if scale in table]
    if len(scales) != 1:
        return [*faults, (at, f"has {'both' if scales else 'neither'} linear and log; {FORMS}")]
    scale, ends, n = scales[0], table[scales[0]], table.get("n")
    if not (isinstance(ends, list) and len(ends) == 2 and all(_is_number(end) and abs(end) < inf for end in ends)):
        faults.append(((*at, scale), f"{shown(ends)} is not a pair of numbers [from, to]"))
    elif ends[0] >= ends[1]:
        faults.append(((*at, scale), f"{ends[0]:g} is not below {ends[1]:g}; swap or widen the ends"))
    elif scale == "log" and ends[0] <= 0:
        faults.append(((*at, scale), f"{ends[0]:g} has no logarithm; start above 0 or use linear"))
    if n is None and not sampled:
        faults.append((at, "lacks n, the number of values"))
    elif n is not None and (not isinstance(n, int) or isinstance(n, bool) or not 2 <= n <= MOST_VALUES):
        faults.append(((*at, "n"), f"{shown(n)} is not a whole number from 2 to {MOST_VALUES}"))
    return faults


def _contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the faults of each axis, of axes that conflict, and of axes that do not fit the sample."""
    table, sample = (part if isinstance(part, dict) else {} for part in (raw.get("axes"), raw.get("sample")))
    kind = sample.get("kind", "grid")
    read = [read_axis(key, value, sampled=kind == "lhs") for key, value in table.items()]
    axes, faults = [axis for axis, _ in read if axis], [fault for _, found in read for fault in found]
    for one, other in combinations(axes, 2):
        if all(a == b for a, b in zip(one.path, other.path, strict=False)):
            faults.append((("axes", other.key), f"varies the same number as {one.key}; leave one of them out"))
    lists = [axis for axis in axes if axis.scale == "list"]
    for axis in axes if kind == "list" else ():
        if axis.scale != "list":
            faults.append((("axes", axis.key), "is a range; points side by side need lists"))
        elif axis.n != lists[0].n:
            of_first = f"{lists[0].key} has {lists[0].n}; side by side they need as many"
            faults.append((("axes", axis.key), f"has {axis.n} values, {of_first}"))
    if kind == "lhs" and "n" not in sample:
        faults.append((("sample",), "a Latin hypercube needs n, the number of points"))
    if kind in ("grid", "list"):
        faults += [(("sample", key), 'is of kind = "lhs"; leave it out') for key in ("n", "seed") if key in sample]
    return faults


def _check_places(problem: dict[str, Any], axes: Sequence[Axis], text: str | None, source: str) -> None:
    """Refuse the axes for which the problem has no place."""
    homeless = [(axis, message) for axis in axes if (message := _without_place(problem, axis))]
    if homeless:
        faults = [Fault(("axes", axis.key), message, "contradiction") for axis, message in homeless]
        raise refusal(faults, text, source)


def _without_place(node: Any, axis: Axis) -> str:
    """Return why a problem has no place for an axis; "" if it has one."""
    for i, (step, inner) in enumerate(pairwise(axis.path), 1):
        if step not in node and inner in FORM_OF:
            return ""
        node, pair = node.get(step, {}), isinstance(inner, int)
        if not isinstance(node, list if pair else dict) or (pair and len(node) != 2):
            return f"{dotted(axis.path[:i])} in the problem is not {FORM_OF.get(inner, 'a table')}"
    return ""


def _posed(document: dict[str, Any], axes: Sequence[Axis], values: Iterable[float]) -> dict[str, Any]:
    """Return the document, which may be invalid, with the values of the axes.

    A range of which one end alone varies, and which the document leaves at its default, gets the other end of the
    default at the point.
    """
    varied = dict(zip((axis.path for axis in axes), values, strict=True))
    owners = [path[:-1] for path in varied if path[-1] in FORM_OF and _at(document, path[:-1]) is None]
    defaults = {owner for owner in owners if owners.count(owner) == 1}
    others = placed(document, ((path, value) for path, value in varied.items() if path[:-1] not in defaults))
    problem, _ = pose(others, "study") if defaults else (None, [])
    if problem is not None:
        stated = statement(problem)
        others = placed(others, ((path, _at(stated, path)) for path in defaults))
    elif defaults:
        return others
    return placed(others, ((path, value) for path, value in varied.items() if path[:-1] in defaults))


def _at(document: dict[str, Any], path: KeyPath) -> Any:
    """Return the value at a path of keys; None if there is no value."""
    node: Any = document
    for step in path:
        node = node.get(step) if isinstance(node, dict) else None
    return node


def _first(problem: dict[str, Any], axes: Sequence[Axis]) -> dict[str, Any]:
    """Return the problem with the first value of each axis."""
    return _posed(problem, axes, (axis.values[0] for axis in axes))


def _base(problem: dict[str, Any], axes: Sequence[Axis]) -> tuple[Problem | None, list[Fault]]:
    """Return the problem without axes or, if it is invalid, the problem at the first value of each axis."""
    for document in (problem, _first(problem, axes)):
        found, faults = pose(document, "study")
        if found is not None:
            return found, []
    message = (
        "neither the problem alone nor that at the first value of each axis is one, which all errors could be compared "
        f"on: {dotted(faults[0].path)}: {faults[0].message}; begin with values that are possible"
    )
    return None, [Fault(("axes",), message, "contradiction")]


def _problem_faults(problem: dict[str, Any], axes: Sequence[Axis]) -> list[Fault]:
    """Return those faults of single keys of the problem that do not depend on the axes, without contradictions."""
    _, faults = examined(ProblemDocument, _first(problem, axes), lambda _raw: [])

    def varied(path: KeyPath) -> bool:
        return any(all(a == b for a, b in zip(path, axis.path, strict=False)) for axis in axes)

    return [fault for fault in faults if not varied(fault.path)]
