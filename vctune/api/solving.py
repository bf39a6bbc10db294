"""Provide `vctune solve` as a function."""

from __future__ import annotations

from math import inf

from vctune.api.argument_ranges import GAPS
from vctune.design.result import Solved
from vctune.design.search.optimum import Progress
from vctune.design.solve import solve as find
from vctune.design.verdict.prices import with_prices
from vctune.design.verdict.repair import with_repairs
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.text.errors import InputError
from vctune.running import time_limit as limited


def solve(
    problem: ProblemSource,
    *,
    gap: float | None = None,
    prices: bool = False,
    time_limit: float = inf,
    progress: Progress = lambda stage: None,
) -> Solved:
    """Find the most transparent feasible design and prove it.

    If the problem fixes every variable, judge the fixed design.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    gap : float, optional
        Share by which the error may exceed the proved lower bound on the error of every design; None for no
        such proof.
    prices : bool
        Whether to compute the prices of a certified local optimum: the decrease of the error if a parameter of
        the device were better by 1 %.
    time_limit : float
        Seconds after which the function returns the result so far; `cut` then names the missing parts.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    Solved
        `status`, and `judgement` with the best design and its proved claims. Without a design, `judgement` is None,
        `reason` states why, and `repairs` lists changes of one value that give a design, the least error first. A
        refuted or idle design also has `repairs`. `prices`, if requested, begins with the greatest decrease of the
        error.

    Raises
    ------
    InputError
        If the problem is invalid; if the gap is out of range; or if a gap is requested and vctune cannot bound the
        error from below.
    """
    file = problem_of(problem)
    if gap is not None:
        require_gap(gap)
    with limited(time_limit):
        solved = with_repairs(file, find(file.problem, progress, gap=gap), progress)
        known = f"; {solved.known}"
        progress(f"pricing the device{known}")
        return with_prices(solved) if prices else solved


def require_gap(gap: float) -> None:
    """Check that a gap is in the range that vctune can prove."""
    low, high = GAPS
    if not low <= gap <= high:
        raise InputError.of("gap", "bad-option", f"{gap:g} is out of range: must be from {low:g} to {high:g}")
