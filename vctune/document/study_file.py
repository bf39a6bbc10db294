"""Read the study file: a problem, the numbers that vary, and how they form points."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from hashlib import sha256
from itertools import combinations
from math import prod
from pathlib import Path
from typing import Any

from vctune.document.building import plain
from vctune.document.reading import ProblemFile, on_yardstick, problem_at
from vctune.document.schema.problem_schema import json_schema
from vctune.document.schema.statement import statement
from vctune.document.schema.study_schema import RangeTable, Sample, StudyDocument
from vctune.document.schema.validation import Contradiction, Fault, KeyPath, dotted, examined, refusal
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.document.text.toml import placed, value_at
from vctune.model.problem import Problem, Transparency

# Written form that the problem must use for a key so that one of its elements or ends can vary
FORM_OF = dict.fromkeys((0, 1), "[lower, upper]") | dict.fromkeys(("min", "max"), "{ min = ..., max = ... }")


@dataclass(frozen=True, slots=True)
class Axis:
    """One number of the problem that varies."""

    key: str  # dotted key
    path: KeyPath  # path of the key in the problem
    values: tuple[float, ...]  # values, in the unit of the problem file


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
        sizes = [len(axis.values) for axis in self.axes]
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
        return problem_at(self.posed(values), self.name)


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
    base, faults = problem_at(problem, "study")
    if base is None:
        base, faults = problem_at(_posed(problem, axes, (axis.values[0] for axis in axes)), "study")
    if base is None:
        if own := [fault for fault in faults if fault.code != "contradiction" and not _varied(fault.path, axes)]:
            raise refusal(own, problem_text, str(target))
        raise refusal([_without_yardstick(faults[0])], text, str(path))
    name = path.stem.encode("utf-8", "replace").decode()
    return Study(name, on_yardstick(problem, base), axes, base.transparency, document.sample)


def build_study(
    problem: ProblemFile, axes: Mapping[str, Any], sample: Mapping[str, Any] | None = None, name: str = "study"
) -> Study:
    """Return the study of a problem. Axes and sample have the form of a study file's tables."""
    raw = {"problem": problem.problem.name, "axes": plain(axes), "sample": plain(sample or {})}
    planned, document = _planned(raw, None, name)
    _check_places(problem.document, planned, None, name)
    base = problem.problem
    return Study(name, on_yardstick(problem.document, base), planned, base.transparency, document.sample)


def _planned(raw: dict[str, Any], text: str | None, source: str) -> tuple[tuple[Axis, ...], StudyDocument]:
    """Return the axes and the document of a study, or refuse it."""
    document, faults = examined(StudyDocument, raw)
    stated = raw.get("axes")
    paths = {key: number_keys().get("".join(key.split())) for key in stated} if isinstance(stated, dict) else {}
    unknown = {("axes", key): _unknown(key, raw["axes"][key]) for key, path in paths.items() if path is None}
    faults = [fault for fault in faults if fault.path[:2] not in unknown]
    faults += [Fault(path, message, "unknown-key") for path, message in unknown.items()]
    if document is None or faults:
        raise refusal(faults, text, source)
    axes = tuple(_axis(path, document.axes[key]) for key, path in paths.items() if path is not None)
    if between := list(_contradictions(axes, document)):
        raise refusal([Fault(*each, "contradiction") for each in between], text, source)
    return axes, document


def _axis(path: KeyPath, stated: list[float] | RangeTable) -> Axis:
    values = stated.values if isinstance(stated, RangeTable) else stated
    whole = dotted(path) in _keys_of("integer")
    return Axis(dotted(path), path, tuple(int(value) if whole and value % 1 == 0 else value for value in values))


def _contradictions(axes: Sequence[Axis], document: StudyDocument) -> Iterator[Contradiction]:
    """Yield the faults of axes that conflict, that are of whole numbers, or that do not fit the sample."""
    for one, other in combinations(axes, 2):
        if _varied(other.path, [one]):
            yield ("axes", other.key), f"varies the same number as {one.key}; leave one of them out"
    for axis, stated in zip(axes, document.axes.values(), strict=True):
        n, first = len(axis.values), len(axes[0].values)
        if axis.key in _keys_of("integer") and (broken := [value for value in axis.values if value % 1 != 0]):
            yield ("axes", axis.key), f"{broken[0]:g} is not a whole number; write a list of whole numbers"
        if document.sample.kind == "list" and isinstance(stated, RangeTable):
            yield ("axes", axis.key), "is a range; points side by side need lists"
        elif document.sample.kind == "list" and n != first:
            yield ("axes", axis.key), f"has {n} values, {axes[0].key} has {first}; side by side they need as many"


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


def _unknown(key: str, value: Any) -> str:
    """Return the message on a key that is not a number of a problem, with the key that was probably meant."""
    inner = next(iter(value), "") if isinstance(value, dict) else ""
    whole = key if inner in ("", "linear", "log", "n") else f"{key}.{inner}"
    similar = get_close_matches(whole, number_keys(), n=1)
    if not similar:
        return "is no number of a problem file; `vctune schema` lists the keys"
    quotes = " Write the whole key in quotes" if whole != key else ""
    return f'is no number of a problem file; did you mean "{similar[0]}"?{quotes}'


def _check_places(problem: dict[str, Any], axes: Sequence[Axis], text: str | None, source: str) -> None:
    """Refuse the axes for which the problem has no place."""
    faults = []
    for axis in axes:
        for i, step in enumerate(axis.path[1:], 1):
            node, pair = value_at(problem, axis.path[:i]), isinstance(step, int)
            if node is not None and (not isinstance(node, list if pair else dict) or (pair and len(node) != 2)):
                message = f"{dotted(axis.path[:i])} in the problem is not {FORM_OF.get(step, 'a table')}"
                faults.append(Fault(("axes", axis.key), message, "contradiction"))
    if faults:
        raise refusal(faults, text, source)


def _posed(document: dict[str, Any], axes: Sequence[Axis], values: Iterable[float]) -> dict[str, Any]:
    """Return the document, which may be invalid, with the values of the axes.

    A range of which one end alone varies, and which the document leaves at its default, gets the other end of the
    default at the point.
    """
    varied = dict(zip((axis.path for axis in axes), values, strict=True))
    owners = [path[:-1] for path in varied if path[-1] in FORM_OF and value_at(document, path[:-1]) is None]
    defaults = {owner for owner in owners if owners.count(owner) == 1}
    others = placed(document, ((path, value) for path, value in varied.items() if path[:-1] not in defaults))
    problem, _ = problem_at(others, "study") if defaults else (None, [])
    if problem is not None:
        stated = statement(problem)
        others = placed(others, ((path, value_at(stated, path)) for path in defaults))
    elif defaults:
        return others
    return placed(others, ((path, value) for path, value in varied.items() if path[:-1] in defaults))


def _varied(path: KeyPath, axes: Sequence[Axis]) -> bool:
    """Return whether an axis varies a key, a part of it, or a table that contains it."""
    return any(all(a == b for a, b in zip(path, axis.path, strict=False)) for axis in axes)


def _without_yardstick(fault: Fault) -> Fault:
    """Return the fault of axes that give no problem on which all errors could be compared."""
    message = (
        "neither the problem alone nor that at the first value of each axis is one, which all errors could be compared "
        f"on: {dotted(fault.path)}: {fault.message}; begin with values that are possible"
    )
    return Fault(("axes",), message, "contradiction")
