"""Measure run times: of each stage of a design, of `vctune solve` with its report, and of a sweep."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from statistics import median
from time import perf_counter

from vctune.bench.benchmark import Measured, Tick
from vctune.bench.timing import timed
from vctune.design.prepared import pose, prepare
from vctune.design.search.optimum import estimated
from vctune.design.search.scan import scan
from vctune.design.solve import solve
from vctune.design.variables import design_of, point
from vctune.document.reading import parse_problem
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.report.figures.benchmark_figures import Panel, Series

PROBLEMS = "friction-wheel-hands", "desktop", "cobot-wrist", "friction-wheel-real"
# Number of problems of the quick measurement, and number of runs of the full one; the benchmark reports the median of
# the runs
QUICK, REPEATS = 2, 5
SIDES = {"quick": 3, "full": 10}  # Number of values of mass, and of damping, in each sweep
DEVICE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
STUDY = """problem = "device.toml"
[axes]
"device.mass" = {{ log = [0.05, 5.0], n = {0} }}
"device.damping" = {{ log = [0.1, 10.0], n = {0} }}
"""
CRITERIA = "both", "hands", "passive"  # Criteria of stability
# Names of the measured work, see `Row.work`
SCAN, SEARCH, PROVED, REPORT, SWEEP = "scan", "search", "proof", "with report", "sweep"


@dataclass(frozen=True, slots=True)
class Row:
    """A measured task."""

    work: str  # measured work: the scan alone
    problem: str  # name of the problem, or the criterion of the sweep
    seconds: float  # processor time, s
    error: float  # error of the design; nan for commands and without a design


def measure(quick: bool, seed: int, tick: Tick) -> Measured:
    """Solve examples with the library and with the command, and sweep over mass and damping."""
    names, repeats, side = (PROBLEMS[:QUICK], 1, SIDES["quick"]) if quick else (PROBLEMS, REPEATS, SIDES["full"])
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            tick(name)
            rows += solved(name, Path(folder), repeats)
        for criterion in CRITERIA:
            tick(f"{SWEEP}, {criterion}")
            rows.append(swept(criterion, side, Path(folder)))
    return Measured(
        "Answers under the default criterion",
        f"Left: error against run time, after the {SCAN}, the {SEARCH} and the {PROVED}. Right: whole commands.",
        rows,
        facts(rows, side),
        panels(rows),
    )


def solved(name: str, folder: Path, repeats: int) -> list[Row]:
    """Return four rows: the designs of the scan, of the search and of the proof, and `vctune solve` with its report."""
    _command(folder, "example", name)
    problem = parse_problem((folder / f"{name}.toml").read_text(), name, name)
    rows = [_estimate(work, find, problem, repeats) for work, find in ((SCAN, scanned), (SEARCH, estimated))]
    found, seconds = timed(lambda: solve(problem), repeats)
    error = nan if found.judgement is None else found.judgement.error
    reported = median(_command(folder, "solve", f"{name}.toml") for _ in range(repeats))
    return [*rows, Row(PROVED, name, seconds, error), Row(REPORT, name, reported, nan)]


def scanned(problem: Problem) -> tuple[Gains, AnyCoupling] | None:
    """Return the best admissible design of the scan, in SI units; None if the scan has no admissible start."""
    prepared = prepare(problem)
    starts = [start for start in scan(prepared.scaled).starts if start.admissible]
    if not starts:
        return None
    best = min(starts, key=lambda start: start.error)
    return design_of(prepared.units.to_si(point(best.gains, best.coupling)))


def _estimate(
    work: str, find: Callable[[Problem], tuple[Gains, AnyCoupling] | None], problem: Problem, repeats: int
) -> Row:
    design, seconds = timed(lambda: find(problem), repeats)
    return Row(work, problem.name, seconds, nan if design is None else pose(problem).error(*design))


def swept(criterion: str, side: int, folder: Path) -> Row:
    """Return the row of a sweep: the wall time of the command, including its start, divided by the number of points."""
    folder = folder / criterion
    folder.mkdir()
    (folder / "device.toml").write_text(f'{DEVICE}[stability]\ncriterion = "{criterion}"\n')
    (folder / "study.toml").write_text(STUDY.format(side))
    began = perf_counter()
    _command(folder, "sweep", "study.toml")
    return Row(SWEEP, criterion, (perf_counter() - began) / side**2, nan)


def _command(folder: Path, *arguments: str) -> float:
    """Run a command of vctune and return its processor time, s; on Windows, its wall time. Ignore its exit code."""
    began, before = perf_counter(), _of_children()
    subprocess.run([sys.executable, "-m", "vctune", *arguments, "--quiet"], cwd=folder, check=False)
    return perf_counter() - began if before is None else (_of_children() or 0.0) - before


def _of_children() -> float | None:
    """Return the processor time of all ended child processes, s; None on Windows, which does not measure it."""
    if sys.platform == "win32":
        return None
    from resource import RUSAGE_CHILDREN, getrusage

    used = getrusage(RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def facts(rows: list[Row], side: int) -> list[str]:
    """Return findings: the times of each problem and the rates of the sweeps."""
    names = dict.fromkeys(row.problem for row in rows if row.work == PROVED)
    said = []
    for name in names:
        at = {row.work: row for row in rows if row.problem == name}
        errors = ", ".join(f"{at[w].error:.4g} after {at[w].seconds:.2f} s ({w})" for w in (SCAN, SEARCH, PROVED))
        said.append(f"{name}: error {errors}; the command with its report takes {at[REPORT].seconds:.2f} s.")
    rates = ", ".join(f"{1 / row.seconds:.1f} under {row.problem}" for row in rows if row.work == SWEEP)
    return [*said, f"Designs a second in a sweep of {side**2} points on all cores, with its start: {rates}."]


def panels(rows: list[Row]) -> list[Panel]:
    """Draw error against run time, and the times of the commands."""
    designs: dict[str, list[Row]] = {}
    for row in rows:
        if isfinite(row.error):
            designs.setdefault(row.problem, []).append(row)
    paths = [Series(name, [row.seconds for row in of], [row.error for row in of]) for name, of in designs.items()]
    works = {work: [row for row in rows if row.work == work] for work in (REPORT, SWEEP)}
    commands = [
        Series(work, [float(k) for k in range(1, len(those) + 1)], [row.seconds for row in those])
        for work, those in works.items()
    ]
    return [
        Panel("error against run time", "processor time, s", "error", paths),
        Panel("commands", "in the order of the table", "seconds of a problem, of a point", commands),
    ]
