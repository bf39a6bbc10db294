"""What an answer is worth, whoever gave it: vctune's prover and the independent evaluator, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from vctune.bench.evaluator import opinion
from vctune.design.judge import Status, judge
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains

AGREEMENT = 1e-6
"""Relative difference of the two errors beyond which they contradict each other."""


@dataclass(frozen=True, slots=True)
class Worth:
    """What an answer is worth.

    Attributes
    ----------
    error : transparency error, by the independent evaluator
    violation : by how much the demands are exceeded at the worst, relative; also where the prover pointed
    stable : whether the sampled loop is stable, by the eigenvalues of its companion matrix
    verdict : the prover's
    consistent : whether prover and evaluator do not contradict each other
    """

    error: float
    violation: float
    stable: bool
    verdict: Status
    consistent: bool


def worth(problem: Problem, gains: Gains, coupling: Coupling) -> Worth:
    """Judge an answer twice."""
    judged = judge(problem, gains, coupling)
    witnesses = [outcome.witness for outcome in judged.certificate.outcomes.values() if outcome.witness]
    seen = opinion(problem, gains, coupling, [*witnesses, judged.worst, judged.worst_sensitivity])
    verdict = judged.status
    same = abs(judged.transparency.error - seen.error) <= AGREEMENT * seen.error or not seen.error < inf
    sound = verdict is not Status.CERTIFIED or (seen.violation == 0 and seen.stable)
    return Worth(seen.error, seen.violation, seen.stable, verdict, same and sound)
