"""Evaluate the constraints and the error over a grid of designs, with the coupling in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.nlp.working_set import Missed, Start
from vctune.design.prepared import Posed
from vctune.design.search.samples import Kinds, LoopFeasibility, Samples, loop_feasibility, samples_of, spread
from vctune.design.search.shapes import (
    coupling_of,
    least_scale_in_worlds,
    scale_limits,
    scale_per_resistance,
    time_constants,
    unit_response,
)
from vctune.model.gains import Gains
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.loop.loop import LoopResponse
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem, Range
from vctune.model.transparency import loop_terms
from vctune.running import check_time

COUNTS = {"velocity": 28, "position": 18, "time_constant": 30, "drag": 13}  # Least number of points on each axis
PER_DECADE = 3.5  # Least number of corners, and of time constants, in a decade
LOOPS_AT_ONCE = 160  # Number of loops that the code evaluates at once


@dataclass(frozen=True, slots=True)
class Axes:
    """The axes of a grid: K_v, corner of the integral action, tau_c, b_0. Arrays with leading dimensions describe
    several grids."""

    velocity: Floats
    corner: Floats
    time_constant: Floats
    drag: Floats

    def each(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the axes in order."""
        return self.velocity, self.corner, self.time_constant, self.drag


@dataclass(frozen=True, slots=True)
class Scores:
    """The scores of designs in lexicographic order: violated constraint, violation, error, coupling."""

    missed: Kinds  # most serious violated constraint
    violation: Floats  # amount of the violation; 0 without one
    error: Floats  # transparency error if the design violates no constraint, else inf
    scale: Floats  # least scale (b_c, m_c of a rigid coupling, or 1/k_c) that meets the constraint and the lower bounds

    def __getitem__(self, index: Any) -> Scores:
        """Return the scores of the designs with the given index."""
        return Scores(self.missed[index], self.violation[index], self.error[index], self.scale[index])

    def rank(self, at: tuple[int, ...]) -> tuple[int, float, float]:
        """Return the sort key of one design, except for its coupling."""
        return int(self.missed[at]), float(self.violation[at]), float(self.error[at])

    def lowest(self) -> tuple[NDArray[np.intp], ...]:
        """Return the index of the best design for each entry of the first axis, as one array for each axis."""
        shape = len(self.error), prod(self.error.shape[1:])
        missed, *others = (v.reshape(shape) for v in (self.missed, self.violation, self.error, self.scale))
        among = missed == missed.min(axis=1, keepdims=True)
        for values in others:
            left = np.where(among, values, inf)
            among &= left == left.min(axis=1, keepdims=True)
        return np.arange(len(missed)), *np.unravel_index(among.argmax(axis=1), self.error.shape[1:])

    def ranks(self) -> Floats:
        """Return one number for each design: its error or, if no design is feasible, its rank."""
        if np.isfinite(self.error).any():
            return self.error
        missed, violation = self.missed.ravel(), self.violation.ravel()
        order = np.lexsort((violation, missed))
        rises = (np.diff(missed[order]) > 0) | (np.diff(violation[order]) > 0)
        places = np.empty(order.size)
        places[order] = np.concatenate(([0], np.cumsum(rises)))[: order.size]
        return places.reshape(self.error.shape)


@lru_cache(maxsize=4)
def axes(posed: Posed, *, integral: bool) -> Axes:
    """Return the coarse grid of a problem with or without an integrator."""
    problem, (low, high) = posed.problem, posed.span
    device, bounds = problem.device, problem.bounds
    loop_impedance = device.mass / device.loop_lag + device.damping
    corner = np.array([0.0])
    if integral and bounds.position.fixed:
        corner = np.array([1 / device.loop_lag])
    elif integral:
        # a corner far below the band has no effect in the band; with a corner above 1/lag, Re D < 0 at low frequency
        slowest, fastest = 1e-2 * problem.transparency.band.min, 2 / device.loop_lag
        corner = np.geomspace(slowest, fastest, _count("position", slowest, fastest))
    shortest, longest = time_constants(problem, low, high)
    tau_c = np.array([shortest])
    if longest > shortest:
        tau_c = np.geomspace(shortest, longest, _count("time_constant", shortest, longest))
    if device.kind.inverse and bounds.damping.min == 0 < longest:
        tau_c = np.append(0.0, tau_c)  # a spring without a damper
    # K_v has hardly any effect below 1e-5 of the loop's impedance; a drag below 1e-3 adds hardly any error
    K_v = _axis(bounds.velocity, COUNTS["velocity"], 1e-5 * loop_impedance)
    return Axes(K_v, corner, tau_c, _axis(bounds.drag, COUNTS["drag"], 1e-3))


def _count(name: str, low: float, high: float) -> int:
    return max(COUNTS[name], int(PER_DECADE * np.log10(high / low)))


def _axis(bounds: Range, count: int, floor: float) -> Floats:
    """Return a logarithmic grid over the bounds. If the least value is 0 or far below `floor`, the next point is
    `floor`."""
    if bounds.fixed:
        return np.array([bounds.min])
    floor = min(floor, bounds.max / 10)
    if bounds.min >= floor / 2:
        return np.clip(np.geomspace(bounds.min, bounds.max, count), bounds.min, bounds.max)
    return np.concatenate(([bounds.min], np.geomspace(floor, bounds.max, count - (bounds.min == 0))))


def position_gain(problem: Problem, K_v: Floats, corner: Floats) -> Floats:
    """Return K_p for a corner frequency, within its bounds; 0 without an integrator."""
    bounds = problem.bounds.position
    K_p = np.clip((problem.device.damping + K_v) * corner, bounds.min, bounds.max)
    return np.where(corner > 0, K_p, 0.0)


def evaluated(problem: Problem, samples: Samples, at: Axes) -> tuple[Scores, LoopFeasibility]:
    """Score every design of a grid, or of several grids along leading axes, and the loops of these designs."""
    rows = max(1, LOOPS_AT_ONCE // at.corner.shape[-1])
    if at.velocity.ndim > 1 or at.velocity.size <= rows:
        return _evaluated(problem, samples, at)
    starts = range(0, at.velocity.size, rows)
    parts = [_evaluated(problem, samples, replace(at, velocity=at.velocity[i : i + rows])) for i in starts]
    scores, loops = zip(*parts, strict=True)
    return Scores(*_joined(scores)), LoopFeasibility(*_joined(loops))


def _joined(parts: tuple[Any, ...]) -> list[Any]:
    """Return the arrays of several parts of a grid, joined along the first axis."""
    return [np.concatenate([getattr(part, name) for part in parts]) for name in parts[0].__slots__]


def _evaluated(problem: Problem, samples: Samples, at: Axes) -> tuple[Scores, LoopFeasibility]:
    check_time()
    K_v, corner = at.velocity[..., :, None], at.corner[..., None, :]
    gains = Gains(K_v, position_gain(problem, K_v, corner))
    bands = responses(samples, gains)
    loops = loop_feasibility(problem, samples, gains, bands)
    return _scores(problem, samples, gains, bands, loops, at), loops


def least_errors(posed: Posed, gains: Gains) -> Floats:
    """Return the least error over all feasible couplings; inf if no coupling is feasible."""
    problem, samples = posed.problem, samples_of(posed, integrator=bool(np.any(gains.position)))
    at, bands = axes(posed, integral=samples.integrator), responses(samples, gains)
    loops = loop_feasibility(problem, samples, gains, bands)
    least: Floats = _scores(problem, samples, gains, bands, loops, at).error.min(axis=(2, 3))
    return least


def _scores(
    problem: Problem, samples: Samples, gains: Gains, bands: list[LoopResponse], loops: LoopFeasibility, at: Axes
) -> Scores:
    least = _least_damping(problem, samples, gains, bands, at)
    damping, excess = _within_bounds(problem, least, at)
    loop_missed = loops.missed[..., None, None]
    missed = np.where((loop_missed == Missed.NOTHING) & (excess > 0), np.int8(Missed.COUPLING), loop_missed)
    violation = np.where(loop_missed > Missed.NOTHING, loops.violation[..., None, None], excess)
    error = np.where(missed == Missed.NOTHING, _error(problem, samples, gains, damping, at), inf)
    return Scores(missed, violation, error, damping)


def responses(samples: Samples, gains: Gains) -> list[LoopResponse]:
    """Return the responses of loops at the samples of the stability band, for each device."""
    return [there.band.response(spread(gains)) for there in samples.everywhere]


def _required(samples: Samples, gains: Gains, bands: list[LoopResponse]) -> tuple[Floats, Floats]:
    """Return the places at which the coupling must meet R, and the greatest R over all devices and hands at each
    place."""
    places = []
    with np.errstate(divide="ignore", invalid="ignore"):
        if samples.band.omega.size:
            needs = [np.where(band.resistance > 0, required_resistance(band, FLOATS), 0.0) for band in bands]
            places.append((samples.band.omega, np.maximum.reduce(needs)))
        each = Gains(gains.velocity[..., None, None], gains.position[..., None, None])
        at_angles: dict[bytes, tuple[Floats, list[Floats]]] = {}  # devices with a structure have more angles
        for held in (hands for there in samples.everywhere for hands in there.in_hand):
            check_time()
            need = np.nan_to_num(held.required(each), nan=0.0).max(axis=-2)
            at_angles.setdefault(held.theta.tobytes(), (held.theta, []))[1].append(need)
        for theta, needs in at_angles.values():
            half = theta / 2
            slope = np.where(np.cos(half) > 1e-12, np.sin(half) / np.maximum(np.cos(half), 1e-12), inf)
            places.append((theta if samples.device.kind.inverse else 2 * slope, np.maximum.reduce(needs)))
    omega, required = zip(*places, strict=True)
    return np.concatenate(omega), np.concatenate(required, axis=-1)


def _least_damping(problem: Problem, samples: Samples, gains: Gains, bands: list[LoopResponse], at: Axes) -> Floats:
    """Return the least scale, b_c or 1/k_c, that meets the constraint on the coupling."""
    if problem.worlds_met is not None:
        return least_scale_in_worlds(problem.worlds_met, samples, gains, at.time_constant, at.drag)
    factor = problem.stability.safety_factor
    place, required = _required(samples, gains, bands)
    b_c = np.empty((*required.shape[:-1], at.time_constant.shape[-1], at.drag.shape[-1]))
    relative = scale_per_resistance(problem.device, place, at.time_constant[..., None])
    for k in range(at.drag.shape[-1]):
        demand = np.maximum(factor * required - at.drag[..., k, None, None, None], 0.0)
        for i in range(at.time_constant.shape[-1]):
            b_c[..., i, k] = (demand * relative[..., i, None, None, :]).max(axis=-1)
    return b_c


def _within_bounds(problem: Problem, scale: Floats, at: Axes) -> tuple[Floats, Floats]:
    """Return a scale, raised to at least its lower bound, and the log of its ratio to the upper bound (0 within the
    bounds)."""
    least, most = scale_limits(problem, at.time_constant[..., None, None, :, None])
    b_c = np.maximum(scale, least)
    slack = 1 + 1e-9
    return b_c, np.where(b_c > most * slack, np.log(b_c / np.maximum(most, 1e-300)), 0.0)


def _error(problem: Problem, samples: Samples, gains: Gains, damping: Floats, at: Axes) -> Floats:
    """Return the transparency error, with |Z_c|^2 = (b_0 + b_c u)^2 + (b_c v)^2, or |1/Z_c|^2 without b_0."""
    averages, weights = samples.averages, problem.weights
    counted = samples.everywhere[: samples.objective]
    loops = [there.nodes.response(spread(gains)) for there in counted]
    kind = problem.device.kind
    terms = [loop_terms(loop, there.nodes.device, kind) for loop, there in zip(loops, counted, strict=True)]
    error2 = [weights.admittance**2 * each.admittance + weights.tracking**2 * each.tracking for each in terms]
    u, v = unit_response(problem.device, samples.nodes.omega, at.time_constant[..., None])
    weight = weights.coupling**2
    drag = at.drag[..., None, None, None, :]
    if problem.transparency.norm == "rms":
        mean_u, mean_2 = (_mean(of, averages)[..., None, None, :, None] for of in (u, u * u + v * v))
        Z_c2 = drag * drag + 2 * drag * damping * mean_u + damping**2 * mean_2
        mean = np.maximum.reduce([_mean(each, averages) for each in error2])
        return np.sqrt(mean[..., None, None] + weight * Z_c2)
    b_c, u, v = damping[..., None], u[..., None, None, :, None, :], v[..., None, None, :, None, :]
    Z_c2 = (drag[..., None] + b_c * u) ** 2 + (b_c * v) ** 2
    return np.sqrt((np.maximum.reduce(error2)[..., None, None, :] + weight * Z_c2).max(axis=-1))


def _mean(values: Floats, averages: Floats) -> Floats:
    """Return averages over the last axis. The function avoids BLAS, whose sums depend on the number of threads."""
    mean: Floats = np.einsum("...k,k->...", values, averages)
    return mean


HALVINGS = 3  # Number of times that the code halves the grid spacing around a local minimum

Index = tuple[int, ...]  # Index of a design on a grid with the axes K_v, corner, tau_c and b_0


def minima_of(problem: Problem, scores: Scores) -> list[Index]:
    """Return the local minima among the feasible designs of a grid, the best first."""
    ranks = scores.ranks()
    if problem.weights.coupling > 0:
        return local_minima(ranks)
    return [(*loop, *lowest(scores[loop])) for loop in local_minima(ranks.min(axis=(2, 3)))]


def lowest(scores: Scores) -> Index:
    """Return the index of the best design of a grid."""
    return tuple(int(at[0]) for at in scores[None].lowest()[1:])


def local_minima(ranks: Floats) -> list[Index]:
    """Return the indices of the finite values on a grid that are not greater than any neighbour, the lowest first."""
    least = ranks
    for axis in range(ranks.ndim):  # take the least of each point's neighbourhood along one axis after the other
        before, after = (least.take(at, axis) for at in _beside(ranks.shape[axis]))
        least = np.minimum(least, np.minimum(before, after))
    found = np.argwhere((ranks <= least) & np.isfinite(ranks))
    order = np.argsort(ranks[tuple(found.T)], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]


def between_neighbours(grid: Axes, places: list[Index]) -> Axes:
    """Return small grids around designs: on each axis the design and its two neighbours, axes of shape (designs, 3)."""
    by_axis = np.array(places, dtype=np.intp).reshape(-1, len(grid.each())).T
    return Axes(*(_between(np.tile(axis, (at.size, 1)), at) for axis, at in zip(grid.each(), by_axis, strict=True)))


def refined(problem: Problem, samples: Samples, near: Axes) -> list[Start]:
    """Refine all local minima together."""
    if not len(near.velocity):
        return []
    for _ in range(HALVINGS):
        finer = [_finer(axis) for axis in near.each()]
        scores, _loops = evaluated(problem, samples, Axes(*(axis[:, 1:-1] for axis in finer)))
        at = scores.lowest()
        near = Axes(*(_between(axis, 1 + i) for axis, i in zip(finer, at[1:], strict=True)))
    best = scores[at]
    middles = zip(*(axis[:, 1] for axis in near.each()), strict=True)
    return [_start(problem, middle, best, k) for k, middle in enumerate(middles)]


def _beside(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices before and after each index of an axis; at an end, the index itself."""
    at = np.arange(size)
    return np.maximum(at - 1, 0), np.minimum(at + 1, size - 1)


def _between(axes: Floats, at: NDArray[np.intp]) -> Floats:
    """Return the value of each design and of its two neighbours on an axis, shape (designs, 3)."""
    beside = np.clip(at[:, None] + np.array([-1, 0, 1]), 0, axes.shape[1] - 1)
    return np.take_along_axis(axes, beside, axis=1)


def _finer(near: Floats) -> Floats:
    """Return three points on a logarithmic axis and the two midpoints between them; three equal points stay three."""
    low, middle, high = near.T
    if np.array_equal(low, high):
        return near
    middles = [np.where(a > 0, np.sqrt(a * b), b / 2) for a, b in ((low, middle), (middle, high))]
    return np.stack((low, middles[0], middle, middles[1], high), axis=1)


def _start(problem: Problem, at: tuple[float, ...], best: Scores, k: int) -> Start:
    K_v, corner, tau_c, drag = map(float, at)
    missed, violation, error = best.rank((k,))
    return Start(
        Gains(K_v, float(position_gain(problem, np.array(K_v), np.array(corner)))),
        coupling_of(problem, float(best.scale[k]), tau_c, drag),
        error,
        Missed(missed),
        violation,
    )
