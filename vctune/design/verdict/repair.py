"""Find repairs: changes of one value that make a design possible, each sufficient alone, the least error first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from time import perf_counter
from typing import Any

import numpy as np

from vctune.analysis.demands import sensitivity_maxima
from vctune.analysis.in_hands import least_ratios, ratio_in_some_hands
from vctune.design.prepared import pose as pose_devices
from vctune.design.result import Repair, Solved
from vctune.design.verdict.judge import Judgement, Status, judge, least_ratio
from vctune.design.verdict.parameter_changes import (
    ParameterChange,
    change_of_gain,
    parameter_changes,
)
from vctune.document.gains_file import design_numbers, design_tables
from vctune.document.reading import ProblemFile, pose
from vctune.document.text import toml
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.keys import SYMBOLS
from vctune.model.problem import Problem
from vctune.proof.claims.loop_claims import stable_loop
from vctune.proof.prover import boxes_at_most
from vctune.running import OutOfTimeError, check_time, out_of_time

REPAIRS = "the repairs"  # Name of a stage that a time limit may cut short
# Greatest numbers of changed problems that a search solves, or of changed designs that it judges. They bound its time
# and, unlike a number of seconds, give the same answer on every machine
MOST_SOLVED, MOST_JUDGED = 10, 24
MOST_BOXES = 20_000  # Greatest number of boxes of each proof of a changed design
# Share by which the screening requires a greater ratio than the limit, so that the proof of rounded gains succeeds
SLACK = 1e-5

Progress = Callable[[str], None]
Posed = Callable[[dict[str, Any]], Problem | None]


@dataclass(frozen=True, slots=True)
class RepairTest:
    """Functions with which the search for repairs tests a changed problem."""

    estimate: Callable[[Problem], bool]  # whether a problem seems to have a design
    verify: Callable[[Problem], Judgement | None]  # its certified design
    most: int  # greatest number of problems to verify


def _posed(document: dict[str, Any]) -> Problem | None:
    return pose(document, "")[0]


def _seems_admissible(problem: Problem) -> bool:
    """Return whether the fixed design of a problem meets the constraints in double precision, with proved stable
    poles."""
    return all(_seems_admissible_on(case, *problem.fixed_design) for case in pose_devices(problem).cases)


def _seems_admissible_on(problem: Problem, gains: Gains, coupling: AnyCoupling) -> bool:
    least = problem.stability.safety_factor * (1 + SLACK)
    if problem.passive and least_ratio(problem, gains, coupling)[0] < least:
        return False
    if -sensitivity_maxima(problem, gains).value[0] > problem.stability.max_sensitivity:
        return False
    if ratio_in_some_hands(problem, gains, coupling) < least:
        return False
    if any(worst.ratio < least for worst in least_ratios(problem, gains, coupling)):
        return False
    return all(stable_loop(loop, gains, model=problem.passive) for loop in problem.device.loops)


def _judged(problem: Problem) -> Judgement | None:
    with boxes_at_most(MOST_BOXES):
        judgement = judge(problem, *problem.fixed_design)
    return judgement if judgement.status is Status.CERTIFIED else None


def _solved(problem: Problem) -> Judgement | None:
    from vctune.design.solve import solve

    # without the search of every box, which can take half a minute
    solved = solve(problem, exhaustive=False)
    if solved.cut:  # the time limit cut the solution short
        raise OutOfTimeError
    judgement = solved.judgement
    return judgement if judgement is not None and judgement.status is Status.CERTIFIED else None


def _seems_solvable(problem: Problem) -> bool:
    from vctune.design.search.optimum import within_reach

    return within_reach(problem) is not None


OF_FIXED = RepairTest(_seems_admissible, _judged, MOST_JUDGED)
# Tests for problems that fix every variable of the design, and for problems that leave one variable free
OF_FREE = RepairTest(_seems_solvable, _solved, MOST_SOLVED)


def with_repairs(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return the result of a problem with repairs if it has no design, or if its design is refuted."""
    problem, judgement, began = file.problem, solved.judgement, perf_counter()
    if judgement is not None and solved.status is not Status.VIOLATED:
        return solved
    if out_of_time():
        return replace(solved, cut=(*solved.cut, REPAIRS))
    document = toml.parse(file.text, problem.name)
    if judgement is not None:
        repairs = repairs_of_design(document, judgement, [], progress)
    else:
        repairs = find_repairs(document, parameter_changes(document, problem), OF_FREE, progress)
    seconds, cut = perf_counter() - began, (REPAIRS,) * out_of_time()
    found = repairs or None if cut else repairs  # after the time limit others may exist
    return replace(solved, repairs=found, seconds={**solved.seconds, "repairs": seconds}, cut=(*solved.cut, *cut))


def repairs_of_design(
    stated: dict[str, Any],
    judgement: Judgement,
    changed: Sequence[ParameterChange],
    progress: Progress = lambda stage: None,
) -> list[Repair]:
    """Return the changes of one value after which a refuted design passes: first of the design, then of the problem."""
    pasted = stated | design_tables(judgement.kind, judgement.gains, judgement.coupling)
    problem, _ = pose(pasted, "")
    assert problem is not None, "a valid problem with valid gains is one"
    with suppress(OutOfTimeError):
        found = undone(pasted, changed, OF_FIXED)
        settled = set(SYMBOLS) if found else set()
        changes = [change for change in parameter_changes(pasted, problem) if change.key not in settled]
        found += find_repairs(pasted, changes, OF_FIXED, progress)
        return sorted(found, key=lambda repair: (repair.key not in SYMBOLS, repair.rank))
    return []


def edits(problem: Problem, judgement: Judgement, solved: Mapping[str, float]) -> list[ParameterChange]:
    """Return one change for each variable that differs from the solved design, with the solved value as its limit."""
    given = design_numbers(judgement.kind, judgement.gains, judgement.coupling)
    return [change_of_gain(problem, key, given[key], new) for key, new in solved.items() if new != given[key]]


def undone(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> list[Repair]:
    """Undo one edit at a time; return each reversal that gives a certified design, the least error first."""
    found = []
    for change in changed:
        design = _verified(change.applied(pasted, change.limit), test)
        found += [repair_of(change, change.limit, design)] if design is not None else []
    return sorted(found, key=lambda repair: repair.rank)


def undone_together(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> bool:
    """Return whether undoing all edits leads to a certified design."""
    document = reduce(lambda document, change: change.applied(document, change.limit), changed, pasted)
    return _verified(document, test) is not None


def _verified(document: dict[str, Any], test: RepairTest) -> Judgement | None:
    check_time()
    problem, _ = pose(document, "")
    return test.verify(problem) if problem is not None else None


def repair_of(change: ParameterChange, new: float, design: Judgement) -> Repair:
    """Return a change of a value as a repair."""
    error = design.transparency.error
    return Repair(change.key, change.old, new, change.meaning, change.line(new), change.size(new), error)


@np.errstate(all="ignore")
def find_repairs(
    document: dict[str, Any],
    changes: Sequence[ParameterChange],
    test: RepairTest = OF_FIXED,
    progress: Progress = lambda stage: None,
    posed: Posed = _posed,
) -> list[Repair]:
    """Return the least of a few steps of each change that repairs a problem alone.

    Small steps of every change come before great steps of any. A step that seems to suffice is proved.
    """
    found, left, verified = list[Repair](), dict(enumerate(changes)), 0

    def applied(change: ParameterChange, new: float) -> Problem | None:
        check_time()
        return posed(change.applied(document, new))

    def seems_to_suffice(problem: Problem | None) -> bool:
        return problem is not None and test.estimate(problem)

    with suppress(OutOfTimeError):
        for place, change in enumerate(changes):  # what only relaxes a constraint suffices at most at its limit
            if change.eases and not seems_to_suffice(applied(change, change.limit)):
                del left[place]
        for relative, number in sorted((step, each) for each in left for step in changes[each].steps()):
            if number not in left or verified >= test.most:
                continue
            change = changes[number]
            progress(f"looking for repairs: {change.meaning}{f', {len(found)} found' if found else ''}")
            new = change.rounded(relative)
            problem = applied(change, new)
            if problem is None or not seems_to_suffice(problem):
                continue
            verified += 1
            if (design := test.verify(problem)) is not None:
                check_time()  # at the time limit the judgement may be incomplete
                found.append(repair_of(change, new, design))
                del left[number]
    return sorted(found, key=lambda repair: repair.rank)
