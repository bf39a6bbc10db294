"""Read the study file: a problem, the numbers that vary, and how they form points."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import combinations, pairwise
from math import prod
from pathlib import Path
from typing import Any, Literal

from vctune.document.building import plain
from vctune.document.reading import ProblemFile, pose
from vctune.document.schema.problem_schema import ProblemDocument
from vctune.document.schema.statement import statement
from vctune.document.schema.study_schema import StudyDocument
from vctune.document.schema.validation import Contradiction, Fault, KeyPath, dotted, examined, refusal
from vctune.document.study_axes import Axis, read_axis
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.document.text.raw import placed
from vctune.model.problem import Problem

# Written form that the problem must use for a key so that one of its elements or ends can vary
FORM_OF = dict.fromkeys((0, 1), "[lower, upper]") | dict.fromkeys(("min", "max"), "{ min = ..., max = ... }")


@dataclass(frozen=True, slots=True)
class Sample:
    """The rule by which the axes form points."""

    kind: Literal["grid", "lhs", "list"] = "grid"
    n: int = 0  # number of points and seed of a Latin hypercube; 0 for the other kinds
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Study:
    """A problem solved at many points."""

    name: str  # name of the study
    document: dict[str, Any]  # parsed problem file
    axes: tuple[Axis, ...]  # axes that vary
    yardstick: Problem
    sample: Sample = Sample()  # how the axes form points

    @property
    def count(self) -> int:
        """The number of points."""
        if self.sample.kind == "lhs":
            return self.sample.n
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
        return _posed(self.document, self.axes, values, self.yardstick)

    def extremes(self) -> Iterator[Problem]:
        """Yield, for each axis, the problem with the axis at its greatest value and all other axes at their first
        values. Points without a valid problem are left out."""
        first = [axis.values[0] for axis in self.axes]
        for place, axis in enumerate(self.axes):
            problem, _ = self.at([*first[:place], max(axis.values), *first[place + 1 :]])
            if problem is not None:
                yield problem

    def at(self, values: Sequence[float]) -> tuple[Problem | None, list[Fault]]:
        """Return the problem at a point, or None, and its faults."""
        return pose(self.posed(values), self.name, self.yardstick)


def read_study(path: Path) -> Study:
    """Read a study file and the problem file that it names."""
    text = toml.read_text(path)
    document, faults = examined(StudyDocument, toml.parse(text, str(path)), _contradictions)
    if document is None or faults:
        raise refusal(faults, text, str(path))
    target = path.parent / document.problem
    try:
        problem_text = toml.read_text(target)
    except InputError as error:
        unread = Fault(("problem",), f"{target}: {error.mistakes[0].message}", "unreadable-file")
        raise refusal([unread], text, str(path)) from None
    name = path.stem.encode("utf-8", "replace").decode()
    problem, (axes, sample) = toml.parse(problem_text, str(target)), _planned(document)
    homeless = [fault for axis in axes for fault in _homeless(problem, axis)]
    if homeless:
        raise refusal(homeless, text, str(path))
    problem_faults = _problem_faults(problem, axes)
    if problem_faults:
        raise refusal(problem_faults, problem_text, str(target))
    yardstick, faults = _yardstick(problem, axes)
    if yardstick is None:
        raise refusal(faults, text, str(path))
    return Study(name, problem, axes, yardstick, sample)


def build_study(
    problem: ProblemFile, axes: Mapping[str, Any], sample: Mapping[str, Any] | None = None, name: str = "study"
) -> Study:
    """Return the study of a problem. Axes and sample have the form of a study file's tables."""
    raw = {"problem": problem.problem.name, "axes": plain(axes), "sample": plain(sample or {})}
    document, faults = examined(StudyDocument, raw, _contradictions)
    if document is None or faults:
        raise refusal(faults, None, name)
    tables, (axes_, sample_) = problem.document, _planned(document)
    homeless = [fault for axis in axes_ for fault in _homeless(tables, axis)]
    if homeless:
        raise refusal(homeless, None, name)
    return Study(name, tables, axes_, problem.problem, sample_)


def _planned(document: StudyDocument) -> tuple[tuple[Axis, ...], Sample]:
    """Return the axes and the sample of a valid study document."""
    sampled = document.sample.kind == "lhs"
    axes = [read_axis(key, value, sampled=sampled)[0] for key, value in document.axes.items()]
    sample = Sample(document.sample.kind, document.sample.n or 0, document.sample.seed or 0)
    return tuple(axis for axis in axes if axis), sample


def _posed(
    document: dict[str, Any], axes: Sequence[Axis], values: Iterable[float], yardstick: Problem | None = None
) -> dict[str, Any]:
    """Return the document with the values of the axes, as `Study.posed` describes it."""
    varied = dict(zip((axis.path for axis in axes), values, strict=True))
    defaults = dict.fromkeys(path[:-1] for path in varied if _is_default(document, path, varied))
    if not defaults:
        return placed(document, varied.items())
    others = placed(document, ((path, value) for path, value in varied.items() if path[:-1] not in defaults))
    problem, _ = pose(others, "study", yardstick)
    if problem is None:
        return others
    stated = statement(problem)
    filled = placed(others, ((path, _at(stated, path)) for path in defaults))
    return placed(filled, ((path, value) for path, value in varied.items() if path[:-1] in defaults))


def _contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the faults of each axis, of axes that conflict, and of axes that do not fit the sample."""
    table, sample = (part if isinstance(part, dict) else {} for part in (raw.get("axes"), raw.get("sample")))
    kind = sample.get("kind", "grid")
    faults: list[Contradiction] = []
    axes = []
    for key, value in table.items():
        axis, found = read_axis(key, value, sampled=kind == "lhs")
        faults += found
        axes += [axis] if axis else []
    for first_axis, second_axis in combinations(axes, 2):
        if (
            first_axis.path == second_axis.path[: len(first_axis.path)]
            or second_axis.path == first_axis.path[: len(second_axis.path)]
        ):
            faults.append(
                (("axes", second_axis.key), f"varies the same number as {first_axis.key}; leave one of them out")
            )
    if kind == "list":
        lists = [axis for axis in axes if axis.scale == "list"]
        faults += [
            (("axes", axis.key), "is a range; points side by side need lists") for axis in axes if axis not in lists
        ]
        faults += [
            (
                ("axes", axis.key),
                f"has {axis.n} values, {lists[0].key} has {lists[0].n}; side by side they need as many",
            )
            for axis in lists
            if axis.n != lists[0].n
        ]
    if kind == "lhs" and "n" not in sample:
        faults.append((("sample",), "a Latin hypercube needs n, the number of points"))
    if kind in ("grid", "list"):
        faults += [(("sample", key), 'is of kind = "lhs"; leave it out') for key in ("n", "seed") if key in sample]
    return faults


def _homeless(problem: dict[str, Any], axis: Axis) -> list[Fault]:
    """Return why the problem has no place for an axis; empty if it has."""
    node: Any = problem
    for i, (step, inner) in enumerate(pairwise(axis.path), 1):
        owner, form = dotted(axis.path[:i]), FORM_OF.get(inner, "a table")
        if step not in node and inner in FORM_OF:
            return []
        node = node.get(step, {})
        if not isinstance(node, list if isinstance(inner, int) else dict) or (
            isinstance(inner, int) and len(node) != 2
        ):
            return [_no_place(axis, f"{owner} in the problem is not {form}")]
    return []


def _is_default(document: dict[str, Any], path: KeyPath, varied: Mapping[KeyPath, float]) -> bool:
    """Return whether a path leads to the only varied end of a band or range that the document leaves at its default."""
    varied_ends = {other[-1] for other in varied if other[:-1] == path[:-1]}
    return path[-1] in FORM_OF and len(varied_ends) == 1 and _at(document, path[:-1]) is None


def _at(document: dict[str, Any], path: KeyPath) -> Any:
    """Return the value at a path of keys; None if there is no value."""
    node: Any = document
    for step in path:
        node = node.get(step) if isinstance(node, dict) else None
    return node


def _no_place(axis: Axis, message: str) -> Fault:
    return Fault(("axes", axis.key), message, "contradiction")


def _first(problem: dict[str, Any], axes: Sequence[Axis]) -> dict[str, Any]:
    """Return the problem with the first value of each axis."""
    return _posed(problem, axes, (axis.values[0] for axis in axes))


def _yardstick(problem: dict[str, Any], axes: Sequence[Axis]) -> tuple[Problem | None, list[Fault]]:
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
    """Return those faults of single keys of the problem that do not depend on the axes. Contradictions are not among
    them."""
    _, faults = examined(ProblemDocument, _first(problem, axes), lambda _raw: [])

    def varied(path: KeyPath) -> bool:
        return any(path == axis.path[: len(path)] or axis.path == path[: len(axis.path)] for axis in axes)

    return [fault for fault in faults if not varied(fault.path)]
