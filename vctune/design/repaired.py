"""What would repair a problem that was solved in vain, or cure a design that hardly uses its velocity loop."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

from vctune.design.judge import Judgement, Status
from vctune.design.levers import levers, levers_of_demands
from vctune.design.optimum import attained
from vctune.design.repair import JUDGED, JUDGED_IN_USE, Progress, Repair, Trial, in_use, repairs
from vctune.design.result import Solved
from vctune.design.solve import solve
from vctune.document import toml
from vctune.document.problem import Problem
from vctune.document.reading import ProblemFile


def _designed(problem: Problem) -> Judgement | None:
    solved = solve(problem)
    return solved.judgement if solved.status is Status.CERTIFIED else None


SOLVED = Trial(lambda problem: attained(problem) is not None, _designed, 0.05)
SOLVED_IN_USE = Trial(
    lambda problem: in_use(attained(problem)) is not None, lambda problem: in_use(_designed(problem)), 0.05
)
"""Of problems that leave something free; of the same until their designs use the velocity loop."""


def repaired(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return what came of a problem with its repairs, where it has no design, its own is refuted, or is idle.

    Parameters
    ----------
    file : the problem
    solved : what came of it
    progress : told the stage of the work
    """
    judgement, began = solved.judgement, perf_counter()
    if judgement is not None and judgement.status is Status.CERTIFIED and judgement.idle:
        found = cures(file, progress)
    elif judgement is None or solved.status is Status.VIOLATED:
        document, trial = toml.parse(file.text, file.problem.name), JUDGED if file.problem.bounds.fixed else SOLVED
        found = repairs(document, levers(document, file.problem), trial, progress)
    else:
        return solved
    return replace(solved, repairs=found, seconds={**solved.seconds, "repairs": perf_counter() - began})


def cures(file: ProblemFile, progress: Progress = lambda stage: None) -> list[Repair]:
    """Return the least changes of one demand after which a problem's design uses its velocity loop."""
    document, trial = (
        toml.parse(file.text, file.problem.name),
        JUDGED_IN_USE if file.problem.bounds.fixed else SOLVED_IN_USE,
    )
    return repairs(document, levers_of_demands(document, file.problem), trial, progress)
