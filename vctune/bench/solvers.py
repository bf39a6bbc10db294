"""Compare vctune with the usual alternatives: the same problems, the same starts, the same judges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import inf, log, nan
from statistics import median
from time import process_time

from vctune.bench import evaluator, peers
from vctune.bench.benchmark import Measured, Tick
from vctune.bench.dense import DenseProblem, Stopped, compiled, dense, ipopt
from vctune.bench.evaluator import case_of, spectral_radius
from vctune.bench.problems import reference_problems
from vctune.bench.timing import timed
from vctune.design.prepared import Prepared, prepare
from vctune.design.search.exchange import TIGHTENING
from vctune.design.search.optimum import WORTH_POLISHING
from vctune.design.search.scan import ScanResult, scan
from vctune.design.search.start import Start
from vctune.design.solve import solve
from vctune.design.verdict.judge import Status, judge
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.report.benchmark_figure import Panel, Series

# Relative difference between the errors of prover and evaluator above which they contradict each other
AGREEMENT = 1e-6


@dataclass(frozen=True, slots=True)
class JudgedAnswer:
    """The judgement on an answer."""

    error: float  # transparency error by the independent evaluator
    violation: float
    stable: bool  # whether the eigenvalues of the sampled loop without a hand lie inside the unit circle
    verdict: Status  # status of the answer by the prover
    consistent: bool


def judge_answer(problem: Problem, gains: Gains, coupling: AnyCoupling) -> JudgedAnswer:
    """Judge an answer by the prover and by the evaluator."""
    judged = judge(problem, gains, coupling)
    witnesses = [outcome.witness for outcome in judged.certificate.outcomes.values() if outcome.witness]
    case = evaluator.case_of(problem.device, gains, coupling)
    error, stable = float(evaluator.error(problem, case)), evaluator.spectral_radius(case) < 1
    violation = evaluator.violation(problem, case, [*witnesses, judged.worst, judged.worst_sensitivity])
    verdict = judged.status
    same = abs(judged.transparency.error - error) <= AGREEMENT * error or not error < inf
    sound = verdict is not Status.CERTIFIED or (violation == 0 and stable)
    return JudgedAnswer(error, violation, stable, verdict, same and sound)


# Number of frequencies of each kind in the grids of SLSQP and of the finest IPOPT: for Llewellyn's conditions, and
# again for |S|
GRID = 2000
COARSE_GRIDS = (8, 32, 128, 512)  # Numbers of frequencies of each kind in the coarser grids for IPOPT
CONSTRAINT_RESERVE = 1e-5  # Relative tightening of the other solvers' constraints on `GRID`
# Greatest violation on the grid, the logarithm of a ratio, with which an answer of another solver counts as feasible
MAX_VIOLATION = 1e-6
# Number of timed pairs of runs, one of another solver and one of vctune; and run time of the other solver, s, from
# which the benchmark times only one pair. vctune's own row has `REPEATS` runs
REPEATS, SLOW_SECONDS = 5, 1.0
OURS, MULTISTART, IPOPT = "vctune", "SciPy SLSQP", "IPOPT, "
AIMED_PACE = 1 / 3  # Largest share of the multi-start's time that vctune may take for a certified design
LEAST_GAP = 1e-7  # Gap, or violation, at the dotted line of the picture
AS_GOOD_GAP = 1e-3  # Greatest gap with which an answer counts as equal to the best
UNSTABLE_PENALTY = 1e3  # Penalty that ranks unstable answers behind all stable answers
Solver = Callable[[DenseProblem], Stopped]  # Type of a function that solves a problem on its grid from one start


@dataclass(frozen=True, slots=True)
class Peer:
    """A solver with which the benchmark compares vctune."""

    name: str  # name of the solver
    count: int  # number of frequencies of each kind in its grid
    solver: Solver  # function that solves a problem from one start
    reserve: float = CONSTRAINT_RESERVE  # relative tightening of the solver's constraints


@dataclass(frozen=True, slots=True)
class Row:
    """The result of one solver on one problem."""

    problem: str  # names
    solver: str
    grid: int  # number of frequencies of each kind; 0 for vctune, which chooses its own frequencies
    seconds: float  # median processor time, s, without the compilation of the solver's functions
    pace: float  # vctune's time divided by the solver's time, the median over pairs of consecutive runs; 1 for vctune
    starts: int  # number of starts from which the solver ran; for vctune the number of its local optima
    unstable: int  # number of the solver's answers with an unstable sampled loop; 0 for vctune
    succeeded: bool  # whether the solver reports success; True for vctune
    gap: float
    error: float  # see `vctune.bench.solvers.JudgedAnswer`
    violation: float
    stable: bool
    verdict: Status
    consistent: bool


PEERS = [
    Peer(MULTISTART, GRID, peers.slsqp),
    Peer("SciPy SLSQP, differences", GRID, peers.slsqp_differences),
    *(Peer(f"{IPOPT}{count} frequencies", count, ipopt, TIGHTENING) for count in COARSE_GRIDS),
    Peer(f"{IPOPT}{GRID} frequencies", GRID, ipopt),
]


def measure(quick: bool, seed: int, tick: Tick) -> Measured:
    """Run every solver on the reference problems."""
    rows: list[Row] = []
    for name, problem in reference_problems(1 if quick else None).items():
        rows += _problem_rows(name, problem, tick)
    return Measured(
        "vctune against other solvers",
        "The left panel shows the gap to the best proved error against processor time, with one point for each "
        "problem, for answers that are proved and for answers that are not. A point on the dotted line has a gap below "
        f"{LEAST_GAP:g}, or seems better than the best because it violates a constraint. The right panel shows the "
        "violations.",
        rows,
        facts(rows),
        panels(rows),
    )


def _problem_rows(name: str, problem: Problem, tick: Tick) -> list[Row]:
    """Return the rows of vctune and of all other solvers on one problem."""
    tick(f"{name}: {OURS}")
    prepared = prepare(problem)
    scan_result = scan(prepared.scaled)
    rows = [_vctune_row(name, problem)]
    for peer in PEERS:
        tick(f"{name}: {peer.name}")
        rows.append(_peer_row(name, prepared, scan_result, peer))
    proved = [row.error for row in rows if row.verdict == Status.CERTIFIED]
    best = min(proved, default=nan)
    return [replace(row, gap=row.error / best - 1) for row in rows]


def _vctune_row(name: str, problem: Problem) -> Row:
    """Return vctune's row. The first solve, which compiles the solver, is not timed."""
    solve(problem)
    solved, seconds = timed(lambda: solve(problem), REPEATS)
    assert solved.judgement is not None
    judged = judge_answer(problem, solved.judgement.gains, solved.judgement.coupling)
    return Row(name, OURS, 0, seconds, 1.0, solved.optima, 0, True, nan, **asdict(judged))


def _peer_row(name: str, prepared: Prepared, scan_result: ScanResult, peer: Peer) -> Row:
    """Return the row of another solver: its best answer, its time, and vctune's time relative to it."""
    problem, dense_problems = (
        prepared.problem,
        [dense(prepared, start, peer.count, peer.reserve) for start in _starts(scan_result)],
    )
    for dense_problem in dense_problems:
        dense_problem.values(dense_problem.numbers.guess)
        dense_problem.slopes(dense_problem.numbers.guess)
        if peer.solver is ipopt:
            compiled(dense_problem.numbers.structure)
    times: list[float] = []
    paces = []
    while not times or (len(times) < REPEATS and times[0] < SLOW_SECONDS):
        answers, seconds = _multistart(dense_problems, scan_result, peer)
        times.append(seconds)
        paces.append(timed(lambda: solve(problem))[1] / seconds)
    best = min(answers, key=lambda answer: answer.rank)
    unstable = sum(not answer.stable for answer in answers)
    timings, counts = (median(times), median(paces)), (len(answers), unstable)
    judged = asdict(judge_answer(problem, *best.design))
    return Row(name, peer.name, peer.count, *timings, *counts, best.converged, nan, **judged)


def _starts(scan_result: ScanResult) -> list[Start]:
    """Return the admissible starts of a scan, or its first two starts if none is admissible, as vctune's search
    does."""
    return [start for start in scan_result.starts if start.admissible] or scan_result.starts[:2]


@dataclass(frozen=True, slots=True)
class _Answer:
    """The answer of a solver from one start."""

    design: tuple[Gains, AnyCoupling]  # gains and coupling, SI units
    log_error: float  # logarithm of the transparency error
    violation: float  # greatest violation of a constraint on the solver's own grid, the logarithm of a ratio
    stable: bool  # whether the sampled loop without a hand is stable
    converged: bool  # whether the solver reports success

    @property
    def rank(self) -> tuple[bool, float]:
        """Return the sort key of an answer."""
        good = self.violation <= MAX_VIOLATION and self.stable
        return (not good, self.log_error if good else self.violation + UNSTABLE_PENALTY * (not self.stable))


def _multistart(dense_problems: list[DenseProblem], scan_result: ScanResult, peer: Peer) -> tuple[list[_Answer], float]:
    """Run another solver from every start that can still win. Return its answers and the processor time, s."""
    answers: list[_Answer] = []
    began = process_time()
    for dense_problem, start in zip(dense_problems, _starts(scan_result), strict=True):
        good_errors = [answer.log_error for answer in answers if not answer.rank[0]]
        if log(start.error / WORTH_POLISHING) > min(good_errors, default=inf):
            continue
        stopped = peer.solver(dense_problem)
        log_error, slack = dense_problem.values(stopped.z)
        design = dense_problem.design(stopped.z)
        stable = spectral_radius(case_of(dense_problem.prepared.problem.device, *design)) < 1
        answers.append(_Answer(design, float(log_error[0]), max(0.0, -float(slack.min())), stable, stopped.converged))
    return answers, process_time() - began


def facts(rows: list[Row]) -> list[str]:
    """Return the findings: the best solver for each problem, and how the other answers compare."""
    ipopt_successes = [row for row in rows if row.solver.startswith(IPOPT) and row.succeeded]
    refuted = sum(row.verdict == Status.VIOLATED for row in ipopt_successes)
    better = [row for row in rows if row.solver == OURS and row.gap > LEAST_GAP]
    return [
        "The prover and the independent evaluator contradict each other "
        f"{sum(not row.consistent for row in rows)} times.",
        *(_summary_of_solver(solver, rows) for solver in dict.fromkeys(row.solver for row in rows)),
        f"IPOPT reports success on {len(ipopt_successes)} fixed grids, and {refuted} of these answers are refuted.",
        f"Problems on which a peer's proved error is lower than vctune's: {_listed_gaps(better)}.",
    ]


def _summary_of_solver(solver: str, rows: list[Row]) -> str:
    """Return a sentence on how often a solver's answers are proved and as good as the best, and on the time."""
    all_rows = [row for row in rows if row.solver == solver]
    good = [row for row in all_rows if row.verdict == Status.CERTIFIED and row.gap <= AS_GOOD_GAP]
    unproved = sum(row.verdict != Status.CERTIFIED for row in all_rows)
    shares = f"{len(good)} of {len(all_rows)} problems"
    summary = f"{solver}: as good as the best (within {AS_GOOD_GAP:.1%}) and proved on {shares}"
    if solver == OURS:
        return f"{summary}, {sum(row.seconds for row in all_rows):.2f} s for all of them."
    faster, aim_text = sum(row.pace > 1 for row in good), f", aim {AIMED_PACE:.2f}" if solver == MULTISTART else ""
    return (
        f"{summary}, faster than vctune on {faster} of these; {unproved} answers are not proved, "
        f"the worst violation is {max(row.violation for row in all_rows):.2g}; "
        f"vctune takes {median(row.pace for row in all_rows):.2f} of its time "
        f"(median over the problems{aim_text})."
    )


def _listed_gaps(rows: list[Row]) -> str:
    """Return the problems of the rows with their gaps, as text."""
    return ", ".join(f"{row.problem} (by {row.gap:.2g})" for row in rows) or "none"


def panels(rows: list[Row]) -> list[Panel]:
    """Draw the gap over the run time, with the proved answers marked, and the violation over the run time."""
    by_solver = {name: [row for row in rows if row.solver == name] for name in dict.fromkeys(r.solver for r in rows)}
    gap_panels = []
    for title, proved in (("proved", True), ("not proved", False)):
        series = []
        for solver, all_rows in by_solver.items():
            solver_rows = [row for row in all_rows if (row.verdict == Status.CERTIFIED) == proved]
            series.append(Series(solver, [row.seconds for row in solver_rows], [row.gap for row in solver_rows]))
        gap_panels.append(Panel(title, "processor time, s", "gap to the best proved error", series, LEAST_GAP))
    violations = [
        Series(name, [r.seconds for r in solver_rows], [r.violation for r in solver_rows])
        for name, solver_rows in by_solver.items()
    ]
    return [
        *gap_panels,
        Panel("all", "processor time, s", "greatest relative violation of a constraint", violations, LEAST_GAP),
    ]
