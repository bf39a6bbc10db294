"""What a design would be under one of two criteria alone: so that the price of asking for both is seen."""

from __future__ import annotations

from dataclasses import replace

from vctune.design.judge import Status
from vctune.design.optimum import estimated
from vctune.design.prepared import of_one_device, pose
from vctune.design.result import Alternative, Solved
from vctune.model.gains import SpringDamper
from vctune.model.problem import Criterion
from vctune.running import OutOfTimeError

COMPARISON = "the comparison of criteria"
"""What a time limit may cut short."""


def with_alternatives(solved: Solved) -> Solved:
    """Return a solved problem with what either criterion alone would allow; unchanged where it has one anyway.

    Parameters
    ----------
    solved : certified, or there is nothing to compare with
    """
    problem = solved.problem
    if problem.stability.criterion != "both" or problem.bounds.fixed or solved.status is not Status.CERTIFIED:
        return solved
    one = of_one_device(problem) if problem.device.renders_force else problem
    if one is None:
        return solved  # a box of devices in a box of hands may take minutes
    others: tuple[Criterion, ...] = ("hands",) if problem.device.renders_force else ("hands", "passive")
    found = []
    try:
        for criterion in others:
            alone = estimated(replace(one, stability=replace(problem.stability, criterion=criterion)))
            if alone is not None:
                stiffness = alone[1].stiffness if isinstance(alone[1], SpringDamper) else None
                found.append(Alternative(criterion, pose(problem).error(*alone), stiffness))
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, COMPARISON))
    return replace(solved, alternatives=found)
