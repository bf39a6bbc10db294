"""How cost grows with the size of the work, and where the time of a command goes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vctune.bench.benchmark import Measured, Size, Tick
from vctune.bench.dense import casadi_solve, dense
from vctune.bench.problems import DOCUMENTS, posed, reference_problems
from vctune.bench.profile import Share, profile_rows, says_of
from vctune.bench.scenes import loaded_scene
from vctune.bench.timing import slope, timed
from vctune.design.scan import scan
from vctune.design.solve import solve
from vctune.design.units import dimensionless
from vctune.document.axes import Axis, number_keys
from vctune.document.study import Study
from vctune.report.benchmarks import Panel, Series
from vctune.simulation.motion import sample_count
from vctune.simulation.run import run
from vctune.study.executors import Crew
from vctune.study.plane import plane
from vctune.study.region import region
from vctune.study.rows import open_rows
from vctune.study.sweep import sweep

WHEEL = "friction-wheel"
REPEATS = 3
EXPECTED = {
    "frequencies": "1: one constraint more costs as much as the last one",
    "decades of band": "at most 1: boxes, samples and minima grow with the decades, the NLP hardly",
    "free variables": "at most 1: a handful more of derivatives",
    "points in a sweep": "1: points know nothing of each other",
    "cells in a region": "1: cells are decided one by one, some together",
    "samples in a simulation": "1",
}
"""The exponent that each axis should have, and why."""


@dataclass(frozen=True, slots=True)
class Row:
    """One size on one axis: what grows, how many, and the median processor time, s."""

    axis: str
    size: float
    seconds: float


def measure(size: Size, tick: Tick) -> Measured:
    """Measure cost against size on every axis, and where the time of the commands goes."""
    rows = []
    for axis, work in AXES.items():
        for count, task in work(size.quick):
            tick(f"{axis}: {count:g}")
            task()
            rows.append(Row(axis, count, timed(task, 1 if size.quick else REPEATS)[1]))
    tick("profile")
    shares = profile_rows(quick=size.quick)
    return Measured(
        "How cost grows, and where the time goes",
        "Processor time against size; the slopes beside the expected ones are below.",
        {"scaling": rows, "profile": shares},
        facts(rows, shares),
        panels(rows),
    )


Sized = Iterator[tuple[float, Callable[[], object]]]


def _frequencies(quick: bool) -> Sized:
    problem = reference_problems()[WHEEL]
    scaled = dimensionless(problem)
    start = scan(scaled).starts[0]
    for power in range(5, 9 if quick else 12):
        given = dense(problem, scaled, start, 2**power, 1e-6)
        yield 2.0**power, lambda given=given: casadi_solve(given, "ipopt")  # type: ignore[misc]


def _decades(quick: bool) -> Sized:
    for decades in range(1, 5 if quick else 8):
        document = deepcopy(DOCUMENTS[WHEEL])
        document["stability"] = {"band_hz": [100.0 * 10.0**-decades, 100.0]}
        problem = posed(WHEEL, document)
        yield float(decades), lambda problem=problem: solve(problem)  # type: ignore[misc]


def _variables(quick: bool) -> Sized:
    document = deepcopy(DOCUMENTS[WHEEL])
    document["coupling"] = {**document["coupling"], "drag": {"min": 0.0, "max": 10.0}}
    whole = posed(WHEEL, document)
    judged = solve(whole).judgement
    assert judged is not None
    found = {
        ("gains", "velocity"): judged.gains.velocity,
        ("gains", "position"): judged.gains.position,
        ("coupling", "drag"): judged.coupling.drag,
        ("coupling", "mass"): judged.coupling.mass * 1.01,
    }
    for fixed in range(4, -1, -1):
        narrowed = deepcopy(document)
        for (table, key), value in list(found.items())[:fixed]:
            narrowed[table] = {**narrowed[table], key: value}
        problem = posed(WHEEL, narrowed)
        yield 5.0 - fixed, lambda problem=problem: solve(problem)  # type: ignore[misc]


def _points(quick: bool) -> Sized:
    for n in (4, 8, 16) if quick else (8, 16, 32, 64, 128):
        key = "device.damping"
        axis = Axis(key, number_keys()[key], "log", (0.5, 5.0), n)
        study = Study("scaling", DOCUMENTS[WHEEL], (axis,))
        yield float(n), lambda study=study: _swept(study)  # type: ignore[misc]


def _swept(study: Study) -> None:
    with tempfile.TemporaryDirectory() as folder:
        crew = Crew(_Here(), 1, (), (), lambda: None)
        with open_rows(Path(folder) / "rows.jsonl", study, restart=True) as rows:
            sweep(study, rows, crew)


class _Here(Executor):
    """Does the work at once in this process, where its processor time counts."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def _cells(quick: bool) -> Sized:
    problem = reference_problems()[WHEEL]
    for levels in range(4, 6 if quick else 9):
        across = plane(problem, "gains.velocity", "gains.position", levels)
        count = region(problem, across, across.whole()).squares.shape[1]
        yield float(count), lambda across=across: region(problem, across, across.whole())  # type: ignore[misc]


def _samples(quick: bool) -> Sized:
    for cycles in (1, 2, 4) if quick else (1, 2, 4, 8, 16):
        scene = loaded_scene()
        longer = replace(scene, operator=replace(scene.operator, cycles=cycles))
        count = sample_count(longer.operator, longer.device.sample_time)
        yield float(count), lambda longer=longer: run(longer)  # type: ignore[misc]


AXES: dict[str, Callable[[bool], Sized]] = {
    "frequencies": _frequencies,
    "decades of band": _decades,
    "free variables": _variables,
    "points in a sweep": _points,
    "cells in a region": _cells,
    "samples in a simulation": _samples,
}


def slopes(rows: list[Row]) -> dict[str, float]:
    """Return the exponent of cost in size on every axis."""
    found = {}
    for axis in dict.fromkeys(row.axis for row in rows):
        own = [row for row in rows if row.axis == axis]
        found[axis] = slope([row.size for row in own], [row.seconds for row in own])
    return found


def facts(rows: list[Row], shares: list[Share]) -> list[str]:
    """Say the slopes beside the expected ones, and where the time goes."""
    grown = [f"{axis}: slope {found:.2f}, expected {EXPECTED[axis]}." for axis, found in slopes(rows).items()]
    return [*grown, *says_of(shares)]


def panels(rows: list[Row]) -> list[Panel]:
    """Draw time against size."""
    series = []
    for axis in dict.fromkeys(row.axis for row in rows):
        own = [row for row in rows if row.axis == axis]
        series.append(Series(axis, [row.size for row in own], [row.seconds for row in own], joined=True))
    return [Panel("", "size", "processor time, s", series)]
