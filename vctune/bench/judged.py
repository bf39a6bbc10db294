"""Judge the answer of any solver with vctune's prover and with the independent evaluator."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from vctune.bench import evaluator
from vctune.design.verdict.judge import Status, judge
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem

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
