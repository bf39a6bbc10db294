"""How the search for repairs tries a changed problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vctune.design.verdict.judge import Judgement
from vctune.model.problem import Problem


@dataclass(frozen=True, slots=True)
class RepairTest:
    """How a changed problem is tried.

    Attributes
    ----------
    estimate : a first opinion
    verify : its design, if that is certified; None if there is none
    width : how closely the least change is bracketed, relative
    furthest_first : whether a change that may not suffice however far it goes is given up at once
    """

    estimate: Callable[[Problem], bool]
    verify: Callable[[Problem], Judgement | None]
    width: float
    furthest_first: bool = False
