"""What would make a design possible: changes of one number of the problem file, each alone sufficient and least.

Gains that are given are tried without the optimiser, which is imported only where something is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from vctune.analysis.demands import sensitivity_maxima, transparency_error
from vctune.analysis.in_hands import least_ratios
from vctune.design.judge import IDLE, Judgement, Status, judge, least_ratio
from vctune.design.parameter_changes import ParameterChange, changes_of_demands, parameter_changes
from vctune.design.prepared import pose as pose_devices
from vctune.document import toml
from vctune.document.codes import Note
from vctune.document.reading import ProblemFile, pose
from vctune.model.problem import Problem
from vctune.model.quantities import AnyCoupling, Gains
from vctune.proof.interval import Verdict
from vctune.proof.poles import prove_model_poles
from vctune.proof.sampled_loop import prove_sampled_poles

if TYPE_CHECKING:
    from vctune.design.result import Solved

SHARE = 0.9
"""The share of a repair that must not suffice."""
ROUNDS = 10
"""How often a first opinion is corrected: a little more where it does not suffice, a tenth less where less does. Two or
three times are usual; half as many leave out repairs, twice as many wait for none."""
LONGEST = 30.0
"""Seconds after which nothing more is tried: what takes so long is a device whose every answer takes long. Half
leaves out repairs on a slow machine, which is said (`CUT_SHORT`); those that are listed are the same."""
CUT_SHORT = Note("warn-repairs-cut-short", f"repairs were looked for during {LONGEST:g} s; there may be more of them")
FINER = 30.0
"""By what smaller changes are tried while even the least tried is enough; then the interval is bisected."""
SLACK = 1e-5
"""By what share a first opinion wants the ratio greater than its demand, as the proof of rounded gains will."""

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Repair:
    """A change of one number of the problem file after which there is a design, while 90 % of it is not enough.

    Attributes
    ----------
    key : dotted key
    old, new : its values, in the unit of the file
    change : what that means
    needs : what the file has to say, a line of TOML
    size : change relative to the greater of both values, by which repairs are compared (`ParameterChange.size`)
    error : transparency error of the design that there is then
    """

    key: str
    old: float
    new: float
    change: str
    needs: str
    size: float
    error: float

    def __str__(self) -> str:
        return f"{self.key} = {self.new:.12g} instead of {self.old:.12g}"


@dataclass(frozen=True, slots=True)
class RepairTest:
    """How a changed problem is tried.

    Attributes
    ----------
    estimate : a first opinion
    verify : its design, if that is certified; None if there is none
    width : how closely the least change is bracketed, relative
    """

    estimate: Callable[[Problem], bool]
    verify: Callable[[Problem], Judgement | None]
    width: float


def _seems_admissible(problem: Problem) -> bool:
    """Return whether a problem's fixed design meets the demands in double precision, and its poles are proved."""
    return all(_seems_admissible_on(case, *problem.fixed_design) for case in pose_devices(problem).cases)


def _seems_admissible_on(problem: Problem, gains: Gains, coupling: AnyCoupling) -> bool:
    least = problem.stability.safety_factor * (1 + SLACK)
    if problem.passive and least_ratio(problem, gains, coupling)[0] < least:
        return False
    if -sensitivity_maxima(problem, gains).value[0] > problem.stability.max_sensitivity:
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

    judgement = solve(problem).judgement
    return judgement if judgement is not None and judgement.status is Status.CERTIFIED else None


def _attained(problem: Problem) -> Judgement | None:
    from vctune.design.optimum import attained

    return attained(problem)


def _in_use(judgement: Judgement | None) -> Judgement | None:
    """Return a design that uses its velocity loop; None for any other, or for none."""
    return None if judgement is None or judgement.idle else judgement


def _seems_in_use(problem: Problem) -> bool:
    return transparency_error(problem, *problem.fixed_design).tracking <= IDLE and _seems_admissible(problem)


OF_FIXED = RepairTest(_seems_admissible, _judged, 2e-3)
OF_FREE = RepairTest(lambda problem: _attained(problem) is not None, _solved, 0.05)
"""Of problems that fix every number, and of those that leave something free: judged in a millisecond, so that the least
change can be found closely, or solved in a second. Half or twice the width costs one trial more or less a number."""
OF_FIXED_IN_USE = RepairTest(_seems_in_use, lambda problem: _in_use(_judged(problem)), OF_FIXED.width)
OF_FREE_IN_USE = RepairTest(
    lambda problem: _in_use(_attained(problem)) is not None, lambda problem: _in_use(_solved(problem)), OF_FREE.width
)
"""Of the same, until their designs use the velocity loop."""


def with_repairs(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return what came of a problem with its repairs, where it has no design, its own is refuted, or is idle.

    Parameters
    ----------
    file : the problem
    solved : what came of it
    progress : told the stage of the work
    """
    problem, judgement, began = file.problem, solved.judgement, perf_counter()
    idle = judgement is not None and judgement.idle
    if judgement is not None and solved.status is not Status.VIOLATED and not idle:
        return solved
    if judgement is None and problem.hands_met is not None:
        return solved  # next to the least change a proof in hands takes a minute: the reason says what to change
    document = toml.parse(file.text, problem.name)
    if idle:
        repairs = find_cures(document, problem, progress)
    else:
        test = OF_FIXED if problem.bounds.fixed else OF_FREE
        repairs = find_repairs(document, parameter_changes(document, problem), test, progress)
    return replace(solved, repairs=repairs, seconds={**solved.seconds, "repairs": perf_counter() - began})


def find_cures(document: dict[str, Any], problem: Problem, progress: Progress = lambda stage: None) -> list[Repair]:
    """Return the least changes of one demand after which a problem has a design that uses its velocity loop.

    Parameters
    ----------
    document : parsed TOML
    problem : that it states, whose own design does not
    progress : told what is tried
    """
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
) -> list[Repair]:
    """Return the least changes of one number that repair a problem, the smallest first, as many as `LONGEST` allows.

    Each is tried as it would be by hand: the number is changed in the document, the problem read again, its defaults
    with it, and solved or, if it fixes every number, judged.

    Parameters
    ----------
    document : parsed TOML
    changes : the numbers that may be changed
    test : how changed problems are tried
    progress : told what is tried
    """
    found, last = [], perf_counter() + LONGEST
    for change in changes:
        progress(f"looking for repairs: {change.meaning}")
        repair = _least(document, change, test, lambda: perf_counter() > last)
        found += [repair] if repair is not None else []
    return sorted(found, key=lambda repair: repair.size)


def _least(
    document: dict[str, Any], change: ParameterChange, test: RepairTest, late: Callable[[], bool]
) -> Repair | None:
    """Return the least change of a number that repairs the problem while `SHARE` of it does not, if found in time."""

    def certified(new: float) -> Judgement | None:
        posed, _ = pose(change.applied(document, new), "")
        return test.verify(posed) if posed is not None else None

    def promising(new: float) -> bool:
        posed, _ = pose(change.applied(document, new), "")
        return posed is not None and not late() and test.estimate(posed)

    relative = _least_relative_change(change, promising, 1 + test.width)
    for _ in range(ROUNDS):
        if relative is None or late():
            break
        new = change.rounded(relative, test.width / 2)
        design, partial = certified(new), change.partial(new, SHARE)
        if design is None:
            relative *= 1 + test.width
        elif certified(partial) is not None:
            relative = change.relative_change(partial)
        else:
            error = design.transparency.error
            return Repair(change.key, change.old, new, change.meaning, change.line(new), change.size(new), error)
    return None


def _least_relative_change(change: ParameterChange, holds: Callable[[float], bool], width: float) -> float | None:
    """Return the relative change of the first value tried that holds, narrowed towards the last one that does not."""
    low = 0.0
    for high in change.relative_changes():
        if holds(change.value(high)):
            break
        low = high
    else:
        return None
    while low == 0 and high > change.least:
        low, high = (0.0, high / FINER) if holds(change.value(high / FINER)) else (high / FINER, high)
    while 0 < low * width < high < inf:
        middle = sqrt(low * high)
        low, high = (low, middle) if holds(change.value(middle)) else (middle, high)
    return high
