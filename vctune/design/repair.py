"""What would make a design possible: changes of one number of the problem file, each alone sufficient and least."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, sqrt
from time import perf_counter
from typing import Any

import numpy as np

from vctune.analysis.demands import sensitivity_maxima, transparency_error
from vctune.design.judge import IDLE, Judgement, Status, judge, least_ratio
from vctune.design.levers import Lever
from vctune.design.prepared import pose as pose_devices
from vctune.document.reading import pose
from vctune.model.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.proof.interval import Verdict
from vctune.proof.poles import prove_model_poles
from vctune.proof.sampled_loop import prove_sampled_poles

SHARE = 0.9
"""The share of a repair that must not suffice."""
ROUNDS = 10
"""How often a first opinion is corrected: a little more where it does not suffice, a tenth less where less does."""
LONGEST = 30.0
"""Seconds after which nothing more is tried: what takes so long is a device whose every answer takes long."""
CUT_SHORT = f"repairs were looked for during {LONGEST:g} s; there may be more of them"
FINER = 30.0
SLACK = 1e-5

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
    size : change relative to the greater of both values, by which repairs are compared (`Lever.size`)
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
class Trial:
    """How a changed problem is tried.

    Attributes
    ----------
    quick : a first opinion
    certified : its design, if that is certified; None if there is none
    width : how closely the least change is bracketed, relative
    """

    quick: Callable[[Problem], bool]
    certified: Callable[[Problem], Judgement | None]
    width: float


def _seems_in_order(problem: Problem) -> bool:
    """Return whether a problem's fixed design meets the demands in double precision, and its poles are proved."""
    return all(_in_order_with(case, *problem.fixed_design) for case in pose_devices(problem).cases)


def _in_order_with(problem: Problem, gains: Gains, coupling: Coupling) -> bool:
    if least_ratio(problem, gains, coupling)[0] < problem.stability.safety_factor * (1 + SLACK):
        return False
    if -sensitivity_maxima(problem, gains).value[0] > problem.stability.max_sensitivity:
        return False
    proofs = (prove(loop, gains) for loop in problem.device.loops for prove in (prove_sampled_poles, prove_model_poles))
    return all(proof.verdict is Verdict.PROVED for proof in proofs)


def _judged(problem: Problem) -> Judgement | None:
    judgement = judge(problem, *problem.fixed_design)
    return judgement if judgement.status is Status.CERTIFIED else None


def in_use(judgement: Judgement | None) -> Judgement | None:
    """Return a design that uses its velocity loop; None for any other, or for none."""
    return None if judgement is None or judgement.idle else judgement


def _seems_in_use(problem: Problem) -> bool:
    return transparency_error(problem, *problem.fixed_design).tracking <= IDLE and _seems_in_order(problem)


JUDGED = Trial(_seems_in_order, _judged, 2e-3)
JUDGED_IN_USE = Trial(_seems_in_use, lambda problem: in_use(_judged(problem)), 2e-3)
"""Of problems that fix every number; of the same until the design uses its velocity loop."""


@np.errstate(all="ignore")
def repairs(
    document: dict[str, Any],
    changes: Sequence[Lever],
    trial: Trial = JUDGED,
    progress: Progress = lambda stage: None,
) -> list[Repair]:
    """Return the least changes of one number that repair a problem, the smallest first, as many as `LONGEST` allows.

    Each is tried as it would be by hand: the number is changed in the document, the problem read again, its defaults
    with it, and solved or, if it fixes every number, judged.

    Parameters
    ----------
    document : parsed TOML
    changes : the numbers that may be changed
    trial : how changed problems are tried
    progress : told what is tried
    """
    found, last = [], perf_counter() + LONGEST
    for lever in changes:
        progress(f"looking for repairs: {lever.change}")
        repair = _least(document, lever, trial, lambda: perf_counter() > last)
        found += [repair] if repair is not None else []
    return sorted(found, key=lambda repair: repair.size)


def _least(document: dict[str, Any], lever: Lever, trial: Trial, late: Callable[[], bool]) -> Repair | None:
    """Return the least change of a lever that repairs the problem while `SHARE` of it does not, if found in time."""

    def certified(new: float) -> Judgement | None:
        posed, _ = pose(lever.applied(document, new), "")
        return trial.certified(posed) if posed is not None else None

    def promising(new: float) -> bool:
        posed, _ = pose(lever.applied(document, new), "")
        return posed is not None and not late() and trial.quick(posed)

    strain = _least_strain(lever, promising, 1 + trial.width)
    for _ in range(ROUNDS):
        if strain is None or late():
            break
        new = lever.rounded(strain, trial.width / 2)
        design, part = certified(new), lever.part(new, SHARE)
        if design is None:
            strain *= 1 + trial.width
        elif certified(part) is not None:
            strain = lever.strain(part)
        else:
            error = design.transparency.error
            return Repair(lever.key, lever.old, new, lever.change, lever.line(new), lever.size(new), error)
    return None


def _least_strain(lever: Lever, holds: Callable[[float], bool], width: float) -> float | None:
    """Return the strain of the first value tried that holds, narrowed towards the last one that does not."""
    low = 0.0
    for high in lever.strains():
        if holds(lever.value(high)):
            break
        low = high
    else:
        return None
    while low == 0 and high > lever.least:
        low, high = (0.0, high / FINER) if holds(lever.value(high / FINER)) else (high / FINER, high)
    while 0 < low * width < high < inf:
        middle = sqrt(low * high)
        low, high = (low, middle) if holds(lever.value(middle)) else (middle, high)
    return high
