"""Provide `vctune compare` as a function."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from math import isclose
from pathlib import Path
from shlex import quote
from typing import Any

from vctune.analysis.demands import transparency_error
from vctune.api.result import Rows, Table
from vctune.api.solving import known_record, solve
from vctune.design.prepared import pose
from vctune.design.search.optimum import Progress
from vctune.design.verdict.design_record import felt_record, record_of
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import on_yardstick, parse_problem
from vctune.document.records.comparison import (
    ComparedDesign,
    ComparisonRecord,
    YardstickErrorRecord,
    comparison_record,
)
from vctune.document.records.design_json import DesignRecord
from vctune.document.records.part import text
from vctune.document.text.errors import printable
from vctune.model.problem import Problem, Transparency

SAME = 1e-9  # Greatest relative difference of two numbers that count as equal


def compare(
    a: ProblemSource | DesignRecord, b: ProblemSource | DesignRecord, *, progress: Progress = lambda stage: None
) -> ComparisonRecord:
    """Compare two designs. If an argument is a problem without a design, vctune first solves the problem. The function
    writes no files.

    The function measures the errors of both designs on the yardstick of `a`: its transparency band, Z_0, norm and
    weights. If `b` is a problem that states no band or Z_0, the function solves it with those of `a`. If the yardstick
    of `b` differs, the result contains both errors on both yardsticks. If the designs are for different kinds of
    display, or one is linear and one is rotary, each error is on its own yardstick.

    Parameters
    ----------
    a, b : ProblemSource or DesignRecord
        Path of a design.json or of a problem file, the tables of a problem, a problem, or the record of a
        design.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    ComparisonRecord
        `problem` contains the keys that differ, with defaults written out; `design` contains the values and verdicts of
        both designs.

    Raises
    ------
    InputError
        If `a` or `b` is invalid.
    """
    record_a, problem_a = _designed(a, None, progress)
    record_b, problem_b = _designed(b, problem_a, progress)
    yardsticks: list[Transparency | None] = [None]
    if _alike(problem_a, problem_b):
        yardsticks = [problem_a.transparency]
        yardsticks += [problem_b.transparency] * (not _same(problem_a.transparency, problem_b.transparency))
    return comparison_record(
        _measured_design(a, record_a, problem_a, yardsticks), _measured_design(b, record_b, problem_b, yardsticks)
    )


def _designed(source: Any, base: Problem | None, progress: Progress) -> tuple[DesignRecord, Problem]:
    """Return the record of a design with its problem."""
    record = known_record(source)
    if record is not None:
        return record, parse_problem(record.problem.text, record.problem.name, record.problem.name)
    file = problem_of(source)
    if base is not None and _alike(base, file.problem):
        file = on_yardstick(file, base)
    return record_of(file, solve(file, progress=progress)), file.problem


def _alike(a: Problem, b: Problem) -> bool:
    """Return whether the errors of two problems have the same terms in the same units."""
    return (a.device.display, a.device.units) == (b.device.display, b.device.units)


def _same(a: Transparency, b: Transparency) -> bool:
    """Return whether two yardsticks are equal."""
    numbers = [(yardstick.band.min, yardstick.band.max, yardstick.reference_impedance) for yardstick in (a, b)]
    close = all(isclose(*pair, rel_tol=SAME) for pair in zip(*numbers, strict=True))
    return close and (a.norm, a.weights) == (b.norm, b.weights)


def _measured_design(
    source: Any, record: DesignRecord, problem: Problem, yardsticks: Sequence[Transparency | None]
) -> ComparedDesign:
    """Return one of two compared designs with its error on each yardstick. None stands for the design's own
    yardstick."""
    return ComparedDesign(
        source=str(source) if isinstance(source, str | Path) else record.problem.name,
        record=record,
        problem=problem,
        felt=None if record.design is None else felt_record(problem.device, *record.design),
        errors=tuple(_measured(record, problem, yardstick or problem.transparency) for yardstick in yardsticks),
    )


def _measured(record: DesignRecord, problem: Problem, yardstick: Transparency) -> YardstickErrorRecord | None:
    """Return a design's error on a yardstick."""
    if record.design is None or yardstick.band.max > problem.nyquist:
        return None
    posed = pose(replace(problem, transparency=yardstick)).problem
    return YardstickErrorRecord(
        **asdict(transparency_error(posed, *record.design)),
        display=problem.device.display,
        band_hz=list(yardstick.band.hz),
        reference_impedance=yardstick.reference_impedance,
    )


def comparison_rows(found: ComparisonRecord) -> Rows:
    """Yield two designs as columns: their files and status, the keys in which the problems differ, both results; then
    the reasons why there is no design."""
    yield Table(list(_compared(found)), ("", "", "A", "B", ""), right=(2, 3), groups=True)
    yield from ((f"{name}: {printable(at.reason)}",) for name, at in (("A", found.a), ("B", found.b)) if at.reason)


def _compared(found: ComparisonRecord) -> Iterator[tuple[str, ...]]:
    """Yield group, label, both values and unit of each row."""
    sides = (found.a, found.b)
    for label, values in (
        ("file", [at.source for at in sides]),
        ("problem", [at.name for at in sides]),
        ("status", [f"{at.status}, idle" if at.idle else at.status for at in sides]),
    ):
        yield "", label, *map(printable, values), ""
    yield from (("differs", each.key, _cell(each.a, 8), _cell(each.b, 8), "") for each in found.problem)
    for each in found.design:
        yield each.group, each.label, _cell(each.a, each.digits), _cell(each.b, each.digits), each.unit


def _cell(value: Any, digits: int) -> str:
    """Return a value as text; "-" without a value. A list of two numbers is a range."""
    if isinstance(value, list) and len(value) != 2:
        return printable(str(value))
    return "-" if value is None else printable(text(value, digits))


def after_comparison(found: ComparisonRecord) -> str:
    """Return what to do with the better of the certified designs, or with both if neither is certified."""
    errors = next(((each.a, each.b) for each in found.design if each.label == "error"), (None, None))
    certified = [
        (error, side.source)
        for error, side in zip(errors, (found.a, found.b), strict=True)
        if side.status == "certified" and isinstance(error, float)
    ]
    if not certified:
        return "neither is certified; vctune solve reports repairs"
    source = min(certified)[1]
    return f"vctune {'export' if source.endswith('.json') else 'solve'} {quote(source)}"
