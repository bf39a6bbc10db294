"""A problem that was solved in vain, with what would repair it."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

from vctune.design.judge import Judgement, Status
from vctune.design.optimum import attainable
from vctune.design.repair import JUDGED, Progress, Trial, repairs
from vctune.design.result import Solved
from vctune.design.solve import solve
from vctune.document import toml
from vctune.document.problem import Problem
from vctune.document.reading import ProblemFile


def _designed(problem: Problem) -> Judgement | None:
    solved = solve(problem)
    return solved.judgement if solved.status is Status.CERTIFIED else None


SOLVED = Trial(attainable, _designed, 0.05)
"""Of problems that leave something free."""


def repaired(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return what came of a problem with its repairs, where it has no design or its own is refuted.

    Parameters
    ----------
    file : the problem
    solved : what came of it
    progress : told the stage of the work
    """
    if solved.judgement is not None and solved.status is not Status.VIOLATED:
        return solved
    began = perf_counter()
    document, trial = toml.parse(file.text, file.problem.name), JUDGED if file.problem.bounds.fixed else SOLVED
    found = repairs(document, file.problem, trial, progress)
    return replace(solved, repairs=found, seconds={**solved.seconds, "repairs": perf_counter() - began})
