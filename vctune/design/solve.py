"""Solve a design problem from start to end: theorems, scan, optimum, search of every box (design/README.md, section
1)."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from vctune.design.prepared import Prepared, prepare
from vctune.design.result import Solved
from vctune.design.search.optimum import PROOF, SEARCH, SEARCHING, Progress, improved, nominal_start, optimum
from vctune.design.search.scan import scan
from vctune.design.search.theorems import impossible
from vctune.design.verdict.infeasible import nearest_miss, out_of_time_before_a_design
from vctune.design.verdict.judge import judge
from vctune.model.problem import Problem
from vctune.running import OutOfTimeError, out_of_time, seconds_left, time_limit

if TYPE_CHECKING:
    from vctune.design.bound.resume import ResumeState
    from vctune.design.bound.search import Optimality, SearchState

BOUND = "the search of every box"
"""Name of the search of every box among the stages that a time limit may cut short."""
SEARCH_BOXES, SEARCH_GAP = 300_000, 0.01
"""SEARCH_BOXES is the greatest number of boxes in the search of all designs, which runs if the optimiser finds no
design.

If the search evaluates each box on several devices, it divides this number by the number of devices; the first, short
search does not. The search then takes about as long as a user would wait for an answer. With half as many boxes it
proves fewer problems infeasible; with twice as many it proves only a few more. SEARCH_GAP is the gap at which the
search accepts a design: 1 %.
"""
STABILITY_BOXES = 1_500_000
"""Greatest number of boxes in the proofs that loops are stable or unstable. Each of these boxes takes a tenth of the
time of a box with a lower bound. The problems of problems/ need about as many stability boxes as boxes with a lower
bound. A loop with a sample time of half an hour needs more than a hundred times as many. With half or twice this
number, a search without a result takes half or twice the time."""
EARLY_BOXES = 20_000
"""Greatest number of boxes in a first search, which tries to prove that there is no design before the optimiser runs.
This number is a small share of `SEARCH_BOXES`. The later search continues where the first one ended, so no work is
lost.
"""
BOUND_BOXES = 20_000_000
"""Greatest number of boxes in the search for a bound that the user requested; in practice there is no limit. If Ctrl-C
or a time limit ends the search earlier, the result has the bound reached so far."""


@np.errstate(all="ignore")
def solve(
    problem: Problem, progress: Progress = lambda stage: None, *, gap: float | None = None, exhaustive: bool = True
) -> Solved:
    """Find the most transparent feasible design and prove it. If the problem fixes every variable, judge the given
    design.

    If the optimiser finds no design, a search over all designs (`vctune.design.bound`) finds one, proves that there is
    none, or ends without a result. If the device is uncertain, the function also solves the problem for only the
    nominal device. This nominal design is one more start, and its error shows the cost of robustness.

    Parameters
    ----------
    problem : problem in SI units
    progress : function that receives the current stage
    gap : relative gap; the function proves that no design has an error that is lower than the result's by more than
        this share. None for no such proof
    exhaustive : whether to search every box if the optimiser finds no design, or if `gap` is given; with a box of
        environments the function searches every box only if `gap` is given

    Returns
    -------
    Solved
        The design with its certificate, or the reason why there is none, in SI units. The function does not search for
        repairs. If the time limit ends the work, the result is the best design so far with its proved claims, and `cut`
        names the stages that the time limit cut short.
    """
    began = perf_counter()
    if problem.bounds.fixed:
        fixed = judge(problem, *problem.fixed_design)
        cut = (PROOF,) * fixed.cut
        return Solved(problem=problem, judgement=fixed, seconds={"prove": perf_counter() - began}, cut=cut)
    theorem = impossible(problem)
    if theorem is not None:
        return Solved(problem=problem, infeasibility=theorem)
    try:
        return _found(problem, progress, gap, exhaustive=exhaustive)
    except OutOfTimeError:
        return Solved(problem=problem, infeasibility=out_of_time_before_a_design(), cut=(SEARCH,))


def _found(problem: Problem, progress: Progress, gap: float | None, *, exhaustive: bool) -> Solved:
    """Search for a design.

    Raises
    ------
    OutOfTimeError
        If the time limit ends the work before the search has any result.
    """
    began = perf_counter()
    progress("scanning")
    prepared = prepare(problem)
    scanned = scan(prepared.scaled)
    seconds = {"scan": perf_counter() - began}
    admissible = any(start.admissible for start in scanned.starts)
    exhaustive &= problem.worlds is None or gap is not None  # with environments, the bound is weak
    early = _early(prepared) if exhaustive and not admissible else None
    if early is not None and early.proved:
        seconds["bound"] = perf_counter() - began - seconds["scan"]
        miss = nearest_miss(prepared, scanned, proved=True)
        return Solved(problem=problem, infeasibility=miss, scanned=scanned, seconds=seconds, optimality=early)
    waited = perf_counter()
    nominal = None
    if problem.uncertainty is not None:
        progress("solving for the nominal device")
        with suppress(OutOfTimeError), time_limit(SEARCHING * seconds_left()):
            nominal = nominal_start(prepared)
        seconds["nominal"] = perf_counter() - waited
    starts = [nominal[0], *scanned.starts] if nominal is not None else scanned.starts
    best = optimum(prepared, replace(scanned, starts=starts), progress)
    solved = Solved(
        problem=problem,
        judgement=best.judgement,
        polished=best.polished,
        optima=best.optima,
        scanned=scanned,
        seconds=seconds | best.seconds,
        nominal_error=nominal[1] if nominal is not None else None,
        cut=best.cut,
    )
    if exhaustive and (solved.judgement is None or gap is not None) and not out_of_time():
        solved = _searched(prepared, solved, progress, gap, early.resume if early else None)
    if solved.judgement is None:
        proved = solved.optimality is not None and solved.optimality.proved
        cut = out_of_time() and not proved
        miss = out_of_time_before_a_design() if cut else nearest_miss(prepared, scanned, proved=proved)
        solved = replace(solved, infeasibility=miss)
    return solved


def _early(prepared: Prepared) -> Optimality:
    """Search the boxes for a short time, to prove that there is no design if the scan found no feasible point."""
    from vctune.design.bound.search import bound

    share = EARLY_BOXES / SEARCH_BOXES
    return bound(
        prepared.given,
        None,
        lambda gains, limit: None,
        gap=SEARCH_GAP,
        most_boxes=EARLY_BOXES,
        most_stability_boxes=share * STABILITY_BOXES,
    )


def _searched(
    prepared: Prepared, solved: Solved, progress: Progress, gap: float | None, resume: ResumeState | None
) -> Solved:
    """Search the remaining boxes for a design if the optimiser found none, or for the bound that the user requested."""
    from vctune.design.bound.search import bound

    began = perf_counter()

    def tell(at: SearchState) -> None:
        progress(f"searching every box: {at}")

    most, within = (SEARCH_BOXES // len(prepared.given.cases), SEARCH_GAP) if gap is None else (BOUND_BOXES, gap)
    improve = partial(improved, prepared)
    try:
        known = solved.judgement
        found = bound(
            prepared.given,
            known,
            improve,
            gap=within,
            most_boxes=most,
            most_stability_boxes=STABILITY_BOXES if gap is None else inf,
            resume=resume,
            progress=tell,
        )
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, BOUND))
    solved = replace(solved, cut=(*solved.cut, *(BOUND,) * (out_of_time() and not found.proved)))
    seconds = {**solved.seconds, "bound": perf_counter() - began}
    if found.improved is None:
        return replace(solved, optimality=found, seconds=seconds)
    return replace(solved, judgement=found.improved, polished=None, optimality=found, seconds=seconds)
