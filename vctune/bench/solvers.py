"""Compare vctune with other solvers under two criteria: the same problems, starts and judges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import inf, log, nan
from statistics import median
from typing import Any

from vctune.bench import peers
from vctune.bench.benchmark import Measured, Panel, Series, Tick, timed
from vctune.bench.evaluator import case_of, stable, violation
from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import prepare
from vctune.design.search.scan import scan
from vctune.design.solve import solve
from vctune.document.reading import problem_at
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Criterion, Problem

WHEEL = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}
LIMITS = {"velocity": {"min": 0.1, "max": 1000.0}, "position": {"min": 0.0, "max": 1e5}}
PAPER = {"velocity": {"min": 1.0, "max": 1000.0}, "position": {"min": 3000.0, "max": 1e5}}
COUPLING = {"damping": {"min": 1e-3, "max": 1e5}, "mass": {"min": 1e-4, "max": 1e4}}
FELT = {"band_hz": [0.5, 30.0], "reference_impedance": 10.0}


def _wheel(gains: dict[str, Any], edge: float, **device: Any) -> dict[str, Any]:
    return {
        "device": {**WHEEL, **device},
        "gains": gains,
        "coupling": COUPLING,
        "transparency": FELT,
        "stability": {"criterion": "passive", "band_hz": [0.5, edge]},
    }


# The problems by name, in the form of files
DOCUMENTS: dict[str, dict[str, Any]] = {
    "two-basins": {
        **_wheel(LIMITS, 30.0, mass=0.8, damping=1.5, delay=1e-3),
        "transparency": {**FELT, "band_hz": [0.5, 20.0]},
        "stability": {"criterion": "passive", "band_hz": [0.2, 30.0]},
    },
    "friction-wheel": _wheel(PAPER, 100.0),
    "fast-sampling": _wheel(LIMITS, 120.0, mass=0.3, damping=0.4, sample_time=5e-4, delay=1e-4),
    "desktop": {
        "device": {"mass": 0.05, "damping": 0.2, "sample_time": 2.5e-4},
        "stability": {"criterion": "passive"},
    },
    "friction-wheel-paper": _wheel(PAPER, 100.0, hold="lag"),
    "lag-damped": _wheel(
        {"velocity": {"min": 1.0, "max": 200.0}, "position": {"min": 0.0, "max": 2e4}}, 100.0, hold="lag"
    ),
    "cobot-wrist": {
        "device": {"mass": 10.0, "damping": 20.0, "sample_time": 2e-3, "delay": 4e-3},
        "transparency": {"band_hz": [0.2, 5.0], "reference_impedance": 50.0},
        "stability": {"criterion": "passive", "band_hz": [0.2, 15.0]},
    },
    "at-bound": _wheel(LIMITS, 250.0, mass=1.0, delay=5e-4),
    "fixed-loop": _wheel({"velocity": 150.0, "position": 6000.0}, 100.0),
}


def posed(name: str, document: dict[str, Any]) -> Problem:
    """Return the problem of a valid document."""
    problem, faults = problem_at(document, name)
    assert problem is not None, faults
    return problem


def reference_problems(criterion: Criterion = "passive", count: int | None = None) -> dict[str, Problem]:
    """Return the first `count` reference problems, or all of them, under a criterion, by name."""
    some = list(DOCUMENTS.items())[:count]
    return {name: posed(name, x | {"stability": x["stability"] | {"criterion": criterion}}) for name, x in some}


CRITERIA: tuple[Criterion, ...] = ("passive", "both")
AS_GOOD = 1e-3  # Greatest gap with which a proved answer counts as equal to the best
LINEAR = 1e-4  # Gap below which the vertical axis of the picture is linear
OURS = "vctune"
RANDOM_STARTS = 10  # Number of random starts of a solver that is not given those of vctune's scan


@dataclass(frozen=True, slots=True)
class Peer:
    """Another solver, and what it is given."""

    solve: peers.Solver
    count: int  # number of frequencies in its grid
    own_starts: bool = False  # whether it has random starts instead of those of vctune's scan


PEERS = {
    "IPOPT, 200 frequencies": Peer(peers.ipopt, 200),
    "IPOPT, 2000 frequencies": Peer(peers.ipopt, 2000),
    "SciPy SLSQP, 2000 frequencies": Peer(peers.slsqp, 2000),
    "SciPy differential evolution, 200 frequencies": Peer(peers.evolution, 200),
    "IPOPT, 2000 frequencies, random starts": Peer(peers.ipopt, 2000, own_starts=True),
    "SciPy SLSQP, 2000 frequencies, random starts": Peer(peers.slsqp, 2000, own_starts=True),
}


@dataclass(frozen=True, slots=True)
class SolverRow:
    """The result of one solver on one problem."""

    criterion: str
    problem: str
    solver: str
    seconds: float  # median processor time, s, without the compilation of the solver's functions
    late: bool  # whether the time limit stopped the solver
    succeeded: bool  # whether the solver reports success
    error: float
    gap: float  # relative difference from the best proved error
    violation: float  # logarithm of the greatest violation of a constraint
    verdict: Status  # status of the answer by the prover
    consistent: bool  # whether the prover and the independent evaluator agree


def judged(problem: Problem, gains: Gains, coupling: AnyCoupling) -> tuple[float, float, Status, bool]:
    """Judge an answer by the prover and by the evaluator: return the last columns of its row, without the gap."""
    found, case = judge(problem, gains, coupling), case_of(problem.device, gains, coupling)
    witnesses = [outcome.witness for outcome in found.certificate.outcomes.values() if outcome.witness]
    missed = violation(problem, case, [*witnesses, *(at.omega for at in found.margins), found.worst_sensitivity])
    sound = found.status is not Status.CERTIFIED or (missed == 0 and stable(case))
    if (worst := found.in_hand) is not None:
        missed = max(missed, log(problem.stability.safety_factor / worst.ratio) if worst.ratio > 0 else inf)
    return found.transparency.error, missed, found.status, sound


def measure(quick: bool, seed: int, tick: Tick) -> Measured:
    """Run every solver on the reference problems."""
    rows: list[SolverRow] = []
    for criterion in CRITERIA:
        for name, problem in reference_problems(criterion, 1 if quick else None).items():
            rows += _problem_rows(criterion, name, problem, seed, tick)
    return Measured(
        "vctune against other solvers",
        "Each point is one problem: by how much the error of the answer exceeds the least error that any solver "
        "reached with a proof, against the processor time. Lower and further left is better. A filled point is proved. "
        "A hollow point is not: the solver met its constraints at the points of its grid and misses them in between, "
        "or met them nowhere. A hollow point below the line at 0 is therefore no better design. vctune's time includes "
        "the search for starts and the proof. The other solvers prove nothing, and get vctune's starts for nothing, or "
        f"{RANDOM_STARTS} random starts, of which the best answer counts. "
        "In hands, 27 hands share the frequencies of a grid: each has 74 of 2000, and only 7 of 200. "
        f"A solver stops after {peers.PATIENCE:g} s.",
        rows,
        [sentence for criterion in CRITERIA for sentence in facts([row for row in rows if row.criterion == criterion])],
        [_panel([row for row in rows if row.criterion == criterion]) for criterion in CRITERIA],
    )


def _problem_rows(criterion: str, name: str, problem: Problem, seed: int, tick: Tick) -> list[SolverRow]:
    """Return the rows of vctune and of all other solvers on one problem."""
    tick(f"{criterion}, {name}: {OURS}")
    solve(problem)  # compiles the solver, which is not timed
    solved, seconds = timed(partial(solve, problem))
    assert solved.judgement is not None

    def row(solver: str, seconds: float, late: bool, succeeded: bool, *design: *tuple[Gains, AnyCoupling]) -> SolverRow:
        error, missed, verdict, sound = judged(problem, *design)
        return SolverRow(criterion, name, solver, seconds, late, succeeded, error, nan, missed, verdict, sound)

    rows = [row(OURS, seconds, False, True, solved.judgement.gains, solved.judgement.coupling)]
    prepared = prepare(problem)
    starts = scan(prepared.scaled).starts
    starts = [start for start in starts if start.admissible] or starts[:2]
    for label, peer in PEERS.items():
        tick(f"{criterion}, {name}: {label}")
        some = starts
        if peer.own_starts:
            some = peers.random_starts(prepared.scaled.problem, RANDOM_STARTS, seed)
        elif peer.solve is peers.evolution:  # it needs no start, but an integrator if the problem permits one
            some = sorted(starts, key=lambda start: start.gains.position == 0)[:1]
        problems = [peers.on_grid(prepared, start, peer.count) for start in some]
        (answer, late), seconds = timed(partial(peers.best_answer, problems, peer.solve))
        rows.append(row(label, seconds, late, answer.succeeded, *answer.design))
    best = min((row.error for row in rows if row.verdict is Status.CERTIFIED), default=nan)
    return [replace(row, gap=row.error / best - 1) for row in rows]


def facts(rows: list[SolverRow]) -> list[str]:
    """Return the findings on one criterion: how good, how fast and how often refuted each solver's answers are."""
    ours = {row.problem: row for row in rows if row.solver == OURS}
    found = []
    for solver in dict.fromkeys(row.solver for row in rows):
        own = [row for row in rows if row.solver == solver]
        proved = [row for row in own if row.verdict is Status.CERTIFIED]
        text = f'"{rows[0].criterion}", {solver}: proved on {len(proved)} of {len(own)} problems, '
        text += f"within {AS_GOOD:.1%} of the best on {sum(row.gap <= AS_GOOD for row in proved)} of these; "
        text += f"worst violation {max(row.violation for row in own):.2g}, "
        text += f"median {median(row.seconds for row in own):.2g} s"
        if solver != OURS:
            lower = [x for row in proved if (x := 1 - row.error / ours[row.problem].error) > 0]
            text += f", faster than vctune on {sum(row.seconds < ours[row.problem].seconds for row in own)}; "
            text += f"proved error lower than vctune's on {len(lower)}"
            text += f" (by up to {max(lower):.2g} of it)" if lower else ""
            text += f"; stopped by the time limit on {sum(row.late for row in own)}" * any(row.late for row in own)
        found.append(text + ".")
    wrong = sum(not row.consistent for row in rows)
    return [*found, f"The prover and the independent evaluator contradict each other {wrong} times."]


def _panel(rows: list[SolverRow]) -> Panel:
    """Draw the error over the run time under one criterion."""
    series = []
    for solver in dict.fromkeys(row.solver for row in rows):
        for proved in (True, False):
            own = [r for r in rows if r.solver == solver and (r.verdict is Status.CERTIFIED) is proved]
            series.append(Series(solver, [row.seconds for row in own], [row.gap for row in own], proved))
    title = f'"{rows[0].criterion}" (hollow: not proved)'
    return Panel(title, "processor time, s", "error above the best proved error, relative", series, LINEAR)
