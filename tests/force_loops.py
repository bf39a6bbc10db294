"""The whole loop of an impedance display, a hand and a virtual environment in exact time.

Not from vctune: the matrix exponential of the mechanism in the hand, and everything that the firmware steps, as one
matrix of one sample. Its eigenvalues say what is stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import floor, pi, sqrt

import numpy as np
from scipy.linalg import expm

Number3 = tuple[float, float, float]


@dataclass(frozen=True)
class ForceLoop:
    """All numbers of a loop, SI units.

    Attributes
    ----------
    handle : mass of a handle on a spring, the spring and its damper; 0 for a rigid device, whose mass is whole
    actuator, order : corner of the actuator, rad/s, and its order; order 0 for an ideal one
    smoothing, filters : a of the low-passes y += a (x - y) of the differenced position, and their number
    """

    sample_time: float
    mass: float
    damping: float
    delay: float
    velocity: float
    coupling: tuple[float, float]
    handle: Number3 = (0.0, 0.0, 0.0)
    actuator: float = 0.0
    order: int = 0
    smoothing: float = 1.0
    filters: int = 0
    hand: Number3 = (0.0, 0.0, 0.0)
    world: Number3 = (0.0, 0.0, 0.0)

    def continuous(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A and b of x' = A x + b u; the first state is the motor's position."""
        (m2, k, c), (M, B, K) = self.handle, self.hand
        if m2 == 0:
            m = self.mass + M
            A, push = np.array([[0.0, 1.0], [-K / m, -(self.damping + B) / m]]), np.array([0.0, 1 / m])
        else:
            m1, m2 = self.mass - m2, m2 + M
            A = np.array(
                [
                    [0.0, 1.0, 0.0, 0.0],
                    [-k / m1, -(self.damping + c) / m1, k / m1, c / m1],
                    [0.0, 0.0, 0.0, 1.0],
                    [k / m2, c / m2, -(k + K) / m2, -(B + c) / m2],
                ]
            )
            push = np.array([0.0, 1 / m1, 0.0, 0.0])
        n, w = len(A), self.actuator
        if self.order == 0:
            return A, push
        if self.order == 1:
            lag, first = np.array([[-w]]), np.array([w])
        else:
            lag, first = np.array([[0.0, 1.0], [-w * w, -sqrt(2) * w]]), np.array([0.0, w * w])
        driven = np.zeros((n, self.order))
        driven[:, 0] = push
        return np.block([[A, driven], [np.zeros((self.order, n)), lag]]), np.append(np.zeros(n), first)

    def sampled(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Return what a sample does: the states' matrix, the older and the newer command's part, whole samples."""
        A, b = self.continuous()
        n, whole = len(A), floor(self.delay / self.sample_time * (1 + 1e-12))
        part = max(self.delay - whole * self.sample_time, 0.0)

        def over(time: float) -> tuple[np.ndarray, np.ndarray]:
            both = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * time)
            return both[:n, :n], both[:n, n]

        (first, older), (rest, newer) = over(part), over(self.sample_time - part)
        return rest @ first, rest @ older, newer, whole

    def with_share(self, share: float) -> ForceLoop:
        """Return the loop with a share of its coupling's admittance."""
        b_c, k_c = self.coupling
        return replace(self, coupling=(b_c / share, k_c / share))

    def stepped(self) -> np.ndarray:
        """Return the matrix of one sample of everything."""
        T, h, a, filters = self.sample_time, 2 / self.sample_time, self.smoothing, self.filters
        (b_c, k_c), (m, d, k) = self.coupling, self.world
        Phi, older, newer, whole = self.sampled()
        n = len(Phi)

        def passed(memory: np.ndarray, x: float) -> np.ndarray:
            for j in range(filters):
                memory[j] = x = memory[j] + a * (x - memory[j])
            return memory

        def one(memory: np.ndarray) -> np.ndarray:
            state, waiting, (before, spring, x_t, p_t), smooth, apart = np.split(
                memory, np.cumsum([n, whole + 1, 4, filters])
            )
            y = (state[0] - before) / T
            smooth = passed(smooth.copy(), y)
            # the tool's velocity solves f_c = f_e, and both are linear in it
            filtered = passed(apart.copy(), y)
            moved = b_c * (filtered[-1] if filters else y) + k_c * (spring + T * y)
            at_once = b_c * a**filters + k_c * T + m * h + d + k * T / 2
            v_t = (moved + m * h * p_t - k * x_t) / at_once
            apart = passed(apart.copy(), y - v_t)
            spring = spring + T * (y - v_t)
            force = b_c * (apart[-1] if filters else y - v_t) + k_c * spring
            command = -(force + self.velocity * (smooth[-1] if filters else y))
            queue = np.append(waiting, command)
            after = Phi @ state + older * queue[0] + newer * queue[1]
            p_t = 2 * v_t - p_t if m > 0 else 0.0
            return np.concatenate((after, queue[1:], [state[0], spring, x_t + T * v_t, p_t], smooth, apart))

        return np.array([one(row) for row in np.eye(n + whole + 5 + 2 * filters)]).T

    def radius(self) -> float:
        """Return the greatest modulus of the loop's eigenvalues."""
        return float(np.abs(np.linalg.eigvals(self.stepped())).max())

    def met(self, theta: np.ndarray, share: float = 1.0) -> np.ndarray:
        """Return the impedance that the environment meets at angles omega T."""
        T, (b_c, k_c) = self.sample_time, self.coupling
        modes, older, newer, whole = parts(replace(self, velocity=0.0, coupling=(0.0, 0.0)))
        z = np.exp(1j * np.asarray(theta))
        push = older * z[:, None] ** -(whole + 1) + newer * z[:, None] ** -whole
        position = (push / (z[:, None] - modes)).sum(axis=1)
        speed = (1 - 1 / z) / T * position
        low_pass = (self.smoothing / (1 - (1 - self.smoothing) / z)) ** self.filters
        offered = (1 - 1 / z) / (b_c * low_pass * (1 - 1 / z) + k_c * T)
        return np.asarray(1 / (share * offered + speed / (1 + self.velocity * low_pass * speed)))


@lru_cache(maxsize=8)
def parts(loop: ForceLoop) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return the eigenvalues of a mechanism, the shares of the older and newer command, and whole samples of delay."""
    Phi, older, newer, whole = loop.sampled()
    modes, shapes = np.linalg.eig(Phi)
    shares = (shapes[0] * np.linalg.solve(shapes, push) for push in (older, newer))
    return modes, *shares, whole


def corner(smoothing: float, sample_time: float) -> float:
    """Return the corner frequency of a low-pass of the firmware, Hz."""
    return float(-np.log(1 - smoothing) / (2 * pi * sample_time))
