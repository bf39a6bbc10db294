"""Judge the answer of any solver with vctune's prover and with the independent evaluator."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from vctune.bench import evaluator
from vctune.design.verdict.judge import Status, judge
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem

AGREEMENT = 1e-6
"""Relative difference between the errors of prover and evaluator above which they contradict each other."""


@dataclass(frozen=True, slots=True)
class JudgedAnswer:
    """The judgement on an answer.

    Attributes
    ----------
    error : transparency error by the independent evaluator
    violation : logarithm of the greatest relative violation of the constraints on Re Z_c/R and |S|, on the grids of the
        evaluator and at the frequencies that the prover names; 0 without a violation
    stable : whether the eigenvalues of the sampled loop without a hand lie inside the unit circle
    verdict : status of the answer by the prover
    consistent : whether prover and evaluator do not contradict each other: their errors agree or are not finite, and a
        certified answer has no violation and is stable
    """

    error: float
    violation: float
    stable: bool
    verdict: Status
    consistent: bool


def judge_answer(problem: Problem, gains: Gains, coupling: AnyCoupling) -> JudgedAnswer:
    """Judge an answer by the prover and by the evaluator.

    Parameters
    ----------
    problem : problem of an admittance display without parts, with the criterion "passive"
    gains, coupling : the answer to judge

    Returns
    -------
    JudgedAnswer
        The verdict of vctune's prover, and the error and violation by the independent evaluator.
    """
    judged = judge(problem, gains, coupling)
    witnesses = [outcome.witness for outcome in judged.certificate.outcomes.values() if outcome.witness]
    case = evaluator.case_of(problem.device, gains, coupling)
    error, stable = float(evaluator.error(problem, case)), evaluator.spectral_radius(case) < 1
    violation = evaluator.violation(problem, case, [*witnesses, judged.worst, judged.worst_sensitivity])
    verdict = judged.status
    same = abs(judged.transparency.error - error) <= AGREEMENT * error or not error < inf
    sound = verdict is not Status.CERTIFIED or (violation == 0 and stable)
    return JudgedAnswer(error, violation, stable, verdict, same and sound)
