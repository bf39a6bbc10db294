"""Compute the least error under each of two criteria separately, which shows the cost of requiring both."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from vctune.design.prepared import of_one_device, pose
from vctune.design.result import Alternative, Solved
from vctune.design.search.optimum import estimated
from vctune.design.verdict.judge import Status
from vctune.document import reading
from vctune.document.reading import ProblemFile
from vctune.model.gains import SpringDamper
from vctune.model.problem import Criterion, Problem
from vctune.running import OutOfTimeError

COMPARISON = "the comparison of criteria"  # Name of a stage that a time limit may cut short


def with_alternatives(file: ProblemFile, solved: Solved) -> Solved:
    """Return a solved problem with the least error under each criterion; unchanged if the problem has one criterion."""
    problem = file.problem
    if problem.stability.criterion != "both" or problem.bounds.fixed or solved.status is not Status.CERTIFIED:
        return solved
    if not problem.device.kind.banded and of_one_device(problem) is None:
        return solved  # with a box of devices, the computation may take minutes
    others: tuple[Criterion, ...] = ("hands", "passive") if problem.device.kind.banded else ("hands",)
    tables, found = file.document, list[Alternative]()
    try:
        for criterion in others:
            posed = _under(criterion, tables, problem)
            alone = None if posed is None else _alternative(criterion, posed)
            found += [] if alone is None else [alone]
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, COMPARISON))
    return replace(solved, alternatives=found)


def _under(criterion: Criterion, tables: dict[str, Any], problem: Problem) -> Problem | None:
    """Return the problem of a file with one criterion; None if this criterion contradicts the rest of the file."""
    stability = {**tables.get("stability", {}), "criterion": criterion}
    return reading.pose({**tables, "stability": stability}, problem.name, problem)[0]


def _alternative(criterion: Criterion, problem: Problem) -> Alternative | None:
    one = problem if problem.device.kind.banded else of_one_device(problem)
    alone = None if one is None else one.fixed_design if one.bounds.fixed else estimated(one)
    if alone is None:
        return None
    error, coupling = pose(problem).error(*alone), alone[1]
    if isinstance(coupling, SpringDamper):
        return Alternative(criterion, error, stiffness=coupling.stiffness)
    return Alternative(criterion, error, drag=coupling.drag)
