"""What a design would be under one of two criteria alone: so that the price of asking for both is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vctune.design.judge import Status
from vctune.design.optimum import attained
from vctune.design.result import Solved
from vctune.model.problem import Criterion


@dataclass(frozen=True, slots=True)
class Alternative:
    """The error of a certified design under one criterion alone.

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
    found = []
    one: Criterion
    for one in ("hands", "passive"):
        alone = attained(replace(problem, stability=replace(problem.stability, criterion=one)))
        if alone is not None:
            found.append(Alternative(one, alone.error))
    return replace(solved, alternatives=found)
