"""Define the functions with which the search for repairs tests a changed problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.design.verdict.judge import Judgement
from vctune.model.problem import Problem


@dataclass(frozen=True, slots=True)
class RepairTest:
    """Functions and limits with which the search for repairs tests a changed problem."""

    estimate: Callable[[Problem], bool]  # function that returns whether a problem seems to have a design
    verify: Callable[[Problem], Judgement | None]
    width: float  # relative accuracy of the least change that suffices
    furthest_first: bool = False  # whether to try the largest change first, and no smaller one if it does not suffice
