"""Scan all designs on a grid for starts of the optimiser (design/README.md, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isclose

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.nlp.working_set import Missed, Start
from vctune.design.prepared import Posed
from vctune.design.search.grid import (
    Axes,
    Index,
    Scores,
    axes,
    between_neighbours,
    evaluated,
    lowest,
    minima_of,
    position_gain,
    refined,
    responses,
)
from vctune.design.search.samples import LoopFeasibility, Samples, loop_feasibility, samples_of
from vctune.design.variables import point
from vctune.model.gains import Gains
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.running import check_time

# Number of times that the code divides the step with the limit, and number of parts of each division
ROUNDS, PARTS = 3, 4
BELOW, ABOVE = 0.93, 1.03  # Factors of the limit that give the neighbours of a design at the limit


@dataclass(frozen=True, slots=True)
class GainLimits:
    """The greatest feasible K_v at each corner frequency at which the grid contains a limit."""

    corner: NDArray[np.intp]  # index of the corner in the grid, and index of the last K_v of the grid below the limit
    below: NDArray[np.intp]
    velocity: Floats  # greatest feasible K_v, accurate to 1 %
    scores: Scores  # scores of the designs at the limits, shape (corners, 1, time constants, drags)

    def places(self, problem: Problem, grid: Axes, minima: list[tuple[int, ...]]) -> Axes:
        """Return small grids around designs at the limits: on each axis the design and its two neighbours."""
        near = between_neighbours(
            grid, [(int(self.below[k]), int(self.corner[k]), tau, drag) for k, _, tau, drag in minima]
        )
        K_v, bounds = self.velocity[[k for k, *_ in minima]], problem.bounds.velocity
        beside = np.maximum(BELOW * K_v, bounds.min), K_v, np.minimum(ABOVE * K_v, bounds.max)
        return replace(near, velocity=np.stack(beside, axis=1))


def gain_limits(problem: Problem, samples: Samples, grid: Axes, loops: LoopFeasibility) -> GainLimits:
    """Find the greatest feasible K_v at all corners of a grid at once, and score the designs with these K_v."""
    last = loops.feasible[:-1] & ~loops.feasible[1:]
    corner = np.flatnonzero(last.any(axis=0))
    if not corner.size:
        nothing = np.empty((0, 1, grid.time_constant.size, grid.drag.size))
        return GainLimits(corner, corner, np.empty(0), Scores(nothing.astype(np.int8), nothing, nothing, nothing))
    below = last[:, corner].argmax(axis=0)
    low, high, omega = grid.velocity[below], grid.velocity[below + 1], grid.corner[corner, None]
    t, places = np.arange(1, PARTS) / PARTS, np.arange(corner.size)
    for _ in range(ROUNDS):
        check_time()
        K_v = low[:, None] + (high - low)[:, None] * t
        gains = Gains(K_v, position_gain(problem, K_v, omega))
        good = loop_feasibility(problem, samples, gains, responses(samples, gains)).feasible
        steps, at = np.column_stack((low, K_v, high)), np.logical_and.accumulate(good, axis=1).sum(axis=1)
        low, high = steps[places, at], steps[places, at + 1]
    scores, _ = evaluated(problem, samples, replace(grid, velocity=low[:, None], corner=omega))
    return GainLimits(corner, below, low, scores[:, 0])


# Greatest number of local minima that the scan refines on a grid, greatest number that it refines on the gain limits,
# and greatest number that it returns
STARTS = 8
CLOSE = 0.02  # Two starts count as one if each of their variables differs by at most this share
# Factors by which the scan varies given gains when it looks for a better coupling
AROUND = {"velocity": np.array([0.8, 0.9, 0.96, 0.99, 1.0, 1.02, 1.1]), "corner": np.geomspace(0.25, 4.0, 13)}
# The scan refines a local minimum of the coarse grid if its error, divided by the least error, is at most this ratio
PROMISING = 3.0


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Starts, the best first, and the greatest |S| that the scan found."""

    starts: list[Start]  # local minima of the scan, best first
    peak_sensitivity: float  # greatest |S| among stable loops with Re G_hh > 0


def scan(posed: Posed) -> ScanResult:
    """Scan a dimensionless problem for starts."""
    problem, faces = posed.problem, _faces(posed.problem)
    found: list[Start] = []
    peak = 0.0
    for integral in faces:
        coarse, samples = axes(posed, integral=integral), samples_of(posed, integrator=integral)
        scores, loops = evaluated(problem, samples, coarse)
        workable = loops.missed < Missed.RESISTANCE
        peak = max(peak, float(loops.peak_sensitivity[workable].max(initial=0.0)))
        limits = gain_limits(problem, samples, coarse, loops)
        errors = float(scores.error.min()), float(limits.scores.error.min(initial=inf)), *(s.error for s in found)
        left_out = 0 if integral and False in faces else None
        found += refined(
            problem, samples, _promising(problem, coarse, scores, limits, PROMISING * min(errors), left_out)
        )
    found.sort(key=lambda start: start.rank)
    return ScanResult(_distinct(found)[:STARTS], peak)


def _promising(
    problem: Problem, coarse: Axes, scores: Scores, limits: GainLimits, most: float, left_out: int | None
) -> Axes:
    """Return the best local minima of the grid and of its gain limits, each with its neighbours on every axis."""
    best = limits.scores[limits.scores.lowest()]
    loops = zip(limits.below.tolist(), limits.corner.tolist(), strict=True)
    on_limit: dict[Index, tuple[int, float, float]] = {loop: best.rank((k,)) for k, loop in enumerate(loops)}

    def beaten(at: Index) -> bool:
        return at[:2] in on_limit and on_limit[at[:2]] <= scores.rank(at)

    inner = [at for at in minima_of(problem, scores) if at[1] != left_out and not beaten(at)][:STARTS]
    outer = [at for at in minima_of(problem, limits.scores) if limits.corner[at[0]] != left_out][:STARTS]
    within = between_neighbours(coarse, [at for at in inner if scores.error[at] <= most])
    at_limits = limits.places(problem, coarse, [at for at in outer if limits.scores.error[at] <= most])
    return Axes(*(np.concatenate(pair) for pair in zip(within.each(), at_limits.each(), strict=True)))


def _faces(problem: Problem) -> list[bool]:
    """Return which laws to search: False stands for no integrator (K_p = 0), True for an integrator."""
    position, device = problem.bounds.position, problem.device
    held = device.operator is not None and device.operator.damping > 0
    barred = (
        problem.passive
        and problem.stability.band.min == 0
        and not held
        and (device.damping > 0 or lags(device, FLOATS).sensor > 0)
    )
    faces = [False] if position.min == 0 else []
    return [*faces, True] if position.max > 0 and not (barred and problem.bounds.drag.max == 0) else faces


def start_at(posed: Posed, gains: Gains) -> Start | None:
    """Return the best feasible start around given gains, with any coupling; None if none is feasible."""
    problem, (samples, fine) = posed.problem, _surroundings(posed, gains)
    scores, _ = evaluated(problem, samples, fine)
    at = lowest(scores)
    return refined(problem, samples, between_neighbours(fine, [at]))[0] if scores.error[at] < inf else None


def _surroundings(posed: Posed, gains: Gains) -> tuple[Samples, Axes]:
    """Return a fine grid of gains around the given ones, with all couplings of the coarse grid."""
    problem, integral = posed.problem, gains.position > 0
    coarse, bounds = axes(posed, integral=integral), problem.bounds.velocity
    K_v = np.array(sorted({*np.clip(gains.velocity * AROUND["velocity"], bounds.min, bounds.max).tolist()}))
    corner = _corner(problem, gains) * (AROUND["corner"] if integral else np.ones(1))
    return samples_of(posed, integrator=integral), replace(coarse, velocity=K_v, corner=corner)


def _corner(problem: Problem, gains: Gains) -> float:
    return gains.position / (problem.device.damping + gains.velocity) if gains.position > 0 else 0.0


def _distinct(starts: list[Start]) -> list[Start]:
    kept: list[Start] = []
    for start in starts:
        if not any(_alike(start, other) for other in kept):
            kept.append(start)
    return kept


def _alike(start: Start, other: Start) -> bool:
    return all(
        isclose(a, b, rel_tol=CLOSE)
        for a, b in zip(point(start.gains, start.coupling), point(other.gains, other.coupling), strict=True)
    )
