"""Find the points at which a design violates the constraints, on any of the devices of a problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log

import numpy as np

from vctune.analysis.demands import (
    demand_grid,
    error_terms,
    ratio_minima,
    response,
    sampled_span,
    sensitivity_maxima,
    stability_ratio,
    towards_zero,
    unmodelled_maxima,
    weighted_square,
)
from vctune.analysis.extrema import Floats, Minima, local_minima
from vctune.analysis.hardest_hands import tightest_at_wall
from vctune.analysis.in_hands import (
    RatioInAnyHand,
    RatioInHand,
    least_ratios_in_hands,
    least_ratios_of_each,
    ratio_at,
    windows,
)
from vctune.design.judging.worst_devices import loudest, worst_inside
from vctune.design.nlp.working_set import TIGHTENING_IN_HANDS, ConstraintPoint, constraint_points
from vctune.design.prepared import Posed
from vctune.design.variables import CORNER, Point, design_of
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.model.worlds import WorldsMet

TRACKED_FROM = 0.8  # Share of the limit on |S| above which the NLP tracks the peak of |S|


@dataclass(slots=True)
class Violations:
    """The points at which a design violates the constraints, and the relative violations."""

    ratio: list[ConstraintPoint] = field(default_factory=list)  # points for each kind of constraint
    sensitivity: list[ConstraintPoint] = field(default_factory=list)
    peak: list[ConstraintPoint] = field(default_factory=list)
    unmodelled: list[ConstraintPoint] = field(default_factory=list)
    in_hand: list[ConstraintPoint] = field(default_factory=list)
    greatest: float = 0.0  # greatest relative violation of a tightened constraint beyond half the tightening
    near_peak: ConstraintPoint | None = None  # point where |S| is greatest, if it is near its limit
    positive: bool = True  # whether Re(D + Z_h) > 0 at all frequencies on all devices


def violations(
    posed: Posed, cases: list[Problem], values: Point, tightening: float, refuted: Sequence[ConstraintPoint] = ()
) -> Violations:
    """Find the points where the tightened constraints fail on any device by more than half the tightening, or where the
    error is greatest."""
    gains, coupling = design_of(values)
    loops = of_own_loops(cases)
    peaks = [sensitivity_maxima(case, gains) for case in loops]
    inside = loudest(posed, gains, *min(zip(loops, peaks, strict=True), key=lambda pair: float(pair[1].value[0])))
    if inside is not None:
        loops, peaks = [*loops, inside[0]], [*peaks, inside[1]]
    parts = [_ratios(case, gains, coupling, tightening) for case in cases if case.passive]
    if posed.hand_cases:
        met = {case.device.modelled: case for case in (*loops, *posed.hand_cases)}
        worst = least_ratios_of_each([*met.values()], gains, coupling)
        parts += [
            _in_hands(case, gains, coupling, tightening, least) for case, least in zip(met.values(), worst, strict=True)
        ]
        parts += [_at_walls(case, values, tightening) for case in met.values()]
        parts.append(_at_points(refuted, posed.problem, values, tightening))
    parts += [_peaks(case, there, tightening) for case, there in zip(loops, peaks, strict=True)]
    if posed.problem.uncertainty is not None and posed.problem.uncertainty.unmodelled:
        known = posed.problem.uncertainty
        parts += [_unmodelled(replace(case, uncertainty=known), gains, tightening) for case in loops]
    if posed.box is not None and posed.problem.passive:
        parts.append(_inside(posed, gains, coupling, tightening))
    counted = posed.objective if posed.problem.transparency.norm == "peak" else ()
    return Violations(
        ratio=[point for part in parts for point in part.ratio],
        sensitivity=[point for part in parts for point in part.sensitivity],
        unmodelled=[point for part in parts for point in part.unmodelled],
        in_hand=[point for part in parts for point in part.in_hand],
        peak=[point for case in counted for point in _error_peaks(case, gains, coupling)],
        greatest=max(part.greatest for part in parts),
        near_peak=_near_peak(loops, gains, peaks),
        positive=all(part.positive for part in parts),
    )


def of_own_loops(cases: list[Problem]) -> list[Problem]:
    """Return the problems, but omit a problem whose device differs from an earlier device only in its unmodelled
    response."""
    return list({case.device.modelled: case for case in reversed(cases)}.values())[::-1]


def _ratios(problem: Problem, gains: Gains, coupling: AnyCoupling, tightening: float) -> Violations:
    device, stability, found = problem.device, problem.stability, Violations()
    ratio = _lowest_ratios(problem, gains, coupling)
    short = np.log(stability.safety_factor) + tightening - np.log(np.maximum(ratio.value, 1e-300))
    found.ratio = constraint_points(device, ratio.omega[(short > tightening / 2) & (ratio.value > 0)])
    if ratio.value[0] <= 0:
        found.positive = False
        found.ratio += constraint_points(device, least_resistance(problem, gains).omega[:1])
    found.greatest = max(float(short[0]) - tightening / 2, 0.0)
    return found


def _in_hands(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    tightening: float,
    worst: list[RatioInHand | RatioInAnyHand],
) -> Violations:
    """Find the points in hands at which the ratio is too small: the worst points and, with environments, their
    neighbours."""
    if problem.worlds_met is not None:
        worst = [*worst, *windows(problem, gains, coupling, worst, problem.worlds_met)]
    points = [ConstraintPoint(each.omega, problem.device, each.hand) for each in worst]
    return _short(points, [each.ratio for each in worst], problem.stability.safety_factor, tightening)


def _at_walls(problem: Problem, values: Point, tightening: float) -> Violations:
    """Find the points in hands at which the condition on walls fails; the result is empty for a problem without
    walls."""
    met = walls_met(problem, values)
    if met is None or problem.hands_met is None:
        return Violations()
    gains, coupling = design_of(values)
    worst = least_ratios_in_hands(problem.device, problem.hands_met, gains, coupling, met)
    worst = [*worst, *windows(problem, gains, coupling, worst, met)]
    points = [_point_at_walls(problem, values, each, met) for each in worst]
    return _short(points, [each.ratio for each in worst], problem.stability.safety_factor, tightening)


def tightest_at_walls(problem: Problem, values: Point) -> list[ConstraintPoint]:
    """Return the points at which the condition on walls has the least reserve; empty for a problem without walls."""
    met = walls_met(problem, values)
    if met is None or problem.hands_met is None:
        return []
    worst = least_ratios_in_hands(problem.device, problem.hands_met, *design_of(values), met)
    return [_point_at_walls(problem, values, each, met) for each in worst]


def walls_met(problem: Problem, values: Point) -> WorldsMet | None:
    """Return the environments of a problem, with the corner frequency of a design for walls; None without walls."""
    if problem.worlds is None or len(values) <= CORNER:
        return None
    return WorldsMet(replace(problem.worlds, corner=values[CORNER]), problem.stability.safety_factor)


def _point_at_walls(problem: Problem, values: Point, at: RatioInHand, met: WorldsMet) -> ConstraintPoint:
    wall = tightest_at_wall(problem.device, *design_of(values), at.omega, at.hand, met)
    return ConstraintPoint(at.omega, problem.device, at.hand, wall)


def _at_points(points: Sequence[ConstraintPoint], problem: Problem, values: Point, tightening: float) -> Violations:
    """Return the given points in hands at which the ratio is too small."""
    held, law = [point for point in points if point.hand is not None], design_of(values)
    linear, walls = problem.worlds_met, walls_met(problem, values)
    ratios = [
        ratio_at(point.device, *law, point.omega, point.hand, linear if point.wall is None else walls)
        for point in held
        if point.hand
    ]
    return _short(held, ratios, problem.stability.safety_factor, tightening)


def _short(points: Sequence[ConstraintPoint], ratios: Sequence[float], factor: float, tightening: float) -> Violations:
    tightening = max(tightening, TIGHTENING_IN_HANDS)
    found, least = Violations(), log(factor) + tightening
    for point, ratio in zip(points, ratios, strict=True):
        short = least - log(max(ratio, 1e-300))
        if short > tightening / 2:
            found.in_hand.append(point)
        found.greatest = max(found.greatest, short - tightening / 2)
    return found


def _peaks(problem: Problem, peaks: Minima, tightening: float) -> Violations:
    over = np.log(-peaks.value / problem.stability.max_sensitivity) + tightening
    points = constraint_points(problem.device, peaks.omega[over > tightening / 2])
    return Violations(sensitivity=points, greatest=max(float(over[0]) - tightening / 2, 0.0))


def _unmodelled(problem: Problem, gains: Gains, tightening: float) -> Violations:
    """Find the points where |1 - S| r exceeds 1."""
    peaks = unmodelled_maxima(problem, gains)
    over = np.log(np.maximum(-peaks.value, 1e-300)) + tightening
    points = constraint_points(problem.device, peaks.omega[over > tightening / 2])
    return Violations(unmodelled=points, greatest=max(float(over[0]) - tightening / 2, 0.0))


def _inside(posed: Posed, gains: Gains, coupling: AnyCoupling, tightening: float) -> Violations:
    """Find the points at which the ratio is too small on devices inside the box, not at its vertices."""
    found, least = Violations(), log(posed.problem.stability.safety_factor) + tightening
    for worst in worst_inside(posed, gains, coupling):
        short = least - log(max(worst.ratio, 1e-300))
        if short > tightening / 2:
            found.ratio.append(ConstraintPoint(worst.omega, worst.device))
        found.greatest = max(found.greatest, short - tightening / 2)
        found.positive = found.positive and worst.ratio > 0
    return found


def _lowest_ratios(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Minima:
    """Return the local minima of Re Z_c / R, and its limit at omega = 0 if R is positive there."""
    minima, low = ratio_minima(problem, gains, coupling), towards_zero(problem)
    if gains.position == 0 or not low.size:
        return minima
    omega = np.append(low, minima.omega)
    value = np.append(stability_ratio(problem.device, gains, coupling, low), minima.value)
    order = np.argsort(value, kind="stable")
    return Minima(omega[order], value[order])


def near_peak(cases: list[Problem], gains: Gains) -> ConstraintPoint | None:
    """Return the point where |S| is greatest over all devices, if it is near its limit and below the Nyquist
    frequency."""
    loops = of_own_loops(cases)
    return _near_peak(loops, gains, [sensitivity_maxima(case, gains) for case in loops])


def _near_peak(cases: list[Problem], gains: Gains, peaks: list[Minima]) -> ConstraintPoint | None:
    case, there = min(zip(cases, peaks, strict=True), key=lambda pair: float(pair[1].value[0]))
    if case.bounds.velocity.fixed and (case.bounds.position.fixed or gains.position == 0):
        return None
    near = -there.value[0] > TRACKED_FROM * case.stability.max_sensitivity
    return (
        ConstraintPoint(float(there.omega[0]), case.device)
        if near and there.omega[0] < case.nyquist * (1 - 1e-6)
        else None
    )


def least_resistance(problem: Problem, gains: Gains) -> Minima:
    """Return the local minima of Re(D + Z_h) over the stability band, lowest first."""
    grid = demand_grid(problem.device, *sampled_span(problem))
    return local_minima(lambda omega: response(problem.device, gains, omega).resistance, grid)


def _error_peaks(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[ConstraintPoint]:
    band, weights = problem.transparency.band, problem.weights

    def negative_error(omega: Floats) -> Floats:
        return -np.sqrt(weighted_square(weights, error_terms(problem, gains, coupling, omega)))

    return constraint_points(
        problem.device, local_minima(negative_error, demand_grid(problem.device, band.min, band.max)).omega
    )
