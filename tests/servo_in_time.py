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


def loop_matrix(servo: Servo, hand: Mass, coupling: tuple[float, float, float], environment: Mass) -> np.ndarray:
    """Return the matrix of the loop over a sample: mechanics, velocities on their way, coupling and environment."""
    T = servo.sample_time
    A, B, C, D = mechanics(servo, hand)
    late = (Fraction(repr(servo.delay)) + Fraction(repr(servo.sensor_delay))) / Fraction(repr(T))
    whole, n = floor(late), len(A)
    rest = float(late - whole) * T

    def held(time: float) -> tuple[np.ndarray, np.ndarray]:
        both = expm(np.block([[A, B[:, None]], [np.zeros((1, n + 1))]]) * time)
        return both[:n, :n], both[:n, n]

    (early, by_older), (later, by_newer) = held(rest), held(T - rest)
    E, F, G, H = (np.atleast_2d(part) for part in rendered(coupling, environment, T))
    sizes = np.cumsum([0, n, whole + 2, len(E)])
    at = [slice(*ends) for ends in zip(sizes[:-1], sizes[1:], strict=True)]
    step = np.zeros((sizes[-1], sizes[-1]))

    def after(memory: np.ndarray) -> np.ndarray:
        body, velocities, virtual = (memory[place] for place in at)

        # velocities: v_e[k-1], ..., v_e[k-N-2]; what acts is held, or between two positions their mean
        def acting(series: np.ndarray, age: int) -> float:
            return float((series[age] + series[age + 1]) / 2 if servo.position else series[age])

        force = C @ body + D * acting(velocities, whole)
        desired = (G @ virtual + H[:, 0] * force)[0]
        longer = np.concatenate([[desired], velocities, [0.0]])
        older, newer = acting(longer, whole + 1), acting(longer, whole)
        moved = later @ (early @ body + by_older * older) + by_newer * newer
        return np.concatenate([moved, longer[: whole + 2], E @ virtual + F[:, 0] * force])

    for column, unit in enumerate(np.eye(sizes[-1])):
        step[:, column] = after(unit)
    return step
