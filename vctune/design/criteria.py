"""What a design would be under one of two criteria alone: so that the price of asking for both is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from vctune.design.estimate import estimated
from vctune.design.judge import Status
from vctune.design.result import Solved
from vctune.model.problem import Criterion


@dataclass(frozen=True, slots=True)
class Alternative:
    """The error of a design under one criterion alone, as the optimiser finds it: nothing of it is proved.

    Attributes
    ----------
    criterion : "hands" or "passive"
    error : of its design
    """

    criterion: Criterion
    error: float


def with_alternatives(solved: Solved) -> Solved:
    """Return a solved problem with what either criterion alone would allow; unchanged where it has one anyway.

    Parameters
    ----------
    solved : certified, or there is nothing to compare with
    """
    problem = solved.problem
    if problem.stability.criterion != "both" or problem.bounds.fixed or solved.status is not Status.CERTIFIED:
        return solved
    alone: dict[Criterion, float] = {
        one: estimated(replace(problem, stability=replace(problem.stability, criterion=one)))
        for one in ("hands", "passive")
    }
    found = [Alternative(one, error) for one, error in alone.items() if error < inf]
    return replace(solved, alternatives=found)
