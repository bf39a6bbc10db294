"""Random mechanisms that a command moves, and what an encoder reads of them: small steps of their own, friction exact.

Shares nothing with `vctune.identification`: drift, kick and drift over a fortieth of a row; a motor at rest stays until
the other forces overcome its Coulomb friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, floor, log, pi, sin
from pathlib import Path

import numpy as np

STEPS = 40  # In a row
KINDS = ("chirp", "multisine", "binary", "hand", "random")


@dataclass(frozen=True)
class Pushed:
    """A mechanism: kg, N s/m, s, N, N/m and Hz, or their rotary counterparts."""

    kind: str  # of its command
    T: float
    rotary: bool
    mass: float
    damping: float
    delay: float
    lag: float  # of a first-order actuator
    friction: float
    pull: float  # constant
    stiffness: float  # of a return spring
    gravity: float  # torque when horizontal
    handle: float  # share of the mass behind a spring; 0 for one mass
    hertz: float  # resonance, and its damping ratio
    ratio: float
    push: float  # greatest command
    counts: float  # span of the motion in steps of the encoder


def drawn(seed: int) -> Pushed:
    """Return a random mechanism, of one kind of command after the other."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return exp(random.uniform(log(low), log(high)))

    def often(share: float, value: float) -> float:
        return value if random.uniform() < share else 0.0

    T, rotary = float(random.choice([5e-4, 1e-3, 2e-3])), bool(random.uniform() < 0.5)
    mass = between(0.05, 2.0) * (1e-3 if rotary else 1.0)
    push = mass * between(10.0, 100.0)
    held = KINDS[seed % len(KINDS)] == "hand"  # whose sensor only an admittance display has, which has no spring
    stiffness = often(0.0 if held else 0.25, mass * between(5.0, 400.0))
    return Pushed(
        kind=KINDS[seed % len(KINDS)], T=T, rotary=rotary, mass=mass, damping=mass * between(0.5, 20.0),
        delay=often(0.8, random.uniform(0.0, 5e-3)), lag=often(0.4, random.uniform(2e-4, 5e-3)),
        friction=often(0.7, push * random.uniform(0.0, 0.25)), pull=often(0.3, push * random.uniform(-0.03, 0.03)),
        stiffness=stiffness, gravity=often(0.0 if held or stiffness or not rotary else 0.3, mass * between(5.0, 100.0)),
        handle=often(0.25, random.uniform(0.1, 0.5)), hertz=between(20.0, min(100.0, 0.12 / T)),
        ratio=random.uniform(0.01, 0.08), push=push, counts=between(1e3, 1e5),
    )  # fmt: skip


def command(device: Pushed, random: np.random.Generator, rows: int) -> np.ndarray:
    """Return a command for each row."""
    T, row = device.T, np.arange(rows)
    if device.kind == "chirp":
        period = rows // 5 if random.uniform() < 0.5 else rows
        low, high, whole, time = 0.5, min(40.0, 0.1 / T), period * T, (row % period) * T
        wave = np.sin(2 * pi * low * whole / log(high / low) * ((high / low) ** (time / whole) - 1))
    elif device.kind == "multisine":
        period = 2048 if random.uniform() < 0.6 else rows
        lines = np.unique(np.round(np.geomspace(max(2, 0.7 * period * T), min(0.1, 60 * T) * period, 40)))
        phases = random.uniform(0, 2 * pi, lines.size)
        wave = np.cos(2 * pi * np.outer(row / period, lines) + phases).sum(axis=1)
    elif device.kind == "binary":
        bit = int(random.choice([1, 3, 10, 30]))
        wave = np.repeat(random.choice([-1.0, 1.0], rows // bit + 1), bit)[:rows]
    else:
        f = np.fft.rfftfreq(rows, T)
        wave = np.fft.irfft(np.fft.rfft(random.normal(size=rows)) * (f > 0.3) / (1 + (f / 4.0) ** 2), rows)
    return device.push * wave / np.abs(wave).max()


def place_of(t: float) -> tuple[float, float]:
    """Return where a hand is, and its speed."""
    a, b = 4.4, 0.69
    return 0.2 * sin(a * t) * sin(b * t), 0.2 * (a * cos(a * t) * sin(b * t) + b * sin(a * t) * cos(b * t))


def recorded(device: Pushed, seed: int, seconds: float = 10.0) -> dict[str, np.ndarray]:  # noqa: PLR0915 one loop
    """Return the columns of a log by header."""
    random, T, rows = np.random.default_rng(seed + 10_000), device.T, int(seconds / device.T)
    told, h = command(device, random, rows).tolist(), T / STEPS
    held = device.kind == "hand"
    k_h, b_h = 60.0 * device.mass, 8.0 * device.mass
    m_1, m_2 = device.mass * (1 - device.handle), device.mass * device.handle
    w = 2 * pi * device.hertz
    k, c = m_1 * m_2 / device.mass * w * w, 2 * device.ratio * m_1 * m_2 / device.mass * w
    x, v, y, u, force = 0.0, 0.0, 0.0, 0.0, told[0]
    decay = exp(-h / device.lag) if device.lag else 0.0
    position, hand = np.empty(rows), np.zeros(rows)
    for i in range(rows):
        position[i] = x
        if held:
            end, speed = (y, u) if m_2 else (x, v)
            there, towards = place_of(i * T)
            hand[i] = k_h * (there - end) + b_h * (towards - speed)
        for j in range(STEPS):
            at = i * T + j * h - device.delay  # the command may change within this step
            first, last = floor(at / T + 1e-9), floor((at + h) / T - 1e-9)
            share = 1.0 if first == last else (last * T - at) / h
            now = share * told[max(first, 0)] + (1 - share) * told[max(last, 0)]
            before, force = force, now + (force - now) * decay
            motor = (before + force) / 2 if device.lag else now
            half_x, half_y = x + v * h / 2, y + u * h / 2
            push = 0.0
            if held:
                end, speed = (half_y, u) if m_2 else (half_x, v)
                there, towards = place_of(i * T + (j + 0.5) * h)
                push = k_h * (there - end) + b_h * (towards - speed)
            spring = k * (half_y - half_x) if m_2 else push
            net = motor - device.stiffness * half_x - device.gravity * sin(half_x) - device.pull + spring
            free = net + (c * u if m_2 else 0.0)
            sign = 0.0 if v == 0.0 and abs(free) <= device.friction else (1.0 if (v or free) > 0 else -1.0)
            new = 0.0
            if sign and m_2:
                a, d = m_1 / h + (device.damping + c) / 2, m_2 / h + c / 2
                right = (2 * m_1 / h - a) * v + c / 2 * u + net - device.friction * sign
                other = (2 * m_2 / h - d) * u + c / 2 * v - spring + push
                new = (right * d + c / 2 * other) / (a * d - c * c / 4)
            elif sign:
                a = m_1 / h + device.damping / 2
                new = ((2 * m_1 / h - a) * v + net - device.friction * sign) / a
            if new * sign < 0 and abs(free) <= device.friction:
                new = 0.0
            if m_2:
                d = m_2 / h + c / 2
                u = ((2 * m_2 / h - d) * u + c / 2 * (v + new) - spring + push) / d
                y = half_y + u * h / 2
            x, v = half_x + new * h / 2, new
    step = float(np.ptp(position)) / device.counts
    units = ("rad", "Nm") if device.rotary else ("m", "N")
    columns = {"time_s": np.arange(rows) * T, f"position_{units[0]}": step * np.floor(position / step + 0.5)}
    columns[f"command_{units[1]}"] = np.array(told)
    if held:
        columns[f"hand_{units[1]}"] = hand + 1e-3 * hand.std() * random.normal(size=rows)
    return columns


def written(device: Pushed, seed: int, folder: Path) -> tuple[Path, Path]:
    """Write the log of a mechanism and the file that says what it is; return their paths."""
    columns = recorded(device, seed)
    log, config = folder / f"log-{seed}.csv", folder / f"log-{seed}.toml"
    np.savetxt(log, np.column_stack(list(columns.values())), "%.12g", ",", header=",".join(columns), comments="")
    display = "impedance" if device.stiffness or device.gravity else "admittance"
    config.write_text(f'rotary = {str(device.rotary).lower()}\n[device]\ndisplay = "{display}"\n')
    return log, config
