"""The whole loop of device, hand, coupling and virtual environment in exact time, for boxes of environments.

Not from vctune: the matrix exponential of the device in the hand, and everything that the firmware steps, as one matrix
of one sample. Its eigenvalues say what is stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import floor

import numpy as np
from scipy.linalg import expm


@dataclass(frozen=True)
class Plant:
    """A rigid device, or a servo of order 1 or 2, with an optional first-order force sensor; SI units."""

    sample_time: float
    delay: float
    mass: float = 1.0
    damping: float = 0.0
    servo: int = 0
    bandwidth: float = 0.0
    interpolated: bool = False
    sensor: float = 0.0


@dataclass(frozen=True)
class Whole:
    """All numbers of a loop; a coupling of infinite damping is rigid."""

    plant: Plant
    hand: tuple[float, float, float]
    gains: tuple[float, float]
    coupling: tuple[float, float, float]
    world: tuple[float, float, float] = (0.0, 0.0, 0.0)


def continuous(loop: Whole) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return A, B of x' = A x + B u with x = (position, velocity, ...), and the force f = C x + D u of the hand."""
    p, (M, B, K) = loop.plant, loop.hand
    if p.servo == 0:
        m = p.mass + M
        A, b = np.array([[0.0, 1.0], [-K / m, -(p.damping + B) / m]]), np.array([0.0, 1 / m])
    elif p.servo == 1:
        A, b = np.array([[0.0, 1.0], [0.0, -p.bandwidth]]), np.array([0.0, p.bandwidth])
    else:
        w = p.bandwidth
        A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -w * w, -np.sqrt(2) * w]])
        b = np.array([0.0, 0.0, w * w])
    acceleration, direct = A[1], b[1]
    C = -(M * acceleration + B * np.eye(len(A))[1] + K * np.eye(len(A))[0])
    D = -M * direct
    if p.sensor:
        n = len(A)
        A = np.block([[A, np.zeros((n, 1))], [p.sensor * C[None], np.array([[-p.sensor]])]])
        b = np.append(b, p.sensor * D)
        C, D = np.eye(n + 1)[n], 0.0
    return A, b, C, D


def stepped(loop: Whole) -> np.ndarray:
    """Return the matrix of one sample of everything."""
    p, T = loop.plant, loop.plant.sample_time
    A, b, C, D = continuous(loop)
    whole = floor(p.delay / T * (1 + 1e-12))
    part = max(p.delay - whole * T, 0.0)

    def over(time: float) -> tuple[np.ndarray, np.ndarray]:
        n = len(A)
        both = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * time)
        return both[:n, :n], both[:n, n]

    (first, pushed), (rest, later) = over(part), over(T - part)
    n, queue = len(A), whole + 1
    (K_v, K_p), (b_c, m_c, b_0), (m, d, k) = loop.gains, loop.coupling, loop.world
    rigid = np.isinf(b_c)
    h = 2 / T
    soft = 0.0 if rigid else b_c * h * m_c / (b_c + h * m_c)  # v_e over the coupling's force at once
    # memory: device, commands not yet acting (oldest first) and the one acting, x_p, momentum state, mass state, v_e
    size = n + queue + 1 + 4

    def one(memory: np.ndarray) -> np.ndarray:
        state, waiting = memory[:n], memory[n : n + queue + 1]
        x_p, p_c, p_e, last = memory[n + queue + 1 :]
        # sensed just before the new command acts: the force is driven by the newest command that has arrived
        force = C @ state + D * waiting[1]
        # trapezoid: coupling mass v_m = p_c + f/(h m_c), environment mass v_e = p_e + f/(h m), x_e = x_p + v_e T/2
        heavy = h * (m + (m_c if rigid else 0.0))
        at_once = b_0 + d + k * T / 2 + soft + heavy
        v_e = (force + soft * p_c - k * x_p + heavy * p_e) / at_once
        f_c = soft * (v_e - p_c)
        x_e = x_p + T / 2 * v_e
        if p.servo:
            command = (v_e + last) / 2 if p.interpolated else v_e
        else:
            command = K_v * (v_e - state[1]) + K_p * (x_e - state[0])
        queued = np.append(waiting[1:], command)  # waiting[0] acted last; queued[0] and [1] act in this sample
        state = first @ state + pushed * queued[0]
        state = rest @ state + later * queued[1]
        # trapezoidal memories: p = v + f/(h m) of this sample
        p_c = p_c + 2 * f_c / (h * m_c) if not rigid else 0.0
        p_e = 2 * v_e - p_e if heavy else 0.0
        return np.concatenate((state, queued, [x_p + T * v_e, p_c, p_e, v_e]))

    return np.array([one(row) for row in np.eye(size)]).T


def spectral_radius(loop: Whole) -> float:
    """Return the greatest modulus of the loop's eigenvalues."""
    return float(np.abs(np.linalg.eigvals(stepped(loop))).max())


def seen(loop: Whole, theta: np.ndarray) -> np.ndarray:
    """Return Z_seen at angles omega T: -f per v_e of device and hand."""
    p, T = loop.plant, loop.plant.sample_time
    A, b, C, D = continuous(loop)
    whole = floor(p.delay / T * (1 + 1e-12))
    part = max(p.delay - whole * T, 0.0)
    n = len(A)

    def over(time: float) -> tuple[np.ndarray, np.ndarray]:
        both = expm(np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]) * time)
        return both[:n, :n], both[:n, n]

    (first, pushed), (rest, later) = over(part), over(T - part)
    z = np.exp(1j * np.asarray(theta))
    Phi = rest @ first
    inverse = np.linalg.inv(z[:, None, None] * np.eye(n) - Phi)
    # queued[0] is the command of `whole + 1` samples ago, queued[1] of `whole` ago
    push = (rest @ pushed)[None] * z[:, None] ** -(whole + 1) + later[None] * z[:, None] ** -whole
    state = np.einsum("kij,kj->ki", inverse, push)
    force = state @ C + D * z ** -(whole + 1)
    K_v, K_p = loop.gains
    lag = T / 2 * (z + 1) / (z - 1)
    if p.servo:
        G = (1 + 1 / z) / 2 if p.interpolated else np.ones_like(z)
        return -force * G
    loop_gain = K_v * state[:, 1] + K_p * state[:, 0]
    command = (K_v + K_p * lag) / (1 + loop_gain)
    return -force * command


def offered(loop: Whole, theta: np.ndarray) -> np.ndarray:
    """Return Z_c at angles omega T."""
    s = 2j / loop.plant.sample_time * np.tan(np.asarray(theta) / 2)
    b_c, m_c, b_0 = loop.coupling
    return b_0 + (m_c * s if np.isinf(b_c) else b_c * m_c * s / (b_c + m_c * s))


def in_world(loop: Whole, world: tuple[float, float, float], share: float = 1.0) -> Whole:
    """Return the loop with an environment, and a share of its coupling."""
    b_c, m_c, b_0 = loop.coupling
    return replace(loop, world=world, coupling=(b_c * share, m_c * share, b_0 * share))
