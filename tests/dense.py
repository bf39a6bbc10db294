"""Designs and devices judged on dense grids by `vctune.bench.evaluator`, many at a time; a problem is only read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
from arithmetic import Digits
from loop import Loop, matrix
from scipy.integrate import simpson
from scipy.linalg import expm

from vctune.bench.evaluator import (
    Scene,
    cases,
    coupling_impedance,
    impedances,
    required,
    samples,
    sensitivity,
    stability_ratio,
)
from vctune.model.problem import Problem

COARSE = 60
"""Frequencies that sort out most designs."""
GRID, PER_DECADE, PLACES, ZOOMS = 500, 100, 3, 6
ZOOM = np.linspace(0.0, 1.0, 13)
TOGETHER = 500
"""Cases judged at a time."""
DECADES = 3
NEXT_TO_1, MANY = 1e-9, Digits(300)  # radii so near to 1 are not told from it in doubles
STEEP = 2.0
"""Radians between neighbouring frequencies from which a curve's turns cannot be counted."""
FINEST = 512
"""How many times as many frequencies a curve is counted on at most that passes close to 0."""
NAMES = ("velocity", "position", "damping", "mass", "drag")


def part(case: Scene, index: Any) -> Scene:
    """Return some of the cases, by a NumPy index."""
    arrays = {f.name: getattr(case, f.name) for f in fields(case)}
    return replace(case, **{name: x[index] for name, x in arrays.items() if np.ndim(x)})


def error(problem: Problem, case: Scene, points: int = 20_001) -> Any:
    """Return the transparency error of each case on a dense grid (model/README.md, section 8)."""
    band = problem.transparency.band
    square = squared_error(problem, case, np.geomspace(band.min, band.max, points))
    if problem.transparency.norm == "peak":
        return np.sqrt(square.max(axis=-1))
    return np.sqrt(simpson(square, dx=1 / (points - 1), axis=-1))


def squared_error(problem: Problem, case: Scene, omega: Any) -> Any:
    """Return the square of the transparency error at frequencies (paper eq. 21), without the least operator."""
    objective, (Z_d, C) = problem.transparency, impedances(case, 1j * omega)
    D, Z_0, weights = Z_d + C, objective.reference_impedance, objective.weights
    square = (weights.admittance * Z_0 / np.abs(D)) ** 2 + (weights.tracking * np.abs(Z_d / D)) ** 2
    return square + (weights.coupling * np.abs(coupling_impedance(case, 1j * omega)) / Z_0) ** 2


def loops(case: Scene) -> tuple[Scene, ...]:
    """Return the loops that must be stable on their own: without a hand, and with the least operator."""
    bare = replace(case, m_h=0.0, b_h=0.0)
    held = replace(bare, mass=case.mass + case.m_h, damping=case.damping + case.b_h)
    return (bare,) if case.m_h == case.b_h == 0 else (bare, held)


def spectral_radius(case: Scene) -> np.ndarray | float:
    """Return the spectral radius of each sampled loop without a hand: one number, or shape (n,) for n cases."""
    return by_kind(case, lambda some: np.abs(np.linalg.eigvals(loop_matrices(some))).max(axis=1))


def by_kind(case: Scene, evaluate: Callable[[Scene], np.ndarray]) -> np.ndarray | float:
    """Evaluate a function of loops without a hand and a coupling, on groups of loops with the same number of states."""
    names = ("mass", "damping", "delay", "K_v", "K_p")
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(getattr(case, name), float)) for name in names))
    each = dict(zip(names, arrays, strict=True))
    flat, results = replace(case, b_c=1.0, m_c=1.0, b_0=0.0, **each), np.empty(arrays[0].size)
    kinds = np.stack((samples(flat)[0], flat.K_p > 0))
    for kind in np.unique(kinds, axis=1).T:
        members = np.flatnonzero((kinds == kind[:, None]).all(axis=0))
        results[members] = evaluate(part(flat, members))
    return results if any(np.ndim(getattr(case, name)) for name in names) else float(results[0])


def loop_matrices(case: Scene) -> np.ndarray:
    """Return the matrices that advance v, x and the earlier commands by one sample, of shape (n, size, size)."""
    order, whole = 2 if case.K_p[0] > 0 else 1, int(samples(case)[0][0])
    A, full = _motion(case, np.full(len(case.K_v), case.sample_time), order)
    newest = _motion(case, case.sample_time - samples(case)[1], order)[1]
    size = order + whole + 1
    # rows: the force commanded now, the force commanded one sample ago, ...
    commands = np.zeros((len(case.K_v), whole + 2, size))
    commands[:, 0, :order] = -np.stack((case.K_v, case.K_p)[:order], axis=1)
    commands[:, 1:, order:] = np.eye(whole + 1)
    matrices = np.zeros((len(case.K_v), size, size))
    matrices[:, :order, :order] = A
    matrices[:, :order] += newest[:, :, None] * commands[:, None, whole]
    matrices[:, :order] += (full - newest)[:, :, None] * commands[:, None, whole + 1]
    matrices[:, order:] = commands[:, : whole + 1]
    return matrices


def _motion(case: Scene, t: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix of the motion over a time t, and the effect of a constant unit force."""
    rates = np.zeros((len(t), order + 1, order + 1))
    rates[:, 0, 0], rates[:, 0, order], rates[:, 1:order, 0] = -case.damping / case.mass, 1 / case.mass, 1.0
    whole = expm(rates * t[:, None, None])
    return whole[:, :order, :order], whole[:, :order, order]


def band(problem: Problem) -> tuple[float, float]:
    """Return the stability band, an endless one cut far beyond everything that happens."""
    low, high = problem.stability.band.min, problem.stability.band.max
    slow = min(problem.transparency.band.min, problem.nyquist) * 10.0**-DECADES
    return low if low > 0 else slow, high if np.isfinite(high) else problem.nyquist * 10.0**DECADES


def least(f: Callable, low: float, high: float, count: int) -> np.ndarray:
    """Return the least value of f over [low, high] for each case: a grid's lowest places, each refined."""
    steps = max(GRID, int(PER_DECADE * np.log10(high / low)))
    omega = np.union1d(np.geomspace(low, high, steps)[1:-1], np.linspace(low, high, GRID))
    values = np.broadcast_to(f(omega), (count, omega.size)).copy()
    best, rows = values.min(axis=1), np.arange(count)
    for _ in range(PLACES):
        at = values.argmin(axis=1)
        left, right = omega[np.maximum(at - 1, 0)], omega[np.minimum(at + 1, omega.size - 1)]
        for away in range(-3, 4):
            values[rows, np.clip(at + away, 0, omega.size - 1)] = np.inf
        for _ in range(ZOOMS):
            fine = left[:, None] + (right - left)[:, None] * ZOOM
            near = f(fine)
            k = near.argmin(axis=1)
            best = np.minimum(best, near[rows, k])
            left, right = fine[rows, np.maximum(k - 1, 0)], fine[rows, np.minimum(k + 1, ZOOM.size - 1)]
    return best


def surpluses(problem: Problem, case: Scene) -> np.ndarray:
    """Return by how much each case meets each demand, >= 0 where it does; shape (4, n).

    Rows are the least Re Z_c/(factor R) - 1 on the band, at most 1; 1 - max |S|/limit; 1 - spectral radius; and 0.5
    less the frequency model's unstable poles, nan where they cannot be counted, 0.5 where another demand is missed.
    """
    count = np.broadcast(case.mass, case.K_v).size
    parts = [part(case, slice(i, i + TOGETHER)) for i in range(0, count, TOGETHER)]
    found = np.full((4, count), 0.5)
    for k, row in enumerate((conditions_surplus, sensitivity_surplus, sampled_surplus)):
        found[k] = np.concatenate([row(problem, part) for part in parts])
    good = np.flatnonzero((found[:3] >= 0).all(axis=0))
    if good.size:
        found[3, good] -= np.max([unstable_model_poles(part(loop, good)) for loop in loops(case)], axis=0)
    return found


def conditions_surplus(problem: Problem, case: Scene) -> np.ndarray:
    factor, count = problem.stability.safety_factor, np.broadcast(case.mass, case.K_v).size
    return least(lambda omega: np.minimum(stability_ratio(case, omega) / factor - 1, 1.0), *band(problem), count)


def sensitivity_surplus(problem: Problem, case: Scene) -> np.ndarray:
    limit, nyquist = problem.stability.max_sensitivity, problem.nyquist
    ringing = np.sqrt(case.K_p / case.mass) + np.zeros(np.broadcast(case.mass, case.K_v).size)
    low = 0.1 * np.clip(ringing[ringing > 0], nyquist * 1e-8, nyquist * 1e-3).min(initial=nyquist * 1e-3)
    return least(lambda omega: 1 - sensitivity(case, omega) / limit, low, nyquist, ringing.size)


def sampled_surplus(problem: Problem, case: Scene) -> np.ndarray:
    rows = np.array([1 - np.atleast_1d(spectral_radius(loop)) for loop in loops(case)])
    for k, i in np.argwhere(np.abs(rows) < NEXT_TO_1):
        one = part(loops(case)[k], i)
        device = {name: getattr(one, name) for name in ("mass", "damping", "sample_time", "delay")}
        power = matrix(Loop(device, (one.K_v, one.K_p), num=MANY), at_rest=True)
        for _ in range(100):
            power = power @ power
        rows[k, i] = NEXT_TO_1 if abs(power).max() < 1 else -NEXT_TO_1
    return rows.min(axis=0)


def unstable_model_poles(case: Scene) -> np.ndarray:
    """Return how many zeros Z_d + C has in the right half plane; nan where it comes too close to 0 to say.

    s D/(m (s + a)^2), or D/(m (s + a)) without K_p, is real at 0 and at infinity and turns by -2 pi for each of them.
    """

    def counted(some: Scene) -> np.ndarray:
        parts = range(0, len(some.K_v), TOGETHER // 10)
        return np.concatenate([_turns(part(some, slice(i, i + TOGETHER // 10)), 1) for i in parts])

    return by_kind(case, counted)


def _turns(case: Scene, density: int) -> np.ndarray:
    a = np.maximum(np.maximum(case.K_v, case.damping) / case.mass, np.sqrt(case.K_p / case.mass))
    with np.errstate(divide="ignore"):
        creeping = case.K_p / (case.K_v + case.damping)
    slow = np.minimum(np.minimum(creeping, np.sqrt(case.K_p / case.mass)), a) if case.K_p[0] > 0 else a
    even = density * (400 + int((10 * a * (case.sample_time + case.delay)).max() / 0.02))
    across = np.geomspace(1e-4 * (slow / a).min(), 1, density * 1500)
    s = 10j * a[:, None] * np.union1d(across, np.linspace(0, 1, even)[1:])
    around = sum(impedances(case, s)) / (s + a[:, None])
    angle = np.unwrap(np.angle(around * (s / (s + a[:, None]) if case.K_p[0] > 0 else 1)), axis=1)
    poles = 2 * np.round((angle[:, 0] - angle[:, -1]) / (2 * np.pi))
    steep = np.abs(np.diff(angle, axis=1)).max(axis=1) > STEEP
    if steep.any():
        poles[steep] = np.nan if density >= FINEST else _turns(part(case, steep), 8 * density)
    return poles


def meet_demands(problem: Problem, designs: np.ndarray) -> np.ndarray:
    """Return which designs, in columns, meet every demand."""
    return (surpluses(problem, cases(problem.device, designs)) >= 0).all(axis=0) & meet_limit(problem, designs)


def meet_limit(problem: Problem, designs: np.ndarray) -> np.ndarray:
    """Return which designs meet the conditions in the limit omega = 0, as far as drag and K_p decide."""
    device, (K_v, K_p, _, _, b_0) = problem.device, designs
    if problem.stability.band.min > 0:
        return np.ones(designs.shape[1], bool)
    held = device.operator.damping if device.operator else 0.0
    rest = K_v - (device.sample_time / 2 + device.delay) * K_p
    slope = device.damping + held + rest
    enough = 4 * slope * b_0 >= problem.stability.safety_factor * (device.damping**2 - 4 * held * rest)
    return (K_p == 0) | ((slope >= 0) & enough)


def within_bounds(problem: Problem, designs: np.ndarray) -> np.ndarray:
    ranges = (getattr(problem.bounds, name) for name in NAMES)
    return np.all([(x >= r.min) & (x <= r.max) for x, r in zip(designs, ranges, strict=True)], axis=0)


def below(problem: Problem, bound: float, designs: np.ndarray) -> np.ndarray:
    """Return the admissible ones of some designs with an error below a bound."""
    found, omega = [], np.geomspace(*band(problem), COARSE)

    def first(part: np.ndarray) -> np.ndarray:
        case = cases(problem.device, part)
        return (stability_ratio(case, omega) >= problem.stability.safety_factor).all(axis=1)

    for start in range(0, designs.shape[1], 8 * TOGETHER):
        part = designs[:, start : start + 8 * TOGETHER]
        part = part[:, within_bounds(problem, part)]
        part = part[:, error(problem, cases(problem.device, part), 33) < 1.01 * bound]
        part = part[:, first(part)] if part.size else part
        part = part[:, error(problem, cases(problem.device, part), 2049) < bound] if part.size else part
        found.append(part[:, meet_demands(problem, part)] if part.size else part)
    return np.hstack(found)


def least_damping(problem: Problem, designs: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the least b_c that meets the conditions on a grid of frequencies, for given m_c/b_c; inf where none."""
    tau_c = (designs[3] / designs[2])[:, None]
    with np.errstate(all="ignore"):
        R = required(cases(problem.device, designs), omega)
        needed = problem.stability.safety_factor * R - designs[4][:, None]
        return (np.maximum(needed, 0) * (1 + 1 / (omega * tau_c) ** 2)).max(axis=1)


def best_damping(problem: Problem, designs: np.ndarray) -> np.ndarray:
    """Return the b_c in bounds with the greatest least ratio, by search: that is a quasiconcave function of log b_c."""
    bounds, omega = problem.bounds.damping, np.geomspace(*band(problem), 300)
    found, low, high = np.empty(designs.shape[1]), np.log(bounds.min), np.log(bounds.max)
    for i in range(0, designs.shape[1], TOGETHER):
        case = cases(problem.device, designs[:, i : i + TOGETHER])
        needed = required(case, omega)
        left, right, rows = np.full(len(needed), low), np.full(len(needed), high), np.arange(len(needed))
        for _ in range(8):
            tried = left[:, None] + (right - left)[:, None] * ZOOM
            offered = (coupling_impedance(replace(case, b_c=np.exp(z)), 1j * omega) for z in tried.T)
            with np.errstate(divide="ignore"):
                scores = np.stack([(Z_c.real / needed).min(axis=1) for Z_c in offered], axis=1)
            k = scores.argmax(axis=1)
            found[i : i + TOGETHER] = np.exp(tried[rows, k])
            left, right = tried[rows, np.maximum(k - 1, 0)], tried[rows, np.minimum(k + 1, ZOOM.size - 1)]
    return np.clip(found, bounds.min, bounds.max)
