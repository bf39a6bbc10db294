"""A servo in a hand before a rendered environment, sampled by matrix exponentials of SciPy; nothing of vctune is used.

Servo and sensor are linear, so that the sensor's delay is counted before them: what is sensed is what a command gives
that is later by both delays. Coupling and environment are the bilinear transform of 1/(Z_c + Z_e) in s.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import floor, pi, sqrt

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.signal import cont2discrete, tf2ss


@dataclass(frozen=True)
class Servo:
    """Times in s, frequencies in Hz; a sensor without a bandwidth has no low-pass."""

    sample_time: float
    delay: float
    bandwidth_hz: float
    order: int
    position: bool
    sensor_hz: float | None
    sensor_order: int
    sensor_delay: float


@dataclass(frozen=True)
class Mass:
    """m s + b + k/s: a hand, or an environment by the trapezoidal rule."""

    mass: float
    damping: float
    stiffness: float


def low_pass(hz: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B of a low-pass whose output is its first state."""
    w = 2 * pi * hz
    if order == 1:
        return np.array([[-w]]), np.array([w])
    return np.array([[0.0, 1.0], [-w * w, -sqrt(2) * w]]), np.array([0.0, w * w])


def mechanics(servo: Servo, hand: Mass) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return A, B, C, D from the held velocity to the sensed force: x, servo, and sensor behind it."""
    A_s, B_s = low_pass(servo.bandwidth_hz, servo.order)
    n = len(A_s)
    A, B = block_diag([[0.0]], A_s), np.concatenate([[0.0], B_s])
    A[0, 1] = 1.0
    # -(M v' + B v + K x)
    C = -hand.mass * A[1] - hand.damping * np.eye(n + 1)[1] - hand.stiffness * np.eye(n + 1)[0]
    D = -hand.mass * B[1]
    if servo.sensor_hz is None:
        return A, B, C, D
    A_f, B_f = low_pass(servo.sensor_hz, servo.sensor_order)
    whole = block_diag(A, A_f)
    whole[n + 1 :, : n + 1] = np.outer(B_f, C)
    return whole, np.concatenate([B, B_f * D]), np.eye(len(whole))[n + 1], 0.0


def rendered(coupling: tuple[float, float, float], environment: Mass, sample_time: float) -> tuple[np.ndarray, ...]:
    """Return the sampled A, B, C, D from the sensed force to v_e."""
    b_c, m_c, b_0 = coupling
    branch = np.array([m_c, b_c])
    # (Z_c + Z_e) s (m_c s + b_c)
    below = np.polymul([b_0 + environment.damping, 0.0], branch) + np.array([b_c * m_c, 0.0, 0.0])
    below = np.polyadd(below, np.polymul([environment.mass, 0.0, environment.stiffness], branch))
    state_space = tf2ss(np.polymul([1.0, 0.0], branch), np.trim_zeros(below, "f"))
    return cont2discrete(state_space, sample_time, method="bilinear")[:4]


class Sampled:
    """A servo in a hand, sampled; its memory is one vector: states of the mechanics, then velocities on their way."""

    def __init__(self, servo: Servo, hand: Mass) -> None:
        A, B, self.C, self.D = mechanics(servo, hand)
        T, n = servo.sample_time, len(A)
        late = (Fraction(repr(servo.delay)) + Fraction(repr(servo.sensor_delay))) / Fraction(repr(T))
        self.whole, self.states = floor(late), n
        rest = float(late - self.whole) * T

        def held(time: float) -> tuple[np.ndarray, np.ndarray]:
            both = expm(np.block([[A, B[:, None]], [np.zeros((1, n + 1))]]) * time)
            return both[:n, :n], both[:n, n]

        self.early, self.late = held(rest), held(T - rest)
        self.size = n + self.whole + 1

    def force(self, memory: np.ndarray) -> float:
        """Return what is sensed just before a command acts, N."""
        return float(self.C @ memory[: self.states] + self.D * memory[-1])

    def wait(self, memory: np.ndarray, velocity: float) -> np.ndarray:
        """Return the memory one sample later, from a velocity on that is held, m/s."""
        body, given = memory[: self.states], [velocity, *memory[self.states :]]
        body = self.early[0] @ body + self.early[1] * given[-1]
        body = self.late[0] @ body + self.late[1] * given[-2]
        return np.concatenate([body, given[:-1]])


def loop_matrix(servo: Servo, hand: Mass, coupling: tuple[float, float, float], environment: Mass) -> np.ndarray:
    """Return the matrix of the loop over a sample: mechanics, coupling and environment, v_e before."""
    sampled = Sampled(servo, hand)
    E, F, G, H = (np.atleast_2d(part) for part in rendered(coupling, environment, servo.sample_time))
    split = [sampled.size, sampled.size + len(E)]

    def after(memory: np.ndarray) -> np.ndarray:
        body, virtual, (before,) = np.split(memory, split)
        force = sampled.force(body)
        desired = float((G @ virtual + H[:, 0] * force)[0])
        # from one position by the trapezoidal rule to the next
        held = (desired + before) / 2 if servo.position else desired
        return np.concatenate([sampled.wait(body, held), E @ virtual + F[:, 0] * force, [desired]])

    return np.array([after(unit) for unit in np.eye(split[-1] + 1)]).T
