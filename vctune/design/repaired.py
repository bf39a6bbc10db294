"""What would repair a problem that was solved in vain, or cure a design that hardly uses its velocity loop."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

from vctune.design.judge import Judgement, Status
from vctune.design.levers import levers, levers_of_demands
from vctune.design.optimum import attained
from vctune.design.repair import JUDGED, JUDGED_IN_USE, Progress, Repair, Trial, in_use, repairs
from vctune.design.result import Solved
from vctune.design.solve import solve
from vctune.document import toml
from vctune.document.reading import ProblemFile
from vctune.model.problem import Problem


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
    problem, judgement, began = file.problem, solved.judgement, perf_counter()
    idle = judgement is not None and judgement.idle
    if judgement is not None and solved.status is not Status.VIOLATED and not idle:
        return solved
    document = toml.parse(file.text, problem.name)
    if idle:
        found = cures(document, problem, progress)
    else:
        found = repairs(document, levers(document, problem), JUDGED if problem.bounds.fixed else SOLVED, progress)
    return replace(solved, repairs=found, seconds={**solved.seconds, "repairs": perf_counter() - began})


def cures(document: dict[str, Any], problem: Problem, progress: Progress = lambda stage: None) -> list[Repair]:
    """Return the least changes of one demand after which a problem has a design that uses its velocity loop.

    Parameters
    ----------
    document : parsed TOML
    problem : that it states, whose own design does not
    progress : told what is tried
    """
    trial = JUDGED_IN_USE if problem.bounds.fixed else SOLVED_IN_USE
    return repairs(document, levers_of_demands(document, problem), trial, progress)


def has_design_in_use(problem: Problem) -> bool:
    """Return whether solving a problem finds a design that uses its velocity loop."""
    return not problem.bounds.fixed and SOLVED_IN_USE.certified(problem) is not None
