"""Whole loops of a device, a hand, a coupling and an environment, many at once: the spectral radii of one sample.

Not from vctune, nor from `world_loops`: exact steps of the mechanism by its eigenvalues, and the firmware's equations
solved for each sample. A velocity loop measures velocity and the hand's force, without delay; an impedance display
makes a force of the differenced and filtered position, late by a part of a sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Loops:
    """n hands, shares of the coupling and dampings of the environment; each an array of shape (n,), SI units."""

    mass: Floats
    damping: Floats
    stiffness: Floats
    share: Floats
    environment_damping: Floats


def step(m: Floats, b: Floats, k: Floats, time: float) -> tuple[Floats, Floats]:
    """Return Phi, (n, 2, 2), and Gamma, (n, 2), of position and velocity of m x'' + b x' + k x = u over a time."""
    k = np.maximum(k, 1e-9)
    root = np.sqrt((b / (2 * m)) ** 2 - k / m + 0j)
    fast, slow = -b / (2 * m) - root, -b / (2 * m) + root
    root = np.where(abs(root) < 1e-9, 1e-9, root)
    e1, e2, d = np.exp(fast * time), np.exp(slow * time), slow - fast
    Phi = np.array([[slow * e1 - fast * e2, e2 - e1], [fast * slow * (e1 - e2), slow * e2 - fast * e1]]) / d
    Phi = Phi.real.transpose(2, 0, 1)
    gain = np.stack(((1 - Phi[:, 0, 0]) / k, Phi[:, 0, 1] / m), axis=1)
    return Phi, gain


def radii(size: int, one: Callable[[Floats], Floats], n: int) -> Floats:
    """Return the spectral radii of the linear maps that `one` makes of n memories at once."""
    columns = [one(np.tile(row, (n, 1))) for row in np.eye(size)]
    return np.abs(np.linalg.eigvals(np.stack(columns, axis=2))).max(axis=1)


def velocity_loop(
    device: tuple[float, float, float],
    gains: tuple[float, float],
    coupling: tuple[float, float, float],
    loops: Loops,
    m: float,
    k: float,
) -> Floats:
    """Return spectral radii with an environment of mass m and stiffness k; the device is mass, damping, sample time."""
    (m_d, b_d, T), (K_v, K_p) = device, gains
    b_c, m_c, b_0 = (number * loops.share for number in coupling)
    M, B, K, b = loops.mass, loops.damping, loops.stiffness, loops.environment_damping
    Phi, Gamma = step(m_d + M, b_d + B, K, T)
    h = 2 / T
    soft = b_c * h * m_c / (b_c + h * m_c)

    def one(memory: Floats) -> Floats:
        x, v, acting, x_e, p_c, p_e = memory.T
        acceleration = (acting - (b_d + B) * v - K * x) / (m_d + M)
        force = -(M * acceleration + B * v + K * x)  # sensed just before the new command acts
        v_e = (force + soft * p_c - k * x_e + h * m * p_e) / (b_0 + b + k * T / 2 + soft + h * m)
        command = K_v * (v_e - v) + K_p * (x_e + T / 2 * v_e - x)
        after = np.einsum("nij,jn->in", Phi, np.array([x, v])) + Gamma.T * command
        given = soft * (v_e - p_c)
        return np.stack((*after, command, x_e + T * v_e, p_c + 2 * given / (h * m_c), 2 * v_e - p_e), axis=1)

    return radii(6, one, len(M))


def impedance_display(
    device: tuple[float, float, float, float, float],
    coupling: tuple[float, float],
    loops: Loops,
    m: float,
    k: float,
) -> Floats:
    """Return the same of an impedance display: mass, damping, sample time, a delay of less than that, filter a."""
    m_d, b_d, T, delay, a = device
    b_c, k_c = (number / loops.share for number in coupling)
    M, B, K, b = loops.mass, loops.damping, loops.stiffness, loops.environment_damping
    first, rest = step(m_d + M, b_d + B, K, delay), step(m_d + M, b_d + B, K, T - delay)
    h = 2 / T

    def one(memory: Floats) -> Floats:
        x, v, acting, before, filtered, spring, x_t, p_t = memory.T
        y = (x - before) / T
        at_once = b + h * m + k * T / 2 + b_c * a + k_c * T
        moved = b_c * ((1 - a) * filtered + a * y) + k_c * (spring + T * y) + h * m * p_t - k * x_t
        v_t = moved / at_once
        filtered, spring = (1 - a) * filtered + a * (y - v_t), spring + T * (y - v_t)
        command = -(b_c * filtered + k_c * spring)
        state = np.array([x, v])
        for (Phi, Gamma), force in ((first, acting), (rest, command)):
            state = np.einsum("nij,jn->in", Phi, state) + Gamma.T * force
        return np.stack((*state, command, x, filtered, spring, x_t + T * v_t, 2 * v_t - p_t), axis=1)

    return radii(8, one, len(M))
