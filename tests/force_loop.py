"""An impedance display in a hand and before an environment, stepped in time: shares nothing with the package.

The handle's motion is that of a chain of masses, exact between samples by the matrix exponential; the firmware and the
environment are difference equations. The state matrix is what one step makes of unit vectors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm


@dataclass
class Mechanics:
    """Motor, a handle on a spring if there is one, a hand and resonators on the handle; an actuator's lag.

    Attributes
    ----------
    mass, damping : of the motor
    handle : mass, spring, loss between motor and handle; None for a rigid device
    hand : mass, damping, stiffness at the handle
    resonators : mass, damping, stiffness of what hangs on the handle by a spring
    actuator_hz : None for none
    """

    mass: float
    damping: float
    handle: tuple[float, float, float] | None = None
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)
    resonators: list[tuple[float, float, float]] = field(default_factory=list)
    actuator_hz: float | None = None

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B of position and velocity of each mass, the motor's first, and of the actuator's force."""
        M, B, K = self.hand
        masses, springs = [self.mass], [(None, 0, 0.0, self.damping)]
        at = 0
        if self.handle is not None:
            mass, k, c = self.handle
            masses.append(mass)
            springs.append((0, 1, k, c))
            at = 1
        masses[at] += M
        springs.append((None, at, K, B))
        for mass, c, k in self.resonators:
            masses.append(mass)
            springs.append((at, len(masses) - 1, k, c))
        n = len(masses)
        stiffness, loss = np.zeros((n, n)), np.zeros((n, n))
        for i, j, k, c in springs:
            for matrix, value in ((stiffness, k), (loss, c)):
                matrix[j, j] += value
                if i is not None:
                    matrix[i, i] += value
                    matrix[i, j] -= value
                    matrix[j, i] -= value
        inverse = np.diag(1 / np.array(masses))
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ loss]])
        b = np.zeros(2 * n)
        b[n] = 1 / masses[0]
        if self.actuator_hz is None:
            return A, b[:, None]
        w = 2 * np.pi * self.actuator_hz
        A = np.block([[A, b[:, None]], [np.zeros((1, 2 * n)), -w * np.ones((1, 1))]])
        return A, np.append(np.zeros(2 * n), w)[:, None]


@dataclass
class Element:
    """A spring, mass or damper of the environment by the trapezoidal rule: f = g v + what it remembers."""

    kind: str
    value: float

    def gain(self, T: float) -> float:
        return {"spring": self.value * T / 2, "mass": 2 * self.value / T, "damper": self.value}[self.kind]


def step_matrix(
    mechanics: Mechanics,
    T: float,
    delay: float,
    velocity: float,
    damping: float,
    stiffness: float,
    elements: list[Element],
    *,
    wall: bool = False,
    low_pass: float | None = None,
) -> np.ndarray:
    """Return the matrix of one sample of the closed loop.

    Parameters
    ----------
    velocity, damping, stiffness : K_v, b_c and k_c
    elements : of the environment, on one velocity, whose forces add up; a wall has none
    low_pass : a of the firmware's low-pass y += a (x - y); None without
    """
    A, B = mechanics.matrices()
    n = len(A)
    whole = int(np.floor(delay / T + 1e-9))
    part = delay - whole * T

    def held(t: float) -> tuple[np.ndarray, np.ndarray]:
        both = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * t)
        return both[:n, :n], both[:n, n]

    (A_old, B_old), (A_new, B_new) = held(part), held(T - part)
    a, count = 1.0 if low_pass is None else low_pass, len(elements)
    gains = np.array([element.gain(T) for element in elements])
    spring_at = n + (whole + 1) + 3 + count  # mechanics, old forces, old position and two filters, environment

    def advance(state: np.ndarray) -> np.ndarray:
        mechanical, forces = state[:n], state[n : n + whole + 1]
        before, injected, smoothed = state[n + whole + 1 : n + whole + 4]
        remembered, spring = state[n + whole + 4 : spring_at], state[spring_at]
        y = (mechanical[0] - before) / T
        injected = (1 - a) * injected + a * y
        p, q = damping * (1 - a) * smoothed + spring, damping * a + stiffness * T
        if wall:
            v = 0.0
        elif count:
            v = (p + q * y - remembered.sum()) / (q + gains.sum())
        else:
            v = y + p / q  # nothing rendered: no force
        force = p + q * (y - v)
        smoothed = (1 - a) * smoothed + a * (y - v)
        spring = spring + stiffness * T * (y - v)
        now = remembered + gains * v
        new = np.zeros(count)
        for i, element in enumerate(elements):
            if element.kind == "spring":
                new[i] = now[i] + gains[i] * v
            elif element.kind == "mass":
                new[i] = -gains[i] * v - now[i]
        command = -(force + velocity * injected)
        line = np.append(forces[1:], command)
        moved = A_old @ mechanical + B_old * forces[0]
        newest = command if whole == 0 else forces[1]
        moved = A_new @ moved + B_new * newest
        return np.concatenate((moved, line, [mechanical[0], injected, smoothed], new, [spring]))

    return np.column_stack([advance(unit) for unit in np.eye(spring_at + 1)])


def spectral_radius(matrix: np.ndarray) -> float:
    """Return the greatest modulus of an eigenvalue."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())
