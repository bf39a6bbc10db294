"""Where the time of a command goes, and the floor under it: what it has to evaluate, at what one evaluation costs."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from pathlib import Path
from statistics import median
from time import process_time

from vctune.bench.dense import last_posed
from vctune.bench.parts import Parts, charged
from vctune.bench.problems import DOCUMENTS, posed, reference_problems
from vctune.bench.scenes import loaded_scene
from vctune.bench.timing import timed
from vctune.design.exchange import TIGHTENING
from vctune.design.judge import judge
from vctune.design.solve import solve
from vctune.design.units import dimensionless
from vctune.document.problem import Problem
from vctune.simulation.run import run
from vctune.study.outcome import work
from vctune.study.plane import plane
from vctune.study.region import region

SCAN = "scan"
PARTS: Parts = {
    "IPOPT and CasADi's machine": ("vctune.design.nlp:ca.Function.__call__",),
    "prover": (
        "vctune.proof.certificate:certify",
        "vctune.proof.poles:prove_sampled_poles",
        "vctune.proof.poles:prove_model_poles",
        "vctune.proof.batch:prove",
        "vctune.proof.batch:refuted",
        "vctune.proof.damping:no_damping",
    ),
    SCAN: (
        "vctune.design.scan:scan",
        "vctune.design.scan:start_at",
        "vctune.design.scan:better_start_near",
        "vctune.design.scan:in_same_basin",
    ),
    "checks between NLPs": ("vctune.design.exchange:polish",),
    "compiling": ("vctune.design.nlp:compiled", "vctune.simulation.step:build"),
}
"""What is charged to which part; of what a part calls, other parts' time is theirs."""
SOLVER_AND_PROVER = ("IPOPT and CasADi's machine", "prover")
TOTAL, WHOLE, BARE, FLOOR = "all", "whole process", "bare imports", "floor of solve"
EVALUATIONS = 50
BARE_IMPORTS = "import click, numpy, casadi, flint, pydantic"
PROBLEM = """[device]
mass = 0.4
damping = 2.0
sample_time = 1e-3
"""


@dataclass(frozen=True, slots=True)
class Share:
    """One part of one command: median processor time, s, and its share of all of it."""

    command: str
    part: str
    seconds: float
    share: float


def profile_rows(*, quick: bool) -> list[Share]:
    """Profile the commands on the reference problems, warm, and the whole process of a solve."""
    rows = []
    for command, task in _tasks(quick).items():
        task()
        rows += _parts(command, task, 2 if quick else 8)
    return [*rows, *_floor(quick), *_processes(3 if quick else 9)]


def _tasks(quick: bool) -> dict[str, Callable[[], object]]:
    problems = list(reference_problems(2 if quick else None).values())
    wheel = problems[0]
    found = solve(wheel).judgement
    assert found is not None
    across, scene = plane(wheel, "gains.velocity", "gains.position", 4 if quick else 6), loaded_scene()
    points = [
        posed("point", {**DOCUMENTS["friction-wheel"], "device": {"mass": 0.4, "damping": b, "sample_time": 1e-3}})
        for b in (0.5, 1.0, 2.0, 4.0)
    ]
    return {
        "solve": lambda: [solve(problem) for problem in problems],
        "check": lambda: judge(wheel, found.gains, found.coupling),
        "sweep": lambda: [work(point) for point in points],
        "region": lambda: region(wheel, across, across.whole()),
        "simulate": lambda: run(scene),
    }


def _parts(command: str, task: Callable[[], object], repeats: int) -> list[Share]:
    """Return the parts' shares of what a command takes."""
    _, seconds = timed(task, repeats)
    with charged(PARTS) as spent:
        began = process_time()
        for _ in range(repeats):
            task()
        took = process_time() - began
    shares = {part: each / took for part, each in spent.items() if each > 0}
    rows = [Share(command, TOTAL, seconds, 1.0)]
    rows += [Share(command, part, seconds * share, share) for part, share in shares.items()]
    return [*rows, Share(command, "the rest", seconds * (1 - sum(shares.values())), 1 - sum(shares.values()))]


def _floor(quick: bool) -> list[Share]:
    """Return what solving has to evaluate at the least, times what one evaluation costs: iterations and boxes."""
    needs = [_needed(problem) for problem in reference_problems(2 if quick else None).values()]
    iterations, evaluating, boxes, proving = (sum(column) for column in zip(*needs, strict=True))
    return [
        Share(FLOOR, f"{iterations} iterations, {1e6 * evaluating / iterations:.0f} us each", evaluating, nan),
        Share(FLOOR, f"{boxes} boxes, {1e6 * proving / boxes:.0f} us each", proving, nan),
    ]


def _needed(problem: Problem) -> tuple[int, float, int, float]:
    """Return the iterations of the winning polish, the boxes of the last proof, and the seconds for each."""
    solved = solve(problem)
    assert solved.judgement is not None and solved.polished is not None
    design = (solved.judgement.gains, solved.judgement.coupling)
    given = last_posed(problem, dimensionless(problem), solved.polished, TIGHTENING)
    given.evaluated(1)
    _, evaluating = timed(lambda: given.evaluated(EVALUATIONS), 3)
    _, proving = timed(lambda: judge(problem, *design), 3)
    iterations = sum(each.solution.iterations for each in solved.polished.rounds)
    return iterations, iterations * evaluating / EVALUATIONS, solved.judgement.certificate.boxes, proving


def _processes(repeats: int) -> list[Share]:
    """Measure `vctune solve --json --no-report` and the bare imports as whole processes, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "problem.toml").write_text(PROBLEM)
        solving = [sys.executable, "-m", "vctune", "solve", "problem.toml", "--json", "--no-report"]
        importing = [sys.executable, "-c", BARE_IMPORTS]
        pairs = [(_process(solving, folder), _process(importing, folder)) for _ in range(repeats + 1)][1:]
    whole, bare = median(pair[0] for pair in pairs), median(pair[1] for pair in pairs)
    ratio = median(pair[0] / pair[1] for pair in pairs)
    return [Share(WHOLE, "vctune solve --json --no-report", whole, ratio), Share(WHOLE, BARE, bare, 1.0)]


def _process(command: list[str], folder: str) -> float:
    """Return the processor time of a process, its bytecode kept as an installation keeps it."""
    from resource import RUSAGE_CHILDREN, getrusage

    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = getrusage(RUSAGE_CHILDREN)
    subprocess.run(
        command,
        cwd=folder,
        env={**environment, "PYTHONPYCACHEPREFIX": f"{folder}/bytecode"},
        check=True,
        stdout=subprocess.DEVNULL,
    )
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def says_of(rows: list[Share]) -> list[str]:
    """Say where the time goes."""
    said = []
    for command in dict.fromkeys(row.command for row in rows if row.command not in (WHOLE, FLOOR)):
        own = [row for row in rows if row.command == command]
        parts = ", ".join(f"{row.part} {row.share:.0%}" for row in own if row.part != TOTAL)
        said.append(f"{command}: {own[0].seconds:.3f} s, of which {parts}.")
    solving = {row.part: row for row in rows if row.command == "solve"}
    outside = 1 - sum(solving[part].share for part in SOLVER_AND_PROVER if part in solving)
    needed = [row for row in rows if row.command == FLOOR]
    whole, bare = (row for row in rows if row.command == WHOLE)
    ipopt, scanning = solving[SOLVER_AND_PROVER[0]], solving[SCAN]
    return [
        *said,
        f"Outside of IPOPT and the prover solve spends {outside:.0%} (aim: at most 30 %).",
        f"The floor under solve, what the best starts' polish and the last proof have to evaluate: "
        f"{' and '.join(row.part for row in needed)}, {sum(row.seconds for row in needed):.3f} s of "
        f"{solving[TOTAL].seconds:.3f} s. Beyond it go {ipopt.seconds - needed[0].seconds:.3f} s to IPOPT's own "
        f"algebra and starts that lose, {scanning.seconds:.3f} s to the scan that finds the starts.",
        f"Whole process: {whole.part} {whole.seconds:.3f} s, {whole.share:.2f} times the {bare.part} "
        f"({bare.seconds:.3f} s; aim: at most 3), `{BARE_IMPORTS}`.",
    ]
