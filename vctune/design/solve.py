"""Solve a design problem from start to end: theorems, scan, optimum, search of every box (design/README.md, section
1)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import Prepared, pose, prepare
from vctune.design.result import Solved
from vctune.design.search.along_limit import LIGHTEST, best_along_limit, follows_limit, has_nothing_behind
from vctune.design.search.infeasible import Infeasibility, nearest_miss, out_of_time_before_a_design
from vctune.design.search.optimum import PROOF, SEARCH, Progress, improved, optimum
from vctune.design.search.scan import scan
from vctune.design.search.theorems import impossible
from vctune.design.search.wall import stiffest_wall
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import Problem
from vctune.running import OutOfTimeError, out_of_time

if TYPE_CHECKING:
    from vctune.design.bound.search import Optimality, SearchState

NOT_ALONE = "no mass and drag within their bounds was found that is stable in every hand that is asked for"
MORE_FELT = "allow more coupling.drag or coupling.mass"
NOT_BEFORE_WORLDS = "no design within the bounds was found that is stable with every stated environment in every hand"
NO_WALL = "no wall within the bounds of coupling was found that is stable in every hand"
NOT_DAMPED = "no design within the bounds was found with this damping ratio in every hand"
LESS_DAMPED = "demand a smaller stability.damping_ratio"
NO_CALM_WALL = "no wall within the bounds of coupling was found that no simulated kick keeps moving"
LESS_STIFF = "allow less coupling.stiffness"
BOUND = "the search of every box"  # Name of the search of every box among the stages that a time limit may cut short
# SEARCH_BOXES is the greatest number of boxes in the search of all designs, which runs if the optimiser finds no design
SEARCH_BOXES, SEARCH_GAP = 300_000, 0.01
STABILITY_BOXES = 1_500_000  # Greatest number of boxes in the proofs that loops are stable or unstable
# Greatest number of boxes in a first search, which tries to prove that there is no design before the optimiser runs
EARLY_BOXES = 20_000
# Greatest number of boxes in the search for a bound that the user requested; in practice there is no limit
BOUND_BOXES = 20_000_000


@np.errstate(all="ignore")
def solve(
    problem: Problem, progress: Progress = lambda stage: None, *, gap: float | None = None, exhaustive: bool = True
) -> Solved:
    """Find the most transparent feasible design and prove it. If the problem fixes every variable, judge the given
    design."""
    began, theorem = perf_counter(), impossible(problem)
    if problem.bounds.fixed and not (theorem is not None and problem.device.kind.inverse):  # a theorem of any gains
        fixed = judge(problem, *problem.fixed_design)
        cut = (PROOF,) * fixed.cut
        return Solved(problem=problem, judgement=fixed, seconds={"prove": perf_counter() - began}, cut=cut)
    if theorem is not None:
        return Solved(problem=problem, infeasibility=theorem)
    try:
        worlds = problem.worlds
        linear = worlds is not None and not worlds.walls
        if problem.rigid or follows_limit(problem) or (linear and gap is None):
            return _along_limit(problem, progress)
        return _found(problem, progress, gap, exhaustive=exhaustive)
    except OutOfTimeError:
        return Solved(problem=problem, infeasibility=out_of_time_before_a_design(), cut=(SEARCH,))


def _along_limit(problem: Problem, progress: Progress) -> Solved:
    """Search along the limit of the coupling. If nothing is proved before environments there, take the design for every
    passive environment, which is one for the stated ones too."""
    began = perf_counter()
    progress("following the limit of the coupling")
    proved = stiffest_wall(pose(problem)) if problem.rigid else best_along_limit(prepare(problem))
    found, alone = None if proved is None else proved.judgement, has_nothing_behind(problem)
    if found is None and problem.device.rule == "euler" and problem.bounds.mass.fixed:
        found = judge(problem, Gains(0.0, 0.0), _most_drag(problem))
    no_wall = NO_CALM_WALL if problem.stability.calm else NO_WALL
    miss = (no_wall, LESS_STIFF) if problem.rigid else (NOT_ALONE if alone else NOT_BEFORE_WORLDS, MORE_FELT)
    if (ratio := problem.stability.damping_ratio) is not None:
        miss = NOT_DAMPED, LESS_DAMPED
    wider = problem.worlds is not None and not (problem.rigid or follows_limit(problem)) and ratio is None
    if wider and (found is None or found.status is not Status.CERTIFIED):
        prepared = prepare(replace(problem, worlds=None))
        safe = optimum(prepared, scan(prepared.scaled), progress).judgement
        found, proved = (found, proved) if safe is None else (judge(problem, safe.gains, safe.coupling), None)
    late = found is not None and (found.cut or (found.status is Status.UNDECIDED and out_of_time()))
    return Solved(
        problem=problem,
        judgement=found,
        seen=None if proved is None or problem.rigid else proved.seen,
        infeasibility=None if found else Infeasibility(*miss, proved=False),
        seconds={"search": perf_counter() - began},
        cut=(PROOF,) * late,
    )


def _most_drag(problem: Problem) -> Coupling:
    """Return the law by Euler's rule of a fixed mass with the greatest drag that the rule and the bounds permit."""
    mass, drag = problem.bounds.mass.min, problem.bounds.drag
    most = mass / problem.device.sample_time / (1 + LIGHTEST)
    return Coupling(inf, mass, float(f"{min(drag.max, max(drag.min, most)):.6g}"))


def _found(problem: Problem, progress: Progress, gap: float | None, *, exhaustive: bool) -> Solved:
    """Search for a design."""
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
    best = optimum(prepared, scanned, progress)
    solved = Solved(
        problem=problem,
        judgement=best.judgement,
        polished=best.polished,
        optima=best.optima,
        scanned=scanned,
        seconds=seconds | best.seconds,
        cut=best.cut,
    )
    if exhaustive and (solved.judgement is None or gap is not None) and not out_of_time():
        solved = _searched(prepared, solved, progress, gap)
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


def _searched(prepared: Prepared, solved: Solved, progress: Progress, gap: float | None) -> Solved:
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
            progress=tell,
        )
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, BOUND))
    solved = replace(solved, cut=(*solved.cut, *(BOUND,) * (out_of_time() and not found.proved)))
    seconds = {**solved.seconds, "bound": perf_counter() - began}
    if found.improved is None:
        return replace(solved, optimality=found, seconds=seconds)
    return replace(solved, judgement=found.improved, polished=None, optimality=found, seconds=seconds)
