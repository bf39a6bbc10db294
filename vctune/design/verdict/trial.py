"""How the search for repairs tests a changed problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.design.verdict.judge import Judgement
from vctune.model.problem import Problem


@dataclass(frozen=True, slots=True)
class RepairTest:
    """Functions and limits with which a changed problem is tested.

    Attributes
    ----------
    estimate : function that returns whether a problem seems to have a design
    verify : function that returns the problem's design if it is certified, else None
    width : relative width to which the least change is bracketed
    furthest_first : whether to give up a change at once if its furthest value does not suffice
    """

    estimate: Callable[[Problem], bool]
    verify: Callable[[Problem], Judgement | None]
    width: float
    furthest_first: bool = False
