"""What a design would be under one of two criteria alone: so that the price of asking for both is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vctune.design.estimate import estimated
from vctune.design.judge import Status
from vctune.design.prepared import of_one_device, pose
from vctune.design.result import Solved
from vctune.model.gains import SpringDamper
from vctune.model.problem import Criterion


@dataclass(frozen=True, slots=True)
class Alternative:
    """The error of a design under one criterion alone, as the optimiser finds it: nothing of it is proved.

    Attributes
    ----------
    criterion : "hands" or "passive"
    error : of its design
    stiffness : of an impedance display's, N/m
    """

    criterion: Criterion
    error: float
    stiffness: float | None = None


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
    for criterion in others:
        alone = estimated(replace(one, stability=replace(problem.stability, criterion=criterion)))
        if alone is not None:
            stiffness = alone.coupling.stiffness if isinstance(alone.coupling, SpringDamper) else None
            error = alone.error if one is problem else pose(problem).error(alone.gains, alone.coupling)
            found.append(Alternative(criterion, error, stiffness))
    return replace(solved, alternatives=found)
