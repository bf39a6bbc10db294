"""Many designs judged at once in plain complex arithmetic on dense grids (DESIGN 1.1 to 1.9), not from vctune's model.

A problem is only read for its numbers. Designs are arrays of shape (5, n): K_v, K_p, b_c, m_c, b_0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from oracles import Case, sampled_radius, sampled_sensitivity

from vctune.document.problem import Problem

COARSE, DENSE, NODES = 60, 6000, 32
CHUNK = 4000
DECADES = 3


def hold(problem: Problem, s: np.ndarray) -> np.ndarray:
    device, T = problem.device, problem.device.sample_time
    shape = -np.expm1(-s * T) / (s * T) if device.hold == "zoh" else 2 / (2 + s * T)
    return shape * np.exp(-s * device.delay)


def loops(problem: Problem, designs: np.ndarray, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Z_d, shape (frequencies,), and C, shape (n, frequencies)."""
    s = 1j * omega
    return problem.device.mass * s + problem.device.damping, (designs[0][:, None] + designs[1][:, None] / s) * hold(
        problem, s
    )


def sensitivities(problem: Problem, designs: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return |S| of the sampled loop, shape (n, frequencies)."""
    device, (K_v, K_p) = problem.device, designs[:2, :, None]
    return sampled_sensitivity(device.mass, device.damping, device.sample_time, device.delay, K_v, K_p, omega)


def couplings(designs: np.ndarray, omega: np.ndarray) -> np.ndarray:
    s = 1j * omega
    b_c, m_c, b_0 = (row[:, None] for row in designs[2:])
    return b_0 + b_c * m_c * s / (b_c + m_c * s)


def resistances(problem: Problem, designs: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return R, inf where Re G_hh <= 0; |q| - Re q as (Im q)^2/(|q| + Re q) where that does not cancel."""
    if problem.device.operator is not None:
        return held_resistances(problem, designs, omega)
    Z_d, C = loops(problem, designs, omega)
    D = Z_d + C
    q = C / D
    im = (C * np.conj(Z_d)).imag / np.abs(D) ** 2
    with np.errstate(all="ignore"):
        excess = np.where(q.real > 0, im**2 / (np.abs(q) + q.real), np.abs(q) - q.real)
        R = excess * np.abs(D) ** 2 / (2 * D.real)
    return np.where(D.real > 0, R, np.inf)


def held_resistances(problem: Problem, designs: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return R of the two-port h that has absorbed the operator Z_h: (|q| - Re q)/(2 Re h11) - Re(h22 - Z_c)."""
    Z_d, C = loops(problem, designs, omega)
    Z_h = problem.device.operator.mass * 1j * omega + problem.device.operator.damping
    D, W = Z_d + C, Z_d + Z_h
    q = C * D / (C + W) ** 2
    im = (((2 * W - Z_d) * C + W**2) / (C + W) ** 2).imag
    with np.errstate(all="ignore"):
        excess = np.where(q.real > 0, im**2 / (np.abs(q) + q.real), np.abs(q) - q.real)
        R = excess / (2 * (1 / (C + W)).real) - (Z_h * C / (C + W)).real
    return np.where((C + W).real > 0, R, np.inf)


def band(problem: Problem) -> tuple[float, float]:
    """Return the stability band, an endless one cut far beyond everything that happens."""
    low, high = problem.stability.band.min, problem.stability.band.max
    slow = min(problem.transparency.band.min, problem.nyquist) * 10.0**-DECADES
    return low if low > 0 else slow, high if np.isfinite(high) else problem.nyquist * 10.0**DECADES


def least_damping(problem: Problem, designs: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the least b_c that meets the conditions on a grid of frequencies, for given m_c/b_c; inf where none."""
    tau_c = (designs[3] / designs[2])[:, None]
    with np.errstate(all="ignore"):
        needed = problem.stability.safety_factor * resistances(problem, designs, omega) - designs[4][:, None]
        return (np.maximum(needed, 0) * (1 + 1 / (omega * tau_c) ** 2)).max(axis=1)


def errors(problem: Problem, designs: np.ndarray, nodes: int = NODES) -> np.ndarray:
    """Return the error by the midpoint rule of `nodes` equal steps of log frequency, or on so many frequencies."""
    low, high = problem.transparency.band.min, problem.transparency.band.max
    peak = problem.transparency.norm == "peak"
    at = np.arange(nodes) / (nodes - 1) if peak else (np.arange(nodes) + 0.5) / nodes
    omega = low * (high / low) ** at
    Z_d, C = loops(problem, designs, omega)
    D, Z_0, weights = Z_d + C, problem.transparency.reference_impedance, problem.transparency.weights
    squared = (
        (weights.admittance * Z_0 / np.abs(D)) ** 2
        + (weights.tracking * np.abs(Z_d / D)) ** 2
        + (weights.coupling * np.abs(couplings(designs, omega)) / Z_0) ** 2
    )
    return np.sqrt(squared.max(axis=1) if peak else squared.mean(axis=1))


def within_bounds(problem: Problem, designs: np.ndarray) -> np.ndarray:
    ranges = (getattr(problem.bounds, name) for name in ("velocity", "position", "damping", "mass", "drag"))
    return np.all([(x >= r.min) & (x <= r.max) for x, r in zip(designs, ranges, strict=True)], axis=0)


def meet_demands(problem: Problem, designs: np.ndarray, frequencies: int = DENSE) -> np.ndarray:
    """Return which designs meet conditions and sensitivity on a grid of frequencies."""
    low, high = band(problem)
    omega = np.geomspace(low, high, frequencies)
    demand = problem.stability.safety_factor * resistances(problem, designs, omega)
    holds = (couplings(designs, omega).real >= demand).all(axis=1)
    upto = np.geomspace(problem.nyquist * 1e-6, problem.nyquist, frequencies)
    quiet = (sensitivities(problem, designs, upto) <= problem.stability.max_sensitivity).all(axis=1)
    return holds & quiet & meet_limit(problem, designs)


def meet_limit(problem: Problem, designs: np.ndarray) -> np.ndarray:
    """Return which designs meet the conditions in the limit omega = 0, as far as drag and K_p decide (DESIGN 1.6)."""
    device, (K_v, K_p, _, _, b_0) = problem.device, designs
    if problem.stability.band.min > 0:
        return np.ones(designs.shape[1], bool)
    held = device.operator.damping if device.operator else 0.0
    rest = K_v - (device.sample_time / 2 + device.delay) * K_p
    slope = device.damping + held + rest
    enough = 4 * slope * b_0 >= problem.stability.safety_factor * (device.damping**2 - 4 * held * rest)
    return (K_p == 0) | ((slope >= 0) & enough)


def stable(problem: Problem, design: np.ndarray) -> bool:
    """Return whether the sampled loop is stable, and the model's: C/Z_d does not turn around -1; let go and held."""
    device = problem.device
    if device.operator is not None:
        held = replace(
            device,
            mass=device.mass + device.operator.mass,
            damping=device.damping + device.operator.damping,
            operator=None,
        )
        return all(stable(replace(problem, device=each), design) for each in (replace(device, operator=None), held))
    case = Case(device.mass, device.damping, device.sample_time, device.delay, device.hold, *map(float, design))
    return sampled_radius(case) < 1 and abs(turns(problem, design)) < 0.5


def turns(problem: Problem, design: np.ndarray) -> float:
    """Return how often D (times s with an integrator) turns around 0 less than a stable one does."""
    device, (K_v, K_p) = problem.device, design[:2]
    stiffest = 40 * max(K_v / device.mass, np.sqrt(K_p / device.mass), device.damping / device.mass, problem.nyquist)
    omega = np.concatenate(
        (np.geomspace(stiffest * 1e-9, stiffest * 1e-3, 20000), np.linspace(1e-3, 1, 400000) * stiffest)
    )
    Z_d, C = loops(problem, design[:, None], omega)
    D = (Z_d + C[0]) * (1j * omega if K_p > 0 else 1)
    angle = np.unwrap(np.angle(D))
    return (np.pi / 2 * (2 if K_p > 0 else 1) - (angle[-1] - angle[0])) / (2 * np.pi)


def below(problem: Problem, bound: float, designs: np.ndarray) -> np.ndarray:
    """Return the admissible ones of some designs with an error below a bound."""
    found = []
    for start in range(0, designs.shape[1], CHUNK):
        part = designs[:, start : start + CHUNK]
        part = part[:, within_bounds(problem, part)]
        part = part[:, errors(problem, part) < 1.01 * bound]
        part = part[:, meet_demands(problem, part, COARSE)] if part.size else part
        part = part[:, errors(problem, part, 64 * NODES) < bound] if part.size else part
        part = part[:, meet_demands(problem, part)] if part.size else part
        found += [design for design in part.T if stable(problem, design)]
    return np.array(found).reshape(-1, 5).T


def random_designs(
    problem: Problem, count: int, rng: np.random.Generator, near: np.ndarray | None = None
) -> np.ndarray:
    """Return designs, log-uniform in their bounds or around a design; most with about the least b_c they can have."""
    names = ("velocity", "position", "damping", "mass", "drag")
    ranges = [getattr(problem.bounds, name) for name in names]
    designs = np.array([_spread(r.min, r.max, count, rng) for r in ranges])
    if near is not None:
        spread = 10.0 ** rng.uniform(-3, 0, count)
        designs = near[:, None] * np.exp(spread * rng.normal(size=(5, count)))
        zero = rng.random(count) < 0.2
        designs[1, zero] = ranges[1].min
        designs = np.array([np.clip(x, r.min, r.max) for x, r in zip(designs, ranges, strict=True)])
    if not ranges[2].fixed:
        least, omega = rng.random(count) < 0.8, np.geomspace(*band(problem), COARSE)
        for start in range(0, count, CHUNK):
            at = np.flatnonzero(least[start : start + CHUNK]) + start
            tau_c = designs[3, at] / designs[2, at]
            b_c = least_damping(problem, designs[:, at], omega) * np.exp(10.0 ** rng.uniform(-6, 0, len(at)))
            designs[2, at] = np.clip(b_c, ranges[2].min, ranges[2].max)
            if not ranges[3].fixed:
                designs[3, at] = np.clip(tau_c * designs[2, at], ranges[3].min, ranges[3].max)
    return designs


def _spread(low: float, high: float, count: int, rng: np.random.Generator) -> np.ndarray:
    if low == high:
        return np.full(count, low)
    if low > 0:
        return np.clip(low * (high / low) ** rng.random(count), low, high)
    return np.where(rng.random(count) < 0.15, 0.0, high * 10.0 ** rng.uniform(-6, 0, count))


def random_texts(seed: int) -> Iterator[str]:
    """Yield problem files of every kind, one after the other."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    while True:
        mass, T = log(1e-3, 1e2), log(1e-5, 1e-2)
        mass *= log(1e-9, 1e9) if rng.random() < 0.1 else 1.0
        damping = 0.0 if rng.random() < 0.15 else mass / T * log(1e-5, 1e-1)
        delay = T * float(rng.choice([0, 0, 0, 1, 2, 0.5, rng.uniform(0, 4)]))
        lag, Z = T / 2 + delay, mass / (T / 2 + delay) + damping
        f1 = 0.00025 / lag * log(0.3, 10)
        f2 = f1 * log(1.01, 200) if rng.random() < 0.9 else f1 * (1 + log(1e-4, 1e-2))
        f2 = min(f2, 0.4 / T)
        Z_0 = float(mass * 2 * np.pi * np.sqrt(f1 * f2)) * log(0.1, 10)
        weights = [float(rng.choice([0, 1, 1, 1, log(0.1, 10)])) for _ in range(3)]
        weights = weights if any(weights) else [1.0, 1.0, 1.0]
        top = min(0.5, log(0.02, 0.5)) / T
        low = min(f1 * log(0.1, 2), top / 2)
        kind = "lag" if rng.random() < 0.4 else "zoh"
        edges = [repr(low), repr(top)]
        if kind == "lag" and delay == 0 and rng.random() < 0.3:
            edges = ["0.0", edges[1]] if rng.random() < 0.5 else [edges[0], "inf"]
        text = f"[device]\nmass = {mass!r}\ndamping = {damping!r}\nsample_time = {T!r}\n"
        text += f'hold = "{kind}"\ndelay = {delay!r}\n'
        free = rng.random(5) < [0.1, 0.15, 0.1, 0.1, 0.0]
        text += "[gains]\n" if free[:2].any() or rng.random() < 0.3 else ""
        if "[gains]" in text:
            text += (
                f"velocity = {log(1e-3, 0.6) * Z!r}\n"
                if free[0]
                else f"velocity = {{ min = {1e-4 * Z!r}, max = {Z!r} }}\n"
            )
            if free[1]:
                text += f"position = {(log(1e-5, 0.1) * Z / lag if rng.random() < 0.5 else 0.0)!r}\n"
        text += "[coupling]\n"
        if free[2]:
            text += f"damping = {Z * log(0.1, 100)!r}\n"
        if free[3]:
            text += f"mass = {mass * log(0.3, 30)!r}\n"
        if rng.random() < 0.3:
            text += f"drag = {{ min = 0.0, max = {Z_0 * log(1e-3, 1)!r} }}\n"
        elif rng.random() < 0.2:
            text += f"drag = {Z_0 * log(1e-4, 0.1)!r}\n"
        text += f"[transparency]\nband_hz = [{f1!r}, {f2!r}]\nreference_impedance = {Z_0!r}\n"
        text += f'norm = "{rng.choice(["rms", "rms", "peak"])}"\n'
        text += "weights = {{ admittance = {!r}, tracking = {!r}, coupling = {!r} }}\n".format(*weights)
        text += f"[stability]\nband_hz = [{edges[0]}, {edges[1]}]\nsafety_factor = {log(1.0, 1.5)!r}\n"
        text += f"max_sensitivity = {1 + log(0.05, 9)!r}\n"
        yield text
