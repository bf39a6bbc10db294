"""The smallest change of one gain that would make a refuted design pass."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import exp, log

import numpy as np

from vctune.analysis.demands import ratio_minima, sensitivity_maxima
from vctune.design.judge import Status, judge
from vctune.design.variables import KEYS, Point, design_of, point
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.proof.interval import Verdict
from vctune.proof.poles import prove_model_poles, prove_sampled_poles

STEPS = np.geomspace(1e-3, log(1e3), 18)
"""Changes tried, |log(new/old)|, before the threshold is bisected."""
BISECTIONS = 20
SLACK = 1e-5


@dataclass(frozen=True, slots=True)
class Change:
    """One gain moved.

    Attributes
    ----------
    key : dotted key
    old, new : values, SI
    """

    key: str
    old: float
    new: float


def least_change(problem: Problem, gains: Gains, coupling: Coupling) -> Change | None:
    """Return the least relative change of one nonzero gain after which the design is proved; None if none does it."""
    values = point(gains, coupling)
    found = []
    for index, sign in product((i for i, old in enumerate(values) if old), (1.0, -1.0)):
        size = _threshold(problem, values, index, sign)
        if size is not None:
            found.append((size, index, sign))
    for size, index, sign in sorted(found):
        new = float(f"{values[index] * exp(sign * size * (1 + SLACK)):.6g}")
        moved = tuple(new if i == index else value for i, value in enumerate(values))
        if judge(problem, *design_of(moved)).status is Status.CERTIFIED:  # type: ignore[arg-type]
            return Change(KEYS[index], values[index], new)
    return None


def _moved(values: Point, index: int, change: float) -> Point:
    moved = list(values)
    moved[index] *= exp(change)
    return tuple(moved)  # type: ignore[return-value]


def _passes(problem: Problem, values: Point) -> bool:
    gains, coupling = design_of(values)
    if ratio_minima(problem, gains, coupling).value[0] < 1 + SLACK:
        return False
    if -sensitivity_maxima(problem, gains).value[0] > problem.stability.max_sensitivity:
        return False
    proofs = (prove(loop, gains) for loop in problem.device.loops for prove in (prove_sampled_poles, prove_model_poles))
    return all(proof.verdict is Verdict.PROVED for proof in proofs)


def _threshold(problem: Problem, values: Point, index: int, sign: float) -> float | None:
    """Return the least change that passes, of a first one on the grid bisected towards the last that does not."""

    def passes(change: float) -> bool:
        return _passes(problem, _moved(values, index, sign * change))

    high = next((float(step) for step in STEPS if passes(float(step))), None)
    if high is None:
        return None
    low = max((float(step) for step in STEPS if step < high), default=0.0)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if passes(middle) else (middle, high)
    return high
