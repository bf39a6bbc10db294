"""Read problem files with several uncoupled axes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vctune.document.reading import ProblemFile, pose, problem_file
from vctune.document.schema.validation import Fault, KeyPath, refusal, shown
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.document.text.toml_writing import toml_text

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
NOT_OVERRIDDEN = ("name", "description", "experiment", "axis")  # Keys that an axis cannot override


@dataclass(frozen=True, slots=True)
class AxisProblem:
    """An axis of a problem file."""

    name: str  # name of the axis
    file: ProblemFile  # problem of the axis, named after the file and the axis; `text` states the merged tables
    line: int  # line of its name


@dataclass(frozen=True, slots=True)
class AxesFile:
    """A problem file with several axes.

    Attributes
    ----------
    name : name of the problem
    axes : axes in the file's order, at least one
    """

    name: str
    axes: tuple[AxisProblem, ...]


def read_axes(path: str | Path) -> AxesFile | None:
    """Read a problem file with several axes.

    Parameters
    ----------
    path : path of a file

    Returns
    -------
    AxesFile
        None if the path is no file with the suffix .toml, or if the file has no [[axis]] or is not TOML. `read_problem`
        then reads or refuses it.

    Raises
    ------
    InputError
        If the axes are invalid; the error lists the mistakes (`refusal`) with line, dotted key, value and remedy.
    """
    if not Path(path).is_file() or Path(path).suffix != ".toml":
        return None
    text = toml.read_text(Path(path))
    try:
        toml.parse(text, str(path))
    except InputError:
        return None
    return axes_file(text, Path(path))


def read_problem_or_axes(path: str | Path) -> ProblemFile | AxesFile:
    """Read a problem file with one or several axes; "-" is standard input.

    Parameters
    ----------
    path : path of a TOML file

    Returns
    -------
    ProblemFile or AxesFile
        An AxesFile if the file has any [[axis]].

    Raises
    ------
    InputError
        If the file cannot be read or is invalid; the error lists the mistakes (`refusal`) with line, dotted key, value
        and remedy.
    """
    text = toml.read_text(Path(path))
    return axes_file(text, Path(path)) or problem_file(text, Path(path))


def axes_file(text: str, path: Path) -> AxesFile | None:
    """Return the axes that the text of a file states."""
    path = toml.called(path)
    raw, source = toml.parse(text, str(path)), str(path)
    if "axis" not in raw:
        return None
    tables, faults = raw["axis"], [*_faults_of_list(raw["axis"])]
    if faults:
        raise refusal(faults, text, source)
    shared = {key: value for key, value in raw.items() if key != "axis"}
    name = raw.get("name") if isinstance(raw.get("name"), str) else path.stem
    lines, axes = toml.Lines(text), []
    faults_of_axes: list[list[Fault]] = []
    for index, table in enumerate(tables):
        axis_tables = {key: value for key, value in table.items() if key != "name"}
        axis_document = merged(shared, axis_tables) | {"name": f"{name} {table['name']}"}
        problem, axis_faults = pose(axis_document, path.stem)
        faults_of_axes.append([_placed(fault, shared, axis_tables, index) for fault in axis_faults])
        if problem is not None:
            line = lines.locate(("axis", index, "name")) or 1
            axes.append(AxisProblem(table["name"], ProblemFile(problem, toml_text(axis_document), source), line))
    if any(faults_of_axes):
        common_faults = set(pose(shared, path.stem)[1]) | set.intersection(*map(set, faults_of_axes))
        raise refusal(
            _with_axis_names(faults_of_axes, [table["name"] for table in tables], common_faults), text, source
        )
    return AxesFile(str(name), tuple(axes))


def merged(shared: Mapping[str, Any], axis_tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the shared tables with the tables of an axis merged into them."""
    tables = deepcopy(dict(shared))
    for key, value in axis_tables.items():
        both = isinstance(value, Mapping) and isinstance(tables.get(key), Mapping)
        tables[key] = merged(tables[key], value) if both else deepcopy(value)
    return tables


def _faults_of_list(tables: Any) -> Iterator[Fault]:
    """Yield the faults in the list of axes and in their names."""
    if not isinstance(tables, list) or not tables or not all(isinstance(table, Mapping) for table in tables):
        yield Fault(("axis",), "is no list of tables; write [[axis]] and a name for each axis", "wrong-type")
        return
    index_of_name: dict[str, int] = {}
    for index, table in enumerate(tables):
        path: KeyPath = ("axis", index, "name")
        name = table.get("name")
        if not isinstance(name, str) or not NAME.fullmatch(name):
            message = 'of up to 32 letters, digits, - and _, such as "x"'
            if name is None:
                yield Fault(path, f"is missing; write one {message}", "missing-key")
            else:
                yield Fault(path, f"{shown(name)} is no name; write one {message}", "wrong-type")
        elif name.lower() in index_of_name:
            yield Fault(
                path, f"{name!r} is the name of axis[{index_of_name[name.lower()]}] too; write another", "contradiction"
            )
        else:
            index_of_name[name.lower()] = index
        for key in NOT_OVERRIDDEN[1:]:
            if key in table:
                message = "is of the file, and no axis has its own; write it at the top of the file, or leave it out"
                yield Fault(("axis", index, key), message, "contradiction")


def _placed(fault: Fault, shared: Mapping[str, Any], axis_tables: Mapping[str, Any], index: int) -> Fault:
    """Return a fault of the merged tables with its place in the file: in the axis if it states the key or its table."""
    path: KeyPath = ("axis", index, *fault.path)
    if _has(axis_tables, fault.path) or (not _has(shared, fault.path) and fault.path[0] in axis_tables):
        return fault._replace(path=path)
    return fault


def _has(tables: Any, path: KeyPath) -> bool:
    """Return whether tables have a key."""
    for step in path:
        try:
            tables = tables[step]
        except (KeyError, IndexError, TypeError):
            return False
    return True


def _with_axis_names(
    faults_of_axes: Sequence[Sequence[Fault]], names: Sequence[str], common_faults: set[Fault]
) -> list[Fault]:
    """Return the faults of all axes without duplicates."""
    named_faults = []
    for faults, name in zip(faults_of_axes, names, strict=True):
        for fault in faults:
            needs_no_name = fault in common_faults or fault.path[:1] == ("axis",)
            named_faults.append(fault if needs_no_name else fault._replace(message=f"of axis {name}: {fault.message}"))
    return list(dict.fromkeys(named_faults))
