"""Measures what a bound costs. `python tests/bound_gap.py` prints it and writes results/bound-gap.csv and .svg.

Every problem of problems/, and of the folders named as arguments, is solved, then bounded until each gap is proved,
for at most a minute. `jobs` as the only argument compares one thread with two, in pairs. Other work on the machine
shows in every number of seconds.
"""

from __future__ import annotations

import os
import statistics
import sys
from functools import partial
from pathlib import Path
from time import perf_counter

from matplotlib.figure import Figure

from vctune.design.bound.search import Optimality, bound
from vctune.design.prepared import prepare
from vctune.design.search.optimum import improved
from vctune.design.solve import solve
from vctune.design.verdict.judge import Judgement
from vctune.document.reading import read_problem
from vctune.model.problem import Problem
from vctune.report.figures.with_matplotlib import svg
from vctune.running import time_limit

ROOT = Path(__file__).parent.parent
GAPS = (0.1, 0.03, 0.01, 0.003)
MOST_SECONDS = 60.0
PAIRS = 5


def solved(folders: list[Path]) -> dict[str, tuple[Problem, Judgement]]:
    """Return the problems that have a design, with it, by name."""
    found = {}
    for folder in folders:
        for path in sorted(folder.rglob("*.toml")):
            if path.parent.name == "studies":
                continue
            problem = read_problem(path).problem
            best = None if problem.bounds.fixed else solve(problem).judgement
            if best is not None:
                found[path.stem] = problem, best
    return found


def proved(problem: Problem, best: Judgement, gap: float, jobs: int = 1) -> tuple[float, Optimality]:
    """Return the seconds that a gap takes, all of it, and what was proved."""
    began = perf_counter()
    prepared = prepare(problem)
    with time_limit(MOST_SECONDS):
        found = bound(prepared.given, best, partial(improved, prepared), gap=gap, jobs=jobs)
    return perf_counter() - began, found


def measure(folders: list[Path]) -> None:
    """Print and write seconds and boxes against the gap."""
    lines, rows = ["problem,gap,seconds,boxes,error,lower_bound,verdict"], {}
    for name, (problem, best) in solved(folders).items():
        for gap in GAPS:
            seconds, found = proved(problem, best, gap)
            verdict = "proved" if found.proved else "open"
            numbers = f"{seconds:.2f},{found.resume.boxes},{found.incumbent:.6g},{found.bound:.6g}"
            lines.append(f"{name},{gap:g},{numbers},{verdict}")
            print(lines[-1], flush=True)
            rows.setdefault(name, []).append((found.gap, seconds, found.resume.boxes))
    (ROOT / "results" / "bound-gap.csv").write_text("\n".join(lines) + "\n")
    draw(rows)


def draw(rows: dict[str, list[tuple[float, float, int]]]) -> None:
    figure = Figure(figsize=(9, 4), layout="constrained")
    time, boxes = figure.subplots(1, 2, sharex=True)
    slowest = sorted(rows, key=lambda name: -rows[name][-1][1])[:6]
    for name, points in rows.items():
        gaps, seconds, counts = zip(*points, strict=True)
        style = {"color": "0.75", "linewidth": 0.8}
        if name in slowest:
            style = {"label": name, "marker": "os^Dv*"[slowest.index(name)], "markersize": 4}
        time.loglog([100 * gap for gap in gaps], seconds, **style)
        boxes.loglog([100 * gap for gap in gaps], counts, **style)
    time.axhline(MOST_SECONDS, color="0.5", linestyle="--", linewidth=1)
    time.set(xlabel="gap reached, %", ylabel="seconds, one thread", title="run time")
    boxes.set(xlabel="gap reached, %", ylabel="boxes", title="boxes")
    time.invert_xaxis()
    boxes.legend(fontsize=7, title="slowest six", title_fontsize=7)
    (ROOT / "results/bound-gap.svg").write_text(svg(figure, "bound-gap"))


def compare_threads() -> None:
    """Print the median ratio of the seconds with two threads and with one."""
    problems = solved([ROOT / "problems"])
    for name in ("desktop", "fast", "undamped"):
        ratios = []
        for number in range(PAIRS):
            order = (1, 2) if number % 2 else (2, 1)
            seconds = {jobs: proved(*problems[name], 0.003, jobs)[0] for jobs in order}
            ratios.append(seconds[1] / seconds[2])
        print(f"{name}: one thread takes {statistics.median(ratios):.2f} times as long, load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    if sys.argv[1:] == ["jobs"]:
        compare_threads()
    else:
        measure([ROOT / "problems", *map(Path, sys.argv[1:])])
