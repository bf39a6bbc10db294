"""Find repairs: changes of one value that make a design possible, each sufficient alone, the least error first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from time import perf_counter
from typing import Any

import numpy as np

from vctune.analysis.in_hands import ratio_in_some_hands
from vctune.design.prepared import pose as pose_devices
from vctune.design.result import Solved
from vctune.design.verdict.judge import (
    Judgement,
    Status,
    margins_in_hands,
    margins_on_band,
    peak_sensitivity,
)
from vctune.design.verdict.parameter_changes import ParameterChange, change_of_gain, parameter_changes
from vctune.document.gains_file import design_numbers, design_tables
from vctune.document.reading import ProblemFile, pose
from vctune.document.records.design_json import Repair
from vctune.document.text import toml
from vctune.model.numbers.units import SYMBOLS
from vctune.model.problem import Problem
from vctune.proof.claims.loop_claims import stable_loop
from vctune.proof.prover import boxes_at_most
from vctune.running import OutOfTimeError, check_time, out_of_time

REPAIRS = "the repairs"  # Name of a stage that a time limit may cut short
# Greatest numbers of changed problems that a search solves, or of changed designs that it judges. They bound its time
# and, unlike a number of seconds, give the same answer on every machine
MOST_SOLVED, MOST_JUDGED = 10, 24
MOST_BOXES = 20_000  # Greatest number of boxes of each proof of a changed problem's design
# Share by which the screening requires a greater ratio than the limit, so that the proof of rounded gains succeeds
SLACK = 1e-5

Progress = Callable[[str], None]


def _posed(document: dict[str, Any]) -> Problem | None:
    return pose(document, "")[0]


def _hopeful(problem: Problem) -> bool:
    """Return whether a problem seems to have a design in double precision: the fixed one, or one near a start."""
    if not problem.bounds.fixed:
        from vctune.design.search.optimum import within_reach

        return within_reach(problem) is not None
    posed, law, least = pose_devices(problem), problem.fixed_design, problem.stability.safety_factor * (1 + SLACK)
    if any(ratio_in_some_hands(case, *law) < least for case in posed.cases):
        return False
    if peak_sensitivity(posed, law[0])[0] > problem.stability.max_sensitivity:
        return False
    if any(margin.ratio < least for margin in margins_on_band(posed, *law)):
        return False
    held = [case.device for case in posed.hand_cases]
    if held and any(margin.ratio < least for margin in margins_in_hands(posed.demands, held, *law)):
        return False
    loops = (loop for case in posed.cases for loop in case.device.loops)
    return all(stable_loop(loop, law[0], model=problem.passive) for loop in loops)


def _certified(problem: Problem) -> Judgement | None:
    """Return the certified design of a problem: the fixed one, or the one that the optimiser finds."""
    from vctune.design.solve import solve

    with boxes_at_most(MOST_BOXES):
        solved = solve(problem, exhaustive=False)  # without the search of every box, which can take half a minute
    if solved.cut and not problem.bounds.fixed:
        raise OutOfTimeError
    judgement = solved.judgement
    return judgement if judgement is not None and judgement.status is Status.CERTIFIED else None


def with_repairs(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return the result of a problem with repairs if it has no design, or if its design is refuted."""
    problem, judgement, began = file.problem, solved.judgement, perf_counter()
    if judgement is not None and solved.status is not Status.VIOLATED:
        return solved
    if out_of_time():
        return replace(solved, cut=(*solved.cut, REPAIRS))
    document = toml.parse(file.text, problem.name)
    if judgement is not None:
        repairs, _ = repairs_of_design(document, judgement, [], progress)
    else:
        repairs = find_repairs(document, parameter_changes(document, problem), progress)
    seconds, cut = perf_counter() - began, (REPAIRS,) * out_of_time()
    found = repairs or None if cut else repairs  # after the time limit others may exist
    return replace(solved, repairs=found, seconds={**solved.seconds, "repairs": seconds}, cut=(*solved.cut, *cut))


def edits(problem: Problem, judgement: Judgement, solved: Mapping[str, float]) -> list[ParameterChange]:
    """Return one change for each variable that differs from the solved design, with the solved value as its limit."""
    given = design_numbers(judgement.kind, judgement.gains, judgement.coupling)
    return [change_of_gain(problem, key, given[key], new) for key, new in solved.items() if new != given[key]]


def repairs_of_design(
    stated: dict[str, Any],
    judgement: Judgement,
    changed: Sequence[ParameterChange],
    progress: Progress = lambda stage: None,
) -> tuple[list[Repair], bool]:
    """Return the changes of one value after which a refuted design passes, first of the design, then of the problem,
    and whether only all edits together undo it."""
    pasted = stated | design_tables(judgement.kind, judgement.gains, judgement.coupling)
    found = list[Repair]()
    with suppress(OutOfTimeError):
        for edit in changed:
            if (design := _verified(edit.applied(pasted, edit.limit))) is not None:
                found.append(_repair(edit, edit.limit, design))
        undone = reduce(lambda document, edit: edit.applied(document, edit.limit), changed, pasted)
        together = len(changed) > 1 and not found and _verified(undone) is not None
        problem, settled = _posed(pasted), set(SYMBOLS) if found else set[str]()
        assert problem is not None, "a valid problem with valid gains is one"
        changes = [change for change in parameter_changes(pasted, problem) if change.key not in settled]
        found += find_repairs(pasted, changes, progress)
        return sorted(found, key=lambda repair: (repair.key not in SYMBOLS, repair.rank)), together
    return [], False


def _verified(document: dict[str, Any]) -> Judgement | None:
    check_time()
    problem = _posed(document)
    return None if problem is None else _certified(problem)


def _repair(change: ParameterChange, new: float, design: Judgement) -> Repair:
    return Repair(
        key=change.key,
        old=change.old,
        new=new,
        change=change.meaning,
        needs=change.line(new),
        size=change.size(new),
        error=design.transparency.error,
    )


@np.errstate(all="ignore")
def find_repairs(
    document: dict[str, Any],
    changes: Iterable[ParameterChange],
    progress: Progress = lambda stage: None,
    posed: Callable[[dict[str, Any]], Problem | None] = _posed,
) -> list[Repair]:
    """Return the least of at most six steps of each change that repairs a problem alone.

    Small steps of every change come before great steps of any. A step that seems to suffice is proved.
    """
    found, settled, verified = list[Repair](), set[int](), 0

    def hopeful(change: ParameterChange, new: float) -> Problem | None:
        check_time()
        problem = posed(change.applied(document, new))
        return problem if problem is not None and _hopeful(problem) else None

    with suppress(OutOfTimeError):
        # a change that only relaxes a constraint suffices at most at its limit
        tried = [change for change in changes if not change.eases or hopeful(change, change.limit)]
        steps = [(size, k, new) for k, change in enumerate(tried) for size, new in change.steps()]
        for _, k, new in sorted(steps):
            if k in settled:
                continue
            progress(f"looking for repairs: {tried[k].meaning}{f', {len(found)} found' if found else ''}")
            if (problem := hopeful(tried[k], new)) is None:
                continue
            verified += 1
            if verified > (MOST_JUDGED if problem.bounds.fixed else MOST_SOLVED):
                break
            if (design := _certified(problem)) is not None:
                check_time()  # at the time limit the judgement may be incomplete
                found.append(_repair(tried[k], new, design))
                settled.add(k)
    return sorted(found, key=lambda repair: repair.rank)
