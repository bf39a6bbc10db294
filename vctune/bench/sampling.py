"""A fixed grid of frequencies against the exchange: what more samples cost, and what they miss."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.bench.benchmark import Measured, Size, Tick
from vctune.bench.dense import casadi_solve, dense
from vctune.bench.judged import Worth, worth
from vctune.bench.problems import reference_problems
from vctune.bench.timing import timed
from vctune.design.exchange import TIGHTENING, polish
from vctune.design.judge import Status
from vctune.design.rounding import rounded
from vctune.design.scan import ScanResult, scan
from vctune.design.start import Start
from vctune.design.units import dimensionless, physical
from vctune.design.variables import design_of
from vctune.document.problem import Problem
from vctune.report.benchmarks import Panel, Series

EXCHANGE, FIXED = "exchange", "fixed grid"
REPEATS = 3
NOTHING = 1e-9
"""Violations below this are drawn here."""


@dataclass(frozen=True, slots=True)
class Row:
    """One start of a problem, solved on one set of frequencies.

    Attributes
    ----------
    frequencies : for each kind of demand on a fixed grid; of all kinds in the last round of the exchange
    seconds : median processor time, the solver compiled before, without scan and proof
    iterations : of IPOPT, all rounds together
    error : transparency error
    violation : relative, anywhere, also where the prover pointed
    succeeded : whether IPOPT says so
    stable, verdict, consistent : see `vctune.bench.judged.Worth`
    """

    problem: str
    method: str
    frequencies: int
    seconds: float
    iterations: int
    error: float
    violation: float
    succeeded: bool
    stable: bool
    verdict: str
    consistent: bool


def measure(size: Size, tick: Tick) -> Measured:
    """Solve the reference problems from their best start on grids and by the exchange."""
    rows: list[Row] = []
    for name, problem in reference_problems(1 if size.quick else None).items():
        scaled = dimensionless(problem)
        seen = scan(scaled)
        start = seen.starts[0]
        tick(f"{name}: exchange")
        rows.append(_exchanged(name, problem, scaled, seen))
        for power in range(3, 10 if size.quick else 13):
            tick(f"{name}: {2**power} frequencies")
            rows.append(_fixed(name, problem, scaled, start, 2**power))
    return Measured(
        "Fixed grids against the exchange",
        "The true violation of what IPOPT returns: each curve is one problem on grids of 8, 16, ... frequencies; what "
        f"violates nothing lies on the dotted line at {NOTHING:g}, as all of the exchange's answers should.",
        {"sampling": rows},
        facts(rows),
        panels(rows),
    )


def _exchanged(name: str, problem: Problem, scaled: Problem, seen: ScanResult) -> Row:
    polish(scaled, seen.starts[0], seen)
    found, seconds = timed(lambda: polish(scaled, seen.starts[0], seen), REPEATS)
    assert found is not None
    result = worth(problem, *design_of(rounded(problem, physical(problem, found.values))))
    iterations = sum(each.solution.iterations for each in found.rounds)
    return _row(name, EXCHANGE, found.rounds[-1].frequencies, seconds, iterations, found.solution.converged, result)


def _fixed(name: str, problem: Problem, scaled: Problem, start: Start, count: int) -> Row:
    given = dense(problem, scaled, start, count, TIGHTENING)
    casadi_solve(given, "ipopt")
    stopped, seconds = timed(lambda: casadi_solve(given, "ipopt"), REPEATS)
    result = worth(problem, *given.design(stopped.z))
    return _row(name, FIXED, count, seconds, stopped.iterations, stopped.converged, result)


def _row(
    name: str, method: str, frequencies: int, seconds: float, iterations: int, succeeded: bool, found: Worth
) -> Row:
    return Row(
        name, method, frequencies, seconds, iterations, found.error, found.violation, succeeded, found.stable,
        found.verdict.value, found.consistent,
    )  # fmt: skip


def facts(rows: list[Row]) -> list[str]:
    """Say how often a grid succeeds and is refuted, and what the exchange costs."""
    fixed, exchanged = ([row for row in rows if row.method == method] for method in (FIXED, EXCHANGE))
    succeeded = [row for row in fixed if row.succeeded]
    refuted = [row for row in succeeded if row.verdict != Status.CERTIFIED]
    proved = sum(row.verdict == Status.CERTIFIED for row in exchanged)
    contradictions = sum(not row.consistent for row in rows)
    said = [
        f"IPOPT says that it succeeded on {len(succeeded)} of {len(fixed)} fixed grids; {len(refuted)} of these "
        f"answers are not proved, {sum(not row.stable for row in succeeded)} close an unstable loop.",
        f"The exchange's answers are proved on {proved} of {len(exchanged)} problems.",
        f"Prover and independent evaluator contradict each other {contradictions} times.",
    ]
    for count in dict.fromkeys(row.frequencies for row in fixed):
        own = [row for row in fixed if row.frequencies == count]
        good = sum(row.verdict == Status.CERTIFIED for row in own)
        worst = max(row.violation for row in own)
        said.append(f"{count} frequencies: {good} of {len(own)} answers proved, greatest violation {worst:.2g}.")
    return said


def panels(rows: list[Row]) -> list[Panel]:
    """Draw the violation against run time and against frequencies."""
    fixed, exchanged = ([row for row in rows if row.method == method] for method in (FIXED, EXCHANGE))
    drawn = []
    for label, across in (("processor time, s", "seconds"), ("frequencies of each kind", "frequencies")):
        series = []
        for name in dict.fromkeys(row.problem for row in rows):
            own = [row for row in fixed if row.problem == name]
            series.append(Series(name, [getattr(row, across) for row in own], [row.violation for row in own], True))
        ours = Series(EXCHANGE, [getattr(row, across) for row in exchanged], [row.violation for row in exchanged])
        drawn.append(Panel("", label, "true violation, relative", [*series, ours], NOTHING))
    return drawn
