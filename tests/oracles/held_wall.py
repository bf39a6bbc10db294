"""An impedance display whose coupling is a wall, in a hand: the matrix of one sample, by matrix exponentials.

Nothing of vctune is imported.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm
from scipy.signal import butter, iirnotch

Floats = np.ndarray
GROWS = 1e-9  # spectral radius beyond 1 at which a motion grows
LEAST = 1e-4  # multiple that counts as any


@dataclass(frozen=True)
class Display:
    """A motor, springs from it to the handle, and a firmware that filters the measured velocity by sections."""

    mass: float
    damping: float
    sample_time: float
    delay: float
    sections: list[list[float]] = field(default_factory=list)
    springs: list[tuple[float, float, float]] = field(default_factory=list)  # mass behind, stiffness, viscosity

    def held(self, hand: tuple[float, float, float]) -> tuple[Floats, Floats]:
        """Return x' = A x + B u of positions and velocities, the hand at the last mass, the force u on the first."""
        masses = np.array([self.mass - sum(m for m, _, _ in self.springs), *(m for m, _, _ in self.springs)])
        masses[-1] += hand[0]
        count = len(masses)
        stiffness, viscosity = np.zeros((count, count)), np.zeros((count, count))
        viscosity[0, 0] += self.damping
        viscosity[-1, -1] += hand[1]
        stiffness[-1, -1] += hand[2]
        for k, (_, spring, damper) in enumerate(self.springs):
            pull = np.array([[1, -1], [-1, 1]])
            stiffness[k : k + 2, k : k + 2] += spring * pull
            viscosity[k : k + 2, k : k + 2] += damper * pull
        rates = np.zeros((2 * count, 2 * count))
        rates[:count, count:] = np.eye(count)
        rates[count:, :count] = -stiffness / masses[:, None]
        rates[count:, count:] = -viscosity / masses[:, None]
        push = np.zeros((2 * count, 1))
        push[count, 0] = 1 / masses[0]
        return rates, push

    def sample(self, hand: tuple[float, float, float], stiffness: float, damping: float) -> Floats:
        """Return the matrix of one sample: states, filters, and the commands that still wait."""
        rates, push = self.held(hand)
        states, T = len(rates), self.sample_time
        whole = int(np.floor(self.delay / T + 1e-9))
        share = max(self.delay / T - whole, 0.0)

        def moved(time: float) -> tuple[Floats, Floats]:
            block = np.block([[rates * time, push * time], [np.zeros((1, states + 1))]])
            both = expm(block)
            return both[:states, :states], both[:states, states:]

        (early, by_older), (late, by_newer) = moved(share * T), moved((1 - share) * T)
        filters, waiting = 2 * len(self.sections), whole + 1
        size = states + filters + waiting
        matrix = np.zeros((size, size))
        passed = np.eye(size)[states // 2]  # the motor's velocity
        for k, row in enumerate(self.sections):
            b0, b1, b2, _, a1, a2 = np.array(row) / row[3]
            first, second = np.eye(size)[states + 2 * k : states + 2 * k + 2]
            out = b0 * passed + first
            matrix[states + 2 * k] = b1 * passed - a1 * out + second
            matrix[states + 2 * k + 1] = b2 * passed - a2 * out
            passed = out
        command = -damping * passed - stiffness * np.eye(size)[0]
        commands = [command, *np.eye(size)[states + filters :]]  # the newest first
        matrix[:states, :states] = late @ early
        matrix[:states] += late @ by_older @ commands[whole + 1][None] + by_newer @ commands[whole][None]
        matrix[states + filters] = command
        for k in range(1, waiting):
            matrix[states + filters + k, states + filters + k - 1] = 1
        return matrix

    def grows(self, hand: tuple[float, float, float], stiffness: float, damping: float, multiples: Floats) -> Floats:
        """Return at which multiples of a wall a motion grows."""
        free = self.sample(hand, 0.0, 0.0)
        wall = self.sample(hand, stiffness, damping) - free
        poles = np.linalg.eigvals(free + np.multiply.outer(multiples, wall))
        return np.asarray(np.abs(poles).max(axis=-1) > 1 + GROWS)


def least_unstable(
    display: Display, hand: tuple[float, float, float], wall: tuple[float, float], first: float, most: float
) -> float:
    """Return the least multiple from `first` on at which a motion grows in a hand; inf if none does up to `most`."""
    # without a wall a free mass has a double pole at z = 1, which rounding moves
    low = np.geomspace(LEAST, most, 60) if first == 0 else first + np.append(0.0, np.geomspace(1e-3, most - first, 60))
    grows = display.grows(hand, *wall, low)
    at = np.flatnonzero(grows)
    if not at.size or at[0] == 0:
        return np.inf if not at.size else first
    stable, unstable = low[at[0] - 1], low[at[0]]
    for _ in range(30):
        middle = (stable + unstable) / 2
        grown = display.grows(hand, *wall, np.array([middle]))[0]
        stable, unstable = (stable, middle) if grown else (middle, unstable)
    return float(unstable)


def climbed(
    display: Display, box: Floats, wall: tuple[float, float], first: float, most: float, rng: np.random.Generator
) -> float:
    """Return the least unstable multiple that random hands of a box and random steps from the worst of them find."""

    def at(share: Floats) -> tuple[float, float, float]:
        mass, damping, stiffness = box[:, 0] + (box[:, 1] - box[:, 0]) * share**2
        return float(mass), float(damping), float(stiffness)

    corners = [np.array(corner, float) for corner in np.ndindex(2, 2, 2)]
    shares = [*corners, *(rng.random(3) * rng.integers(0, 2, 3) for _ in range(20)), *rng.random((20, 3))]
    values = [least_unstable(display, at(share), wall, first, most) for share in shares]
    best = np.inf
    for k in np.argsort(values)[:2]:
        share, value, step = shares[k], values[k], 0.2
        for _ in range(25):
            tried = np.clip(share + step * rng.standard_normal(3), 0, 1)
            found = least_unstable(display, at(tried), wall, first, most)
            share, value, step = (tried, found, step) if found < value else (share, value, 0.85 * step)
        best = min(best, value)
    return best


def random_case(seed: int) -> tuple[Display, dict, Floats, tuple[float, float]]:
    """Return a display with a notch, with springs or with low-passes, its problem file, its hands and a wall."""
    rng = np.random.default_rng(seed)

    def spread(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    T, mass = spread(2e-4, 5e-3), spread(0.01, 2)
    damping = 0.0 if rng.random() < 0.15 else spread(0.01, 20) * mass
    delay = float(rng.choice([0, 0.5 * T, T, rng.uniform(0, 3) * T]))
    rows, springs, modes = list[list[float]](), list[tuple[float, float, float]](), list[dict[str, float]]()
    kind = ("notch", "springs", "low-passes")[seed % 3]
    if kind == "notch":
        b, a = iirnotch(rng.uniform(0.02, 0.95), spread(0.5, 40))
        rows.append([*(b * a.sum() / b.sum()), *a])
    elif kind == "springs":
        count = int(rng.integers(1, 3))
        behind = [mass * rng.uniform(0.05, 0.6) / count for _ in range(count)]
        ahead = mass - sum(behind)
        for k, own in enumerate(behind):
            hz = min(spread(5, 300), 0.5 / T)
            ratio = 0.0 if rng.random() < 0.1 else spread(1e-3, 0.2)
            reduced = ahead * sum(behind[k:]) / mass
            swing = 2 * np.pi * hz
            springs.append((own, reduced * swing**2, reduced * 2 * ratio * swing))
            modes.append({"handle_mass": own, "frequency_hz": hz, "damping_ratio": ratio})
            ahead += own
    if kind == "low-passes" or rng.random() < 0.2:
        b, a = (np.pad(part, (0, 3 - len(part))) for part in butter(int(rng.integers(1, 3)), rng.uniform(0.03, 0.8)))
        rows.append([*(b * a.sum() / b.sum()), *a])
    rows = [[float(number) for number in row] for row in rows]
    box = []
    for size in (2 * mass, 5 * max(damping, mass), mass * spread(1, 1e4)):
        high = spread(0.1, 1) * size
        low = high if rng.random() < 0.15 else 0.0 if rng.random() < 0.6 else high * rng.random()
        box.append((low, high))
    b_c = 0.0 if rng.random() < 0.07 else spread(0.02, 1) * mass / (T + delay)
    k_c = spread(0.005, 1) * max(b_c, 0.1 * mass / T) / (T + delay)
    velocity = {"from": "measured", **({"sections": rows} if rows else {})}
    document = {
        "device": {
            "display": "impedance", "mass": mass, "damping": damping, "sample_time": T, "delay": delay,
            "velocity": velocity, **({"structure": modes if len(modes) > 1 else modes[0]} if modes else {}),
        },
        "operator": {
            name: {"min": low, "max": high}
            for name, (low, high) in zip(("mass", "damping", "stiffness"), box, strict=True)
        },
        "environment": {"stiffness": np.inf},
        "stability": {"criterion": "hands", "safety_factor": 1.0},
        "coupling": {"stiffness": k_c, "damping": b_c},
    }  # fmt: skip
    return Display(mass, damping, T, delay, rows, springs), document, np.array(box), (k_c, b_c)
