"""Define the functions with which the search for repairs tests a changed problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.design.verdict.judge import Judgement
from vctune.model.problem import Problem


@dataclass(frozen=True, slots=True)
class RepairTest:
    """Functions and limits with which the search for repairs tests a changed problem.

    Attributes
    ----------
    estimate : function that returns whether a problem seems to have a design
    verify : function that returns the problem's design if it is certified, else None
    width : relative accuracy of the least change that suffices
    furthest_first : whether to try the largest change first, and no smaller one if it does not suffice
    """

    estimate: Callable[[Problem], bool]
    verify: Callable[[Problem], Judgement | None]
    width: float
    furthest_first: bool = False
