"""Random problem files, designs in their bounds, and devices in their boxes of uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from dense import COARSE, NAMES, band, least_damping

from vctune.bench.evaluator import Scene, cases
from vctune.model.problem import Problem

CHUNK = 4000
"""Designs made at a time."""


def random_devices(problem: Problem, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return devices of the problem's box, half of them on its faces: mass, damping, delay in rows."""
    nominal, widths = _numbers(problem)
    share = rng.uniform(-1, 1, (3, count))
    snapped = rng.random((3, count)) < 0.5
    share[:, ::2] = np.where(snapped[:, ::2], np.sign(share[:, ::2]), share[:, ::2])
    return nominal[:, None] * (1 + widths[:, None] * share)


def corners(problem: Problem) -> np.ndarray:
    """Return the devices at the corners of the problem's box."""
    nominal, widths = _numbers(problem)
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1)
    return nominal[:, None] * (1 + widths[:, None] * signs)


def _numbers(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    names = ("mass", "damping", "delay")
    widths = dict(problem.uncertainty.half_widths)
    return np.array([problem.device.number(n) for n in names]), np.array([widths.get(n, 0.0) for n in names])


def on_devices(problem: Problem, design: np.ndarray, devices: np.ndarray) -> Scene:
    """Return the cases of one design on many devices."""
    mass, damping, delay = devices
    return replace(cases(problem.device, design), mass=mass, damping=damping, delay=delay)


def random_designs(
    problem: Problem, count: int, rng: np.random.Generator, near: np.ndarray | None = None
) -> np.ndarray:
    """Return designs, log-uniform in their bounds or around a design; most with about the least b_c they can have."""
    ranges = [getattr(problem.bounds, name) for name in NAMES]
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
        text += f"[stability]\ncriterion = 'passive'\nband_hz = [{edges[0]}, {edges[1]}]\n"
        text += f"safety_factor = {log(1.0, 1.5)!r}\n"
        text += f"max_sensitivity = {1 + log(0.05, 9)!r}\n"
        yield text
