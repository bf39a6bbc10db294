"""The least that the designs of a box cost, from a relaxation of their problem.

See model/README.md, section 8; design/bound/README.md, section 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf, log

import numpy as np

from vctune.design.bound.boxes import B_0, K_P, K_V, TAU_C, DesignBoxes
from vctune.design.bound.quadratics import GUARD
from vctune.design.bound.relaxation import Conditions, Relaxation
from vctune.model.arithmetic import FLOATS
from vctune.model.limits import lags
from vctune.model.problem import Problem
from vctune.proof.array_intervals import Flags, Floats


@dataclass(frozen=True, slots=True)
class LeastCoupling:
    """What the conditions leave to the couplings of each box; arrays of shape (boxes,).

    Attributes
    ----------
    damping, mass : the least b_c and m_c
    none : where they leave none
    """

    damping: Floats
    mass: Floats
    none: Flags


@dataclass(frozen=True, slots=True)
class LowerBounds:
    """What the designs of each box at least come to; arrays of shape (boxes,).

    Attributes
    ----------
    error : a lower bound on the error of the admissible designs; inf where there are none
    infeasibility : a lower bound of the greatest of |S|, b_c and m_c relative to their limits; above 1 nothing is
        admissible
    """

    error: Floats
    infeasibility: Floats


@np.errstate(all="ignore")
def lower_bounds(relaxed: Relaxation, boxes: DesignBoxes) -> LowerBounds:
    """Return what the designs of each box at least come to.

    Parameters
    ----------
    relaxed : the problem made easier
    boxes : of designs, shape (4, boxes)
    """
    problem = relaxed.problem
    least, infeasibility = least_coupling(relaxed, boxes), _sensitivity_over_limit(relaxed, boxes)
    infeasibility = np.fmax(
        infeasibility, np.fmax(least.damping / problem.bounds.damping.max, least.mass / problem.bounds.mass.max)
    )
    none = least.none | (infeasibility > 1 + 4 * GUARD) | ((boxes.low[K_P] > 0) & without_integrator(problem, boxes))
    loop = relaxed.admittance.least(boxes) + relaxed.tracking.least(boxes)
    b_0, factor = (
        boxes.low[B_0],
        (problem.transparency.weights.coupling / problem.transparency.reference_impedance) ** 2,
    )
    if relaxed.omega is None:
        coupling = _coupling(least, boxes, partial(_mean_transmitted, problem))
        mean = loop.reshape(len(boxes), relaxed.n_objective_devices, -1).sum(axis=2).max(axis=1)
        squared = mean + factor * (b_0 * b_0 + coupling)
    else:
        coupling = _coupling(least, boxes, partial(_transmitted, relaxed.omega[:, None]))
        squared = (loop + factor * (b_0 * b_0 + coupling).T).max(axis=1)
    known = np.nan_to_num(squared, nan=0.0, posinf=0.0)
    return LowerBounds(np.where(none, inf, np.sqrt(known) * (1 - 10 * GUARD)), np.where(none, inf, infeasibility))


def _sensitivity_over_limit(relaxed: Relaxation, boxes: DesignBoxes) -> Floats:
    """Return a lower bound of |S| relative to its limit."""
    limit = relaxed.problem.stability.max_sensitivity
    S2: Floats = relaxed.sensitivity.least(boxes).max(axis=1)
    return np.sqrt(S2) / limit * (1 - GUARD)


def without_integrator(problem: Problem, boxes: DesignBoxes) -> Flags:
    """Return the boxes no admissible design of which has K_p > 0: b_0 is below every limit of R at omega = 0.

    With k = K_v - tau K_p the limit is ((b + tau_s K_p)^2 - 4 b_h k)/(4 (b + b_h + k)) (`vctune.model.limits`), where
    there is no structure, and no operator unless the device is ideal.

    Parameters
    ----------
    problem : in SI units
    boxes : n of them

    Returns
    -------
    array of bool
        Shape (n,); all False where the limit is not asked for, or not known.
    """
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
    """Return the least b_c and m_c that the conditions and the bounds leave to any design of a box.

    Re Z_c >= r needs b_c >= (r - b_0) (1 + 1/(omega tau_c)^2), least for the greatest tau_c, and m_c = b_c tau_c >=
    (r - b_0) (tau_c + 1/(omega^2 tau_c)), least for the tau_c next to 1/omega; in hands with omega = (2/T)
    tan(theta/2).

    Parameters
    ----------
    relaxed : the problem made easier
    boxes : n of them
    """
    problem, none = relaxed.problem, np.zeros(len(boxes), bool)
    bounds, asked = problem.bounds, list[tuple[Floats, Floats]]()
    if relaxed.conditions is not None:
        R, none = _least_resistance(relaxed.conditions, boxes)
        asked.append((relaxed.conditions.omega, R))
    if relaxed.in_hands is not None:
        asked.append((relaxed.in_hands.omega, relaxed.in_hands.least_required(boxes)))
    shortest, longest = (edge[TAU_C][:, None] for edge in (boxes.low, boxes.high))
    b_c = np.maximum(bounds.damping.min, bounds.mass.min / boxes.high[TAU_C])
    m_c = np.full(len(boxes), bounds.mass.min)
    for omega, R in asked:
        needed = np.maximum(problem.stability.safety_factor * R - boxes.high[B_0][:, None], 0.0)
        nearest = np.clip(1 / omega, shortest, longest)
        relative = 1 + 1 / np.square(omega * longest), nearest + 1 / (np.square(omega) * nearest)
        damping, mass = (np.where(needed > 0, needed * each, 0.0).max(axis=1) for each in relative)
        b_c, m_c = np.maximum(b_c, damping), np.maximum(m_c, mass)
    m_c = np.maximum(m_c, b_c * boxes.low[TAU_C])
    return LeastCoupling(b_c * (1 - 10 * GUARD), m_c * (1 - 10 * GUARD), none)


def _least_resistance(at: Conditions, boxes: DesignBoxes) -> tuple[Floats, Flags]:
    """Return a lower bound of R where it is positive, shape (boxes, frequencies), and the boxes that have none.

    R is (excess - relief)/(2 r) with the loop's resistance r, which is nowhere positive in a box that has none.
    """
    im = np.maximum(np.maximum(at.im_low.least(boxes), -at.im_high.greatest(boxes)), 0.0) * (1 - GUARD)
    resistance, P = at.resistance.greatest(boxes), at.P.greatest(boxes)
    weight = np.sqrt(at.C2.greatest(boxes) * at.D2.greatest(boxes)) * (1 + GUARD) + P
    least = np.maximum(at.C2_low.least(boxes), 0.0) * np.maximum(at.D2_low.least(boxes), 0.0)
    excess = np.fmax(np.where(im > 0, im * im / weight, 0.0), np.sqrt(least) * (1 - GUARD) - P)
    if at.operator_relief is not None:
        relief = at.operator_relief.greatest(boxes)
        excess = excess - relief - GUARD * np.abs(relief)
    R = excess / (2 * resistance) * (1 - 10 * GUARD)
    return np.fmax(R, 0.0), np.asarray((resistance <= 0).any(axis=1))


def _coupling(least: LeastCoupling, boxes: DesignBoxes, transmitted: Callable[[Floats], Floats]) -> Floats:
    """Return a lower bound of |Z_c|^2 - b_0^2 = 2 b_0 b_c s + b_c^2 s, s = x^2/(1 + x^2) or its mean, x = omega tau_c.

    s grows with tau_c, s/tau_c^2 falls: in b_c the last term is least for the least tau_c, in m_c for the greatest.
    """
    b_c, m_c, b_0 = least.damping, least.mass, boxes.low[B_0]
    light, heavy = transmitted(boxes.low[TAU_C]), transmitted(boxes.high[TAU_C])
    return 2 * b_0 * b_c * light + np.fmax(np.square(b_c) * light, np.square(m_c / boxes.high[TAU_C]) * heavy)


def _transmitted(omega: Floats, tau_c: Floats) -> Floats:
    """Return x^2/(1 + x^2), x = omega tau_c: |Z_c/b_c|^2 and Re Z_c/b_c without drag."""
    x2 = np.square(omega * tau_c)
    return x2 / (1 + x2)


def _mean_transmitted(problem: Problem, tau_c: Floats) -> Floats:
    """Return the mean of `_transmitted` over log frequency."""
    low, high = problem.transparency.band.min, problem.transparency.band.max
    rise = (high - low) * (high + low) * np.square(tau_c) / (1 + np.square(low * tau_c))
    return np.log1p(rise) / (2 * log(high / low)) * (1 - GUARD * high / (high - low))
