"""`vctune solve`, as a function."""

from __future__ import annotations

from vctune.design.optimum import Progress
from vctune.design.repair import with_repairs
from vctune.design.result import Solved
from vctune.design.solve import solve as find
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.errors import InputError, Mistake

GAPS = (1e-4, 10.0)
"""Least and greatest gap that can be asked for: below, rounding shows; above, a bound says nothing."""


def solve(problem: ProblemSource, *, gap: float | None = None, progress: Progress = lambda stage: None) -> Solved:
    """Find the most transparent admissible design and prove it; judge it when every number is fixed.

    Parameters
    ----------
    problem : path of a problem file, its tables as a dict, or the problem
    gap : prove that no design has an error lower by more than this share
    progress : told the stage of the work

    Returns
    -------
    Solved
        `status`; `judgement`, the best design and what is proved of it, None if there is none; else `reason` and
        `repairs`, the least changes of one number of the problem after which there is one.

    Raises
    ------
    InputError
        If the problem is none, or the gap out of range.
    """
    if gap is not None:
        require_gap(gap)
    file = problem_of(problem)
    return with_repairs(file, find(file.problem, progress, gap=gap), progress)


def require_gap(gap: float) -> None:
    """Make sure that a gap can be proved.

    Raises
    ------
    InputError
        If it is out of range.
    """
    low, high = GAPS
    if not low <= gap <= high:
        raise InputError("gap", [Mistake("", f"{gap:g} is out of range: must be from {low:g} to {high:g}")])
