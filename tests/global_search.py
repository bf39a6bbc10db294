"""The least greatest error, searched for globally in plain complex numbers on dense grids by `vctune.bench.evaluator`.

Differential evolution over K_v, tau_c = m_c/b_c and K_p/(b + K_v), by Deb's rules: whoever violates less, then whoever
errs less. For given tau_c the least admissible b_c is a maximum over frequency. A problem is only read for its numbers.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
from dense import spectral_radius, squared_error

from vctune.bench.evaluator import cases, impedances, required, sensitivity

SIZE, COARSE_ROUNDS, FINE_ROUNDS = 36, 110, 40


class Judge:
    """Violation, greatest error and least b_c of many designs at once."""

    def __init__(self, problem, density):
        self.problem = problem
        stability, transparency, device = problem.stability.band, problem.transparency.band, problem.device
        slow = max(min(device.damping / device.mass * device.sample_time / 10, 1e-3), 1e-7)
        self.stable = _grid(stability.min, stability.max, int(180 * density))
        self.clear = _grid(transparency.min, transparency.max, int(120 * density))
        self.below = _grid(slow, pi, int(220 * density)) / device.sample_time

    def conditions(self, case, tau):
        """Return the least b_c, and how negative Re G_hh gets."""
        bounds, factor = self.problem.bounds, self.problem.stability.safety_factor
        D, R = sum(impedances(case, 1j * self.stable)), required(case, self.stable)
        R = np.where(D.real > 0, R, 0)
        needed = (factor * R * (1 + 1 / (self.stable * tau[:, None]) ** 2)).max(axis=1)
        deficit = np.maximum(-D.real, 0).max(axis=1) / (case.damping + case.K_v)
        return np.maximum(needed, np.maximum(bounds.damping.min, bounds.mass.min / tau)), deficit

    def __call__(self, K_v, K_p, tau):
        bounds, ones = self.problem.bounds, np.ones(K_v.size)
        case = cases(self.problem.device, (K_v, K_p, ones, ones, 0 * ones))
        b_c, violation = self.conditions(case, tau)
        most = np.minimum(bounds.damping.max, bounds.mass.max / tau)
        S = np.where(spectral_radius(case) < 1, sensitivity(case, self.below).max(axis=1), inf)
        violation += np.maximum(np.log(S / self.problem.stability.max_sensitivity), 0)
        violation += np.where(b_c > most * (1 + 1e-9), np.log(b_c / most), 0)
        violation = np.where(np.isfinite(violation), violation, 1e3 + np.log1p(K_v + K_p))
        square = squared_error(self.problem, replace(case, b_c=b_c, m_c=b_c * tau), self.clear)
        return violation, np.sqrt(square.max(axis=1)), b_c


def _grid(low, high, count):
    both = np.geomspace(low, high, 2 * count // 3), np.linspace(low + 0.05 * (high - low), high, count // 3)
    return np.unique(np.concatenate(both))


def _designs(problem, x):
    K_v, tau = np.exp(x[:, 0]), np.exp(x[:, 1])
    if x.shape[1] == 2:
        return K_v, np.zeros(len(x)), tau
    position = problem.bounds.position
    return K_v, np.clip(np.exp(x[:, 2]) * (problem.device.damping + K_v), position.min, position.max), tau


def _box(problem, integral):
    bounds, stable = problem.bounds, problem.stability.band
    slowest = max(bounds.mass.min / bounds.damping.max, 1e-6 / stable.max)
    fastest = min(bounds.mass.max / bounds.damping.min, 1e6 / stable.min)
    ranges = [(bounds.velocity.min, bounds.velocity.max), (slowest, fastest)]
    if integral:
        ranges.append((1e-3 * problem.transparency.band.min, 3 / problem.device.loop_lag))
    return np.log(np.array(ranges)).T


def _evolved(problem, coarse, fine, integral, rng):
    low, high = _box(problem, integral)
    x = low + (high - low) * rng.random((3 * SIZE, low.size))
    violation, error, _ = coarse(*_designs(problem, x))
    first = np.lexsort((error, violation))[:SIZE]
    x, violation, error = x[first], violation[first], error[first]
    for number in range(COARSE_ROUNDS + FINE_ROUNDS):
        judge = coarse if number < COARSE_ROUNDS else fine
        if number == COARSE_ROUNDS:
            violation, error, _ = fine(*_designs(problem, x))
        base, plus, minus = (x[rng.permutation(SIZE)] for _ in range(3))
        best = x[np.lexsort((error, violation))[0]]
        base = np.where(rng.random((SIZE, 1)) < 0.3, best, base)
        moved = base + rng.uniform(0.4, 1.0, (SIZE, 1)) * (plus - minus)
        y = np.clip(np.where(rng.random(x.shape) < 0.9, moved, x), low, high)
        violation_y, error_y, _ = judge(*_designs(problem, y))
        better = (violation_y < violation) | ((violation_y == violation) & (error_y < error))
        x[better], violation[better], error[better] = y[better], violation_y[better], error_y[better]
    at = np.lexsort((error, violation))[0]
    return violation[at], error[at], x[at : at + 1]


@np.errstate(all="ignore")
def global_search(problem, seed, runs):
    """Return the least error found and its K_v, K_p, b_c, m_c; inf if nothing admissible was found."""
    rng, coarse, fine = np.random.default_rng(seed), Judge(problem, 1.0), Judge(problem, 4.0)
    found = (_evolved(problem, coarse, fine, integral, rng) for integral in (False, True) for _ in range(runs))
    violation, error, x = min(found, key=lambda each: each[:2])
    if violation > 0:
        return inf, None
    K_v, K_p, tau = _designs(problem, x)
    b_c = fine(K_v, K_p, tau)[2]
    return float(error), tuple(float(values[0]) for values in (K_v, K_p, b_c, b_c * tau))


def random_text(seed):
    """Return a problem of norm "peak"; its stability band often ends below the transparency band."""
    rng = np.random.default_rng([7, seed])

    def power(low, high):
        return float(10 ** rng.uniform(low, high))

    m, T = power(-3.5, 1.5), power(-4.5, -2.5)
    Z = m / T
    nyquist = 0.5 / T
    upper = nyquist * power(-1.5, -0.05)
    lower = upper * power(-3, -0.5)
    begin = lower * power(-0.5, 0.5)
    end = begin * (nyquist * 0.99 / begin) ** rng.uniform(0.3, 1.0)
    Z_0, fastest = Z * power(-2, 1), Z * power(-0.5, 1)
    delay = 0.0 if rng.random() < 0.6 else rng.uniform(0, 3) * T
    return f"""[device]
mass = {m!r}
damping = {Z * power(-3, 0.5)!r}
sample_time = {T!r}
delay = {float(delay)!r}
hold = "{"zoh" if rng.random() < 0.8 else "lag"}"
[gains]
velocity = {{ min = {fastest * 1e-5!r}, max = {fastest!r} }}
position = {{ min = 0.0, max = {fastest / T * power(-2, 0)!r} }}
[coupling]
damping = {{ min = {Z_0 * power(-4, -1)!r}, max = {Z_0 * power(0.5, 4)!r} }}
mass = {{ min = {Z_0 * T * power(-5, -2)!r}, max = {Z_0 * T * power(2, 7)!r} }}
[transparency]
band_hz = [{lower!r}, {upper!r}]
reference_impedance = {Z_0!r}
norm = "peak"
weights = {{ admittance = {power(-0.5, 0.5)!r}, tracking = {power(-0.5, 0.5)!r}, coupling = {power(-0.5, 0.5)!r} }}
[stability]
criterion = 'passive'
band_hz = [{begin!r}, {end!r}]
safety_factor = {rng.choice([1.0, 1.05, 1.5])!s}
max_sensitivity = {float(rng.uniform(1.3, 4.0))!r}
"""
