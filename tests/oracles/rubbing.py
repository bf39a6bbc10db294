"""A wall in a hand whose reading is rounded and whose handle rubs, stepped in fractions of a sample."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, inf, sqrt

import numpy as np
from scipy.linalg import expm

Floats = np.ndarray


@dataclass(frozen=True)
class Rubbing:
    """A mass under u = -(k r + b_c w), r the position in steps of q and w its filtered difference. SI units."""

    m: float
    b: float
    T: float
    k: float
    b_c: float
    q: float
    f: float = 0.0
    delay: float = 0.0
    hz: float | None = None  # of the firmware's low-passes
    low_passes: int = 1
    actuator_hz: float | None = None
    order: int = 1
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)  # mass, damping, stiffness

    @property
    def weight(self) -> float:
        """The weight of a new sample in the low-pass; 1 without one."""
        return 1.0 if self.hz is None else 1 - float(np.exp(-2 * np.pi * self.hz * self.T))

    @property
    def whole(self) -> int:
        """Whole samples of the delay."""
        return floor(self.delay / self.T + 1e-9)

    @property
    def early(self) -> float:
        """Time after a sample until the command that is `whole` samples old acts, s."""
        left = self.delay - self.whole * self.T
        return left if left > 1e-9 * self.T else 0.0

    def over(self, time: float) -> Floats:
        """Return the matrix over a time of position, velocity, actuator, command and external force."""
        M, B, K = self.hand
        states = 2 if self.actuator_hz is None else 2 + self.order
        A = np.zeros((states + 2, states + 2))
        A[0, 1], A[1, 0], A[1, 1], A[1, -1] = 1.0, -K, -self.b - B, 1.0
        if self.actuator_hz is None:
            A[1, -2] = 1.0
        else:
            w = 2 * np.pi * self.actuator_hz
            A[1, 2] = 1.0
            A[2, 2:] = [-w, w, 0.0] if self.order == 1 else [0.0, w, 0.0, 0.0]
            if self.order == 2:
                A[3, 2:] = [-w, -sqrt(2) * w, w, 0.0]
        A[1] /= self.m + M
        return expm(A * time)

    def loop(self) -> tuple[Floats, Floats, Floats, float]:
        """Return A, b, c and d from an error of the reading to the force; the position is the first state."""
        arrivals, N = [self.over(t) for t in (self.early, self.T - self.early)], self.whole
        n, past, a = len(arrivals[0]) - 2, N + 1, self.weight
        filters = 0 if self.hz is None else self.low_passes

        def step(z: Floats, error: float) -> tuple[Floats, float]:
            body, forces, before, means = z[:n], [*z[n : n + past]], z[n + past], [*z[n + past + 1 :]]
            read = body[0] + error
            speed = (read - before) / self.T
            for i in range(filters):
                means[i] = speed = means[i] + a * (speed - means[i])
            u = -(self.k * read + self.b_c * speed)
            forces = [u, *forces]
            for over, force in zip(arrivals, (forces[N + 1], forces[N]), strict=True):
                body = (over @ np.array([*body, force, 0.0]))[:n]
            return np.array([*body, *forces[:past], read, *means]), u

        size = n + past + 1 + filters
        each = [step(unit, 0.0) for unit in np.eye(size)]
        after, force = step(np.zeros(size), 1.0)
        return np.array([z for z, _ in each]).T, after, np.array([u for _, u in each]), force

    def radius(self) -> float:
        """The greatest modulus of a pole of the loop without friction and rounding."""
        return float(np.abs(np.linalg.eigvals(self.loop()[0])).max())

    def bounds(self, most: int = 1_000_000) -> tuple[float, float]:
        """Return q/2 times the sums of |impulse response| to position and force, by stepping."""
        A, b, c, d = self.loop()
        radius = np.abs(np.linalg.eigvals(A)).max()
        if radius >= 1:
            return inf, inf
        moved, pushed, z = 0.0, abs(d), b
        for _ in range(min(most, int(30 / -np.log(radius)) + 50)):
            moved, pushed, z = moved + abs(z[0]), pushed + abs(c @ z), A @ z
        return moved * self.q / 2, pushed * self.q / 2


@dataclass(frozen=True)
class Seen:
    """What several handles do in the last part of a run: half of what they move and are pushed, and their speed."""

    moved: Floats
    pushed: Floats
    speed: Floats
    trace: Floats  # positions at the samples, shape (samples, handles)


def run(
    walls: list[Rubbing], at: Floats, speed: Floats, held: Floats, seconds: float, last: float, parts: int = 20
) -> Seen:
    """Step walls of one sample time together. The friction of each part of a sample is the one that stops the handle,
    or the greatest one."""
    T, most = walls[0].T, max(len(wall.over(0.0)) for wall in walls) - 2
    over, rub, of_force = (np.zeros((2, len(walls), *shape)) for shape in ((most, most), (most,), (most,)))
    for i, wall in enumerate(walls):
        for part, time in enumerate((wall.early, T - wall.early)):
            matrix = wall.over(time / parts)
            n = len(matrix) - 2
            over[part, i, :n, :n], of_force[part, i, :n], rub[part, i, :n] = (
                matrix[:n, :n],
                matrix[:n, n],
                matrix[:n, -1],
            )
    k, b_c, q, f, a = (np.array([getattr(wall, of) for wall in walls]) for of in ("k", "b_c", "q", "f", "weight"))
    again = np.array([wall.weight if wall.hz is not None and wall.low_passes > 1 else 1.0 for wall in walls])
    whole, every = np.array([wall.whole for wall in walls]), np.arange(len(walls))
    body, forces = np.zeros((len(walls), most)), np.zeros((whole.max() + 2, len(walls)))
    body[:, 0], body[:, 1] = at, speed
    before, first, second = q * np.floor(at / q + 0.5), 0.0 * a, 0.0 * a
    low, high = np.full((2, len(walls)), inf), np.full((2, len(walls)), -inf)
    fastest = np.zeros(len(walls))
    samples, trace = round(seconds / T), list[Floats]()
    for sample in range(samples):
        read = q * np.floor(body[:, 0] / q + 0.5)
        first = first + a * ((read - before) / T - first)
        second = second + again * (first - second)
        before, forces = read, np.roll(forces, 1, axis=0)
        forces[0] = -(k * read + b_c * second)
        watched = sample >= samples - round(last / T)
        if watched:
            trace.append(body[:, 0].copy())
        for part, command in enumerate((forces[whole + 1, every], forces[whole, every])):
            for _ in range(parts):
                free = np.einsum("nij,nj->ni", over[part], body) + of_force[part] * command[:, None]
                free += rub[part] * held[:, None]
                stops = np.divide(-free[:, 1], rub[part, :, 1], out=0 * f, where=rub[part, :, 1] > 0)
                body = free + rub[part] * np.clip(stops, -f, f)[:, None]
                if watched:
                    fastest = np.maximum(fastest, np.abs(body[:, 1]))
                    low[0], high[0] = np.minimum(low[0], body[:, 0]), np.maximum(high[0], body[:, 0])
        if watched:
            low[1], high[1] = np.minimum(low[1], forces[0]), np.maximum(high[1], forces[0])
    return Seen((high[0] - low[0]) / 2, (high[1] - low[1]) / 2, fastest, np.array(trace))
