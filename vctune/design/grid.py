"""The error and the demands over a grid of designs, the coupling in closed form (DESIGN 1.9).

For given K_v, K_p, b_0 and tau_c = m_c/b_c the least admissible b_c is a maximum over frequency,

    b_c >= (safety_factor R - b_0) (1 + 1/(omega tau_c)^2),

and the error grows with b_c: designs are points (K_v, corner, tau_c, b_0), with corner = K_p/(b + K_v). Everything here
is dimensionless (Z_0 = T = 1), on a fixed set of frequencies, and an estimate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from vctune.analysis.demands import sampled_span
from vctune.analysis.extrema import Floats
from vctune.analysis.stability import makes_no_turn
from vctune.design.cases import counted_of
from vctune.design.samples import Samples, samples_of
from vctune.document.problem import Problem, Range
from vctune.model.arithmetic import FLOATS
from vctune.model.llewellyn import required_resistance
from vctune.model.loop import G_hh_abs2, LoopResponse, tracking_abs2
from vctune.model.quantities import Gains

COUNTS = {"velocity": 28, "position": 18, "time_constant": 30, "drag": 13}
PER_DECADE = 3.5
"""Least number of corners of the integral action in a decade."""
INADMISSIBLE = 1e6
SENSITIVE, NEGATIVE, UNSTABLE = 1e3, 2e3, 3e3
"""Ranks of violations: |S| too great, Re G_hh < 0, sampled loop unstable."""
TIE = 1e-10
LOOPS_AT_ONCE = 160
"""Loops whose arrays are small enough to stay in the processor's cache."""


@dataclass(frozen=True, slots=True)
class Axes:
    """The grid's axes: K_v, corner of the integral action, tau_c, b_0; several grids at once along leading axes."""

    velocity: Floats
    corner: Floats
    time_constant: Floats
    drag: Floats

    def each(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the axes in order."""
        return self.velocity, self.corner, self.time_constant, self.drag


@dataclass(frozen=True, slots=True)
class Order:
    """What loops are worth by themselves.

    Attributes
    ----------
    deficit : how negative Re(D + Z_h) gets on the stability band, relative; 0 for sound loops
    sensitivity : greatest |S| up to Nyquist
    rank : 0 for loops in order, else the rank of what is wrong plus how much; the weaker an unstable loop, the less
    """

    deficit: Floats
    sensitivity: Floats
    rank: Floats


@dataclass(frozen=True, slots=True)
class Grid:
    """A scored grid over (K_v, corner, tau_c, b_0).

    Attributes
    ----------
    score : transparency error, or `INADMISSIBLE` times 1 plus the rank and the size of the violation
    damping : least b_c within the bounds
    order : of the loops behind it
    """

    score: Floats
    damping: Floats
    order: Order


@lru_cache(maxsize=4)
def axes(problem: Problem, *, integral: bool) -> Axes:
    """Return the coarse grid of a problem with or without an integrator."""
    device, bounds = problem.device, problem.bounds
    low, high = sampled_span(problem)
    loop_impedance = device.mass / device.lag + device.damping
    corner = np.array([0.0])
    if integral and bounds.position.fixed:
        corner = np.array([1 / device.lag])
    elif integral:
        slowest, fastest = 1e-2 * problem.transparency.band.min, 2 / device.lag
        count = max(COUNTS["position"], int(PER_DECADE * np.log10(fastest / slowest)))
        corner = np.geomspace(slowest, fastest, count)
    shortest = max(bounds.mass.min / bounds.damping.max, 1e-2 / high * min(1.0, 1 / bounds.damping.min))
    longest = min(bounds.mass.max / bounds.damping.min, 1e2 / low)
    tau_c = np.geomspace(shortest, longest, COUNTS["time_constant"]) if longest > shortest else np.array([shortest])
    if bounds.mass.fixed and bounds.damping.fixed:
        tau_c = np.array([bounds.mass.min / bounds.damping.min])
    K_v = _axis(bounds.velocity, COUNTS["velocity"], 1e-5 * loop_impedance)
    return Axes(K_v, corner, tau_c, _axis(bounds.drag, COUNTS["drag"], 1e-3))


def _axis(bounds: Range, count: int, floor: float) -> Floats:
    """Return a logarithmic grid over the bounds; a range from 0 starts with 0 and `floor`."""
    if bounds.fixed:
        return np.array([bounds.min])
    if bounds.min > 0:
        return np.clip(np.geomspace(bounds.min, bounds.max, count), bounds.min, bounds.max)
    return np.concatenate(([0.0], np.geomspace(min(floor, bounds.max / 10), bounds.max, count - 1)))


def position_gain(problem: Problem, K_v: Floats, corner: Floats) -> Floats:
    """Return K_p of a corner frequency, within its bounds; 0 where there is no integrator."""
    bounds = problem.bounds.position
    K_p = np.clip((problem.device.damping + K_v) * corner, bounds.min, bounds.max)
    return np.where(corner > 0, K_p, 0.0)


def scored(problem: Problem, samples: Samples, at: Axes) -> Grid:
    """Score every design of a grid, or of several grids along leading axes."""
    rows = max(1, LOOPS_AT_ONCE // at.corner.size)
    if at.velocity.ndim > 1 or at.velocity.size <= rows:
        return _scored(problem, samples, at)
    starts = range(0, at.velocity.size, rows)
    parts = [_scored(problem, samples, replace(at, velocity=at.velocity[i : i + rows])) for i in starts]
    return Grid(
        np.concatenate([part.score for part in parts]),
        np.concatenate([part.damping for part in parts]),
        Order(*(np.concatenate([getattr(part.order, name) for part in parts]) for name in Order.__slots__)),
    )


def _scored(problem: Problem, samples: Samples, at: Axes) -> Grid:
    K_v, corner = at.velocity[..., :, None], at.corner[..., None, :]
    gains = Gains(K_v, position_gain(problem, K_v, corner))
    bands = responses(samples, gains)
    order = order_of(problem, samples, gains, bands)
    damping, excess = _least_damping(problem, samples, bands, at)
    rank = order.rank[..., None, None]
    violation = np.where(rank > 0, rank, excess)
    error = _error(problem, samples, gains, damping, at)
    if problem.transparency.weights.coupling == 0:  # prefer the least coupling among equals
        error = error * (1 + TIE * np.log(damping / problem.bounds.damping.min))
    return Grid(np.where(violation > 0, INADMISSIBLE * (1 + violation), error), damping, order)


def least_errors(problem: Problem, gains: Gains) -> Floats:
    """Return the least error of any admissible coupling, inf where there is none.

    Parameters
    ----------
    problem : dimensionless
    gains : K_v and K_p, arrays of two dimensions
    """
    samples = samples_of(problem, integrator=bool(np.any(gains.position)))
    at, bands = axes(problem, integral=samples.integrator), responses(samples, gains)
    damping, excess = _least_damping(problem, samples, bands, at)
    admissible = (order_of(problem, samples, gains, bands).rank == 0)[..., None, None] & (excess == 0)
    return np.where(admissible, _error(problem, samples, gains, damping, at), np.inf).min(axis=(2, 3))


def responses(samples: Samples, gains: Gains) -> list[LoopResponse]:
    """Return the response of loops at the samples of the stability band, on each device."""
    return [
        there.band.response(there.device, _spread(gains), integrator=there.integrator) for there in samples.everywhere
    ]


def order_of(problem: Problem, samples: Samples, gains: Gains, bands: list[LoopResponse]) -> Order:
    """Return what loops are worth on the devices on which that is least.

    Parameters
    ----------
    problem : dimensionless
    samples : where to look
    gains : arrays that fit each other
    bands : their `responses`
    """
    orders = [_order(problem, there, gains, band) for there, band in zip(samples.everywhere, bands, strict=True)]
    return Order(*(np.maximum.reduce([getattr(order, name) for order in orders]) for name in Order.__slots__))


def _order(problem: Problem, samples: Samples, gains: Gains, band: LoopResponse) -> Order:
    device, integrator = samples.device, samples.integrator
    scale = device.damping + gains.velocity + gains.position * device.lag
    deficit = np.maximum(-band.resistance, 0).max(axis=-1) / np.maximum(scale, 1e-300)
    closed = [circle.closed(_spread(gains), integrator=integrator) for circle in samples.circles]
    sensitivity = np.sqrt((samples.circles[0].open.abs2() / closed[0].abs2()).max(axis=-1))
    strength = np.log1p((gains.velocity + gains.position * device.lag) * device.lag / device.mass)
    too_sensitive = np.log(np.maximum(sensitivity / problem.stability.max_sensitivity, 1.0))
    rank = np.where(too_sensitive > 0, SENSITIVE + too_sensitive, 0.0)
    rank = np.where(deficit > 0, NEGATIVE + deficit, rank)
    stable = np.all([makes_no_turn(F) for F in closed], axis=0)
    return Order(deficit, sensitivity, np.where(stable, rank, UNSTABLE + strength))


def _spread(gains: Gains) -> Gains:
    """Return gains that can be met with frequencies along a last axis."""
    return Gains(gains.velocity[..., None], gains.position[..., None])


def _least_damping(problem: Problem, samples: Samples, bands: list[LoopResponse], at: Axes) -> tuple[Floats, Floats]:
    """Return the least b_c within the bounds and log(how far b_c or m_c exceeds its upper bound)."""
    bounds, factor, omega = problem.bounds, problem.stability.safety_factor, samples.band.omega
    with np.errstate(divide="ignore", invalid="ignore"):
        needs = [np.where(band.resistance > 0, required_resistance(band, FLOATS), 0.0) for band in bands]
    required = np.maximum.reduce(needs)
    b_c = np.empty((*required.shape[:-1], at.time_constant.shape[-1], at.drag.shape[-1]))
    relative = 1 + 1 / (omega * at.time_constant[..., None]) ** 2
    for k in range(at.drag.shape[-1]):
        demand = np.maximum(factor * required - at.drag[..., k, None, None, None], 0.0)
        for i in range(at.time_constant.shape[-1]):
            b_c[..., i, k] = (demand * relative[..., i, None, None, :]).max(axis=-1)
    tau_c = at.time_constant[..., None, None, :, None]
    b_c = np.maximum(b_c, np.maximum(bounds.damping.min, bounds.mass.min / tau_c))
    most = np.minimum(bounds.damping.max, bounds.mass.max / tau_c)
    slack = 1 + 1e-9
    return b_c, np.where(b_c > most * slack, np.log(b_c / np.maximum(most, 1e-300)), 0.0)


def _error(problem: Problem, samples: Samples, gains: Gains, damping: Floats, at: Axes) -> Floats:
    """Return the transparency error; |Z_c|^2 = (b_0 + b_c u)^2 + (b_c v)^2 with u, v functions of omega tau_c."""
    averages, weights = samples.averages, problem.transparency.weights
    counted = samples.everywhere[: len(counted_of(problem))]
    loops = [there.nodes.response(there.device, _spread(gains), integrator=there.integrator) for there in counted]
    error2 = [weights.admittance**2 * G_hh_abs2(loop) + weights.tracking**2 * tracking_abs2(loop) for loop in loops]
    x2 = (samples.nodes.omega * at.time_constant[..., None]) ** 2
    u, v = x2 / (1 + x2), np.sqrt(x2) / (1 + x2)
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
    """Return averages over the last axis, without BLAS, whose sums depend on its number of threads."""
    mean: Floats = np.einsum("...k,k->...", values, averages)
    return mean
