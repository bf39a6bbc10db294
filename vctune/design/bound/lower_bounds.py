"""Compute lower bounds on the error of the designs of a box, from a relaxation of their problem. See model/README.md,
section 8; design/bound/README.md, section 1."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from vctune.design.bound.couplings import LeastCoupling
from vctune.design.bound.design_boxes import B_0, K_P, K_V, DesignBoxes
from vctune.design.bound.quadratics import GUARD
from vctune.design.bound.relaxation import Relaxation
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.proof.enclosures.intervals import Flags, Floats


@dataclass(frozen=True, slots=True)
class LowerBounds:
    """Lower bounds on the error of the designs of each box, as arrays of shape (boxes,)."""

    error: Floats  # a lower bound on the error of the feasible designs; inf if no design is feasible
    infeasibility: Floats  # a lower bound of the greatest of |S| and the coupling's elements, each divided by its limit


@np.errstate(all="ignore")
def lower_bounds(relaxed: Relaxation, boxes: DesignBoxes) -> LowerBounds:
    """Return lower bounds of the error and of the infeasibility of the designs in each box."""
    problem, objective = relaxed.problem, relaxed.objective
    couplings, least = objective.couplings, least_coupling(relaxed, boxes)
    infeasibility = _sensitivity_over_limit(relaxed, boxes)
    for element, range_ in ((least.first, couplings.first), (least.second, couplings.second)):
        infeasibility = np.fmax(infeasibility, element / range_.max)
    none = least.none | (infeasibility > 1 + 4 * GUARD) | ((boxes.low[K_P] > 0) & without_integrator(problem, boxes))
    squared = objective.admittance.least(boxes) + objective.tracking.least(boxes)
    if objective.omega is None:
        squared = squared.reshape(len(boxes), objective.devices, -1).sum(axis=2)
    squared = (squared + couplings.felt(least, boxes)).max(axis=1)
    known = np.nan_to_num(squared, nan=0.0, posinf=0.0)
    return LowerBounds(np.where(none, inf, np.sqrt(known) * (1 - 10 * GUARD)), np.where(none, inf, infeasibility))


def _sensitivity_over_limit(relaxed: Relaxation, boxes: DesignBoxes) -> Floats:
    """Return a lower bound of the greatest |S|, divided by its limit."""
    limit = relaxed.problem.stability.max_sensitivity
    S2: Floats = relaxed.sensitivity.least(boxes).max(axis=1)
    return np.sqrt(S2) / limit * (1 - GUARD)


def without_integrator(problem: Problem, boxes: DesignBoxes) -> Flags:
    """Return the boxes in which no feasible design has K_p > 0, because b_0 lies below R at omega = 0."""
    device = problem.device
    beyond = device.structure is not None or (device.operator is not None and not device.ideal)
    if not problem.passive or problem.stability.band.min > 0 or beyond:
        return np.zeros(len(boxes), bool)
    late, gripped = lags(device, FLOATS), device.least_damping
    b = device.damping + boxes.low[K_P] * late.sensor * (1 - GUARD)
    b_h, factor = gripped - device.damping, problem.stability.safety_factor
    most = (gripped + boxes.high[K_V]) * (1 + GUARD) - late.drive * boxes.low[K_P] * (1 - GUARD)
    eased = 4 * (most * boxes.high[B_0] + factor * b_h * np.maximum(most - gripped, 0.0))
    return (most < 0) | (eased < factor * b * b * (1 - 10 * GUARD))


def least_coupling(relaxed: Relaxation, boxes: DesignBoxes) -> LeastCoupling:
    """Return the least elements of the coupling that the conditions and the bounds permit in each box."""
    of, none = relaxed.objective.couplings, np.zeros(len(boxes), bool)
    lowest, highest = of.ratio(boxes)
    first, second = np.fmax(of.first.min, of.second.min / highest), np.full(len(boxes), of.second.min)
    for condition in relaxed.conditions:
        one, other, never = condition.least_elements(boxes, relaxed.problem.stability.safety_factor)
        first, second, none = np.maximum(first, one.max(axis=1)), np.maximum(second, other.max(axis=1)), none | never
    second = np.maximum(second, first * lowest)
    return LeastCoupling(first * (1 - 10 * GUARD), second * (1 - 10 * GUARD), none)
