"""What a design would be under one of two criteria alone: so that the price of asking for both is seen."""

from __future__ import annotations

from dataclasses import replace

from vctune.design.judge import Status
from vctune.design.optimum import estimated
from vctune.design.prepared import of_one_device, pose
from vctune.design.result import Alternative, Solved
from vctune.document.reading import ProblemFile
from vctune.document.reading import pose as pose_tables
from vctune.model.gains import SpringDamper
from vctune.model.problem import Criterion, Problem


def with_alternatives(file: ProblemFile, solved: Solved) -> Solved:
    """Return a solved problem with what either criterion alone would allow; unchanged where it has one anyway.

    Parameters
    ----------
    file : the problem
    solved : what came of it; certified, or there is nothing to compare with
    """
    problem = solved.problem
    if problem.stability.criterion != "both" or problem.bounds.fixed or solved.status is not Status.CERTIFIED:
        return solved
    others: tuple[Criterion, ...] = ("hands",) if problem.device.renders_force else ("hands", "passive")
    found = []
    for criterion in others:
        other = _with_criterion(file, criterion)
        if other is None:
            continue
        one = of_one_device(other) if other.device.renders_force else other
        if one is None:
            return solved  # a box of devices in a box of hands may take minutes
        alone = one.fixed_design if one.bounds.fixed else estimated(one)
        if alone is not None:
            stiffness = alone[1].stiffness if isinstance(alone[1], SpringDamper) else None
            found.append(Alternative(criterion, pose(problem).error(*alone), stiffness))
    return replace(solved, alternatives=found)


def _with_criterion(file: ProblemFile, criterion: Criterion) -> Problem | None:
    """Return what a file states with another criterion and that one's defaults; None if these contradict each other."""
    stated = file.document
    stated["stability"] = stated.get("stability", {}) | {"criterion": criterion}
    return pose_tables(stated, file.problem.name)[0]
