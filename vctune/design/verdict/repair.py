"""Find repairs: changes of one value that make a design possible, each sufficient alone, the least error first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, sqrt
from time import perf_counter
from typing import Any

import numpy as np

from vctune.analysis.demands import sensitivity_maxima, transparency_error
from vctune.analysis.in_hands import least_ratios, ratio_in_some_hands
from vctune.design.prepared import pose as pose_devices
from vctune.design.result import Repair, Solved
from vctune.design.verdict.gain_repair import best_values, edits, repair_of, solved_numbers, undone
from vctune.design.verdict.judge import IDLE_TRACKING, Judgement, Status, judge, least_ratio
from vctune.design.verdict.parameter_changes import ParameterChange, changes_of_demands, parameter_changes
from vctune.design.verdict.trial import RepairTest
from vctune.document.gains_file import design_tables
from vctune.document.reading import ProblemFile, pose
from vctune.document.text import toml
from vctune.document.text.codes import Note
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.keys import SYMBOLS
from vctune.model.problem import Problem
from vctune.proof.claims.model_poles import prove_model_poles
from vctune.proof.claims.sampled_poles import prove_sampled_poles
from vctune.proof.engine.interval import Verdict
from vctune.running import OutOfTimeError, check_time, out_of_time, time_limit

SHARE = 0.9  # Share of a repair that must not be enough to make a design possible
ROUNDS = 10  # Greatest number of corrections of the estimated least change
REPAIRS = "the repairs"  # Name of a stage that a time limit may cut short
LONGEST = 30.0  # Seconds after which vctune tries no more changes
# Share of `LONGEST` after which vctune no longer solves the problem to find out which value was edited
COMPARING = 0.25
CUT_SHORT = Note("warn-repairs-cut-short", f"repairs were looked for during {LONGEST:g} s; there may be more of them")
FINER = 30.0  # Factor by which the search reduces a change while the change suffices
# Share by which the screening requires a greater ratio than the limit, so that the proof of rounded gains succeeds
SLACK = 1e-5

Progress = Callable[[str], None]
Posed = Callable[[dict[str, Any]], Problem | None]


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
    stable = (prove_sampled_poles, prove_model_poles) if problem.passive else (prove_sampled_poles,)
    proofs = (prove(loop, gains) for loop in problem.device.loops for prove in stable)
    return all(proof.verdict is Verdict.PROVED for proof in proofs)


def _judged(problem: Problem) -> Judgement | None:
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


def _seems_solvable_in_use(problem: Problem) -> bool:
    from vctune.design.search.optimum import within_reach

    design = within_reach(problem)
    return design is not None and transparency_error(problem, *design).tracking <= IDLE_TRACKING


def _in_use(judgement: Judgement | None) -> Judgement | None:
    """Return a design if it uses its velocity loop; None for any other design and for None."""
    return None if judgement is None or judgement.idle else judgement


def _seems_in_use(problem: Problem) -> bool:
    return transparency_error(problem, *problem.fixed_design).tracking <= IDLE_TRACKING and _seems_admissible(problem)


OF_FIXED = RepairTest(_seems_admissible, _judged, 2e-3, furthest_first=True)
# Tests for problems that fix every variable of the design, and for problems that leave one variable free. vctune judges
# a problem of the first kind in a millisecond, so the search can determine the least change accurately
OF_FREE = RepairTest(_seems_solvable, _solved, 0.05, furthest_first=True)
OF_FIXED_IN_USE = RepairTest(_seems_in_use, lambda problem: _in_use(_judged(problem)), OF_FIXED.width)
# The same tests, with the additional condition that the design uses its velocity loop
OF_FREE_IN_USE = RepairTest(
    _seems_solvable_in_use, lambda problem: _in_use(_solved(problem)), OF_FREE.width, furthest_first=True
)


def with_repairs(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return the result of a problem with repairs if it has no design, or if its design is refuted or idle."""
    problem, judgement, began = file.problem, solved.judgement, perf_counter()
    idle = judgement is not None and judgement.idle
    if judgement is not None and solved.status is not Status.VIOLATED and not idle:
        return solved
    if out_of_time():
        return replace(solved, cut=(*solved.cut, REPAIRS))
    document = toml.parse(file.text, problem.name)
    if idle:
        repairs = find_cures(document, problem, progress)
    elif judgement is not None:
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
    progress("looking for repairs: the numbers of the design")
    found, settled = list[Repair](), set[str]()
    with time_limit(LONGEST):
        if not changed:
            with suppress(OutOfTimeError), time_limit(COMPARING * LONGEST):
                differing = edits(problem, judgement, solved_numbers(stated, judgement, OF_FREE))
                changed = differing if len(differing) == 1 else []
        with suppress(OutOfTimeError):
            found += undone(pasted, changed, OF_FIXED)
            settled |= set(SYMBOLS) if found else set()
            for repair in () if found else best_values(stated, judgement, OF_FREE):
                found.append(repair)
                settled.add(repair.key)
        changes = [change for change in parameter_changes(pasted, problem) if change.key not in settled]
        found += find_repairs(pasted, changes, OF_FIXED, progress)
    return sorted(found, key=lambda repair: (repair.key not in SYMBOLS, repair.rank))


def find_cures(document: dict[str, Any], problem: Problem, progress: Progress = lambda stage: None) -> list[Repair]:
    """Return the least changes of one constraint after which the best design uses its velocity loop."""
    test = OF_FIXED_IN_USE if problem.bounds.fixed else OF_FREE_IN_USE
    return find_repairs(document, changes_of_demands(document, problem), test, progress)


def has_design_in_use(problem: Problem) -> bool:
    """Return whether solving a problem finds a design that uses its velocity loop."""
    return not problem.bounds.fixed and OF_FREE_IN_USE.verify(problem) is not None


@np.errstate(all="ignore")
def find_repairs(
    document: dict[str, Any],
    changes: Sequence[ParameterChange],
    test: RepairTest = OF_FIXED,
    progress: Progress = lambda stage: None,
    posed: Posed = _posed,
) -> list[Repair]:
    """Return the smallest changes that repair a problem, each of a single value."""
    found: list[Repair] = []
    with suppress(OutOfTimeError), time_limit(LONGEST):
        searches = [_Search(document, change, test, posed) for change in changes]
        left = {number: 0.0 for number, search in enumerate(searches) if not search.hopeless()}
        trials = sorted((relative, number) for number in left for relative in changes[number].relative_changes())
        for relative, number in trials:
            if number not in left:
                continue
            known = f", {len(found)} found" if found else ""
            progress(f"looking for repairs: {changes[number].meaning}{known}")
            if not searches[number].promising(relative):
                left[number] = relative
            elif (repair := searches[number].least(left.pop(number), relative)) is not None:
                found.append(repair)
    return sorted(found, key=lambda repair: repair.rank)


@dataclass(frozen=True, slots=True)
class _Search:
    """The search for the least change of one value."""

    document: dict[str, Any]  # parsed document
    change: ParameterChange  # value to change
    test: RepairTest  # functions that test changed problems
    posed: Posed  # function that returns the problem that a document states, or None

    def hopeless(self) -> bool:
        """Return whether no change of this value suffices, because even the largest change does not."""
        furthest = self.change.relative_change(self.change.limit)
        return self.test.furthest_first and self.change.eases and not self.promising(furthest)

    def promising(self, relative: float) -> bool:
        """Return whether a relative change seems to suffice."""
        posed = self.posed(self.change.applied(self.document, self.change.value(relative)))
        check_time()
        return posed is not None and self.test.estimate(posed)

    def certified(self, new: float) -> Judgement | None:
        """Return the judgement of the design with a new value; None if this design is not certified."""
        posed = self.posed(self.change.applied(self.document, new))
        check_time()
        judgement = self.test.verify(posed) if posed is not None else None
        check_time()  # at the time limit the judgement may be incomplete
        return judgement

    def least(self, low: float, high: float) -> Repair | None:
        """Return the least change that repairs the problem while `SHARE` of it does not; None if the search finds
        none."""
        change, width = self.change, self.test.width
        if change.switch:
            design = self.certified(change.limit)
            return repair_of(change, change.limit, design) if design is not None else None
        relative = self._narrowed(low, high)
        if change.old == 0 and relative <= change.least:  # any change from 0 suffices: use the tried one
            new = change.rounded(high, width / 2)
            design = self.certified(new)
            return repair_of(change, new, design) if design is not None else None
        for _ in range(ROUNDS):
            new = change.rounded(relative, width / 2)
            design, partial = self.certified(new), change.partial(new, SHARE)
            if design is None:
                relative *= 1 + width
            elif self.certified(partial) is not None:
                relative = change.relative_change(partial)
            else:
                return repair_of(change, new, design)
        return None

    def _narrowed(self, low: float, high: float) -> float:
        """Return the least relative change that seems to suffice, to the relative accuracy of the test."""
        while low == 0 and high > self.change.least:
            low, high = (0.0, high / FINER) if self.promising(high / FINER) else (high / FINER, high)
        while 0 < low * (1 + self.test.width) < high < inf:
            middle = sqrt(low * high)
            low, high = (low, middle) if self.promising(middle) else (middle, high)
        return high
