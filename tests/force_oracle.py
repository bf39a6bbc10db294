"""Designs of impedance displays judged by NumPy's complex numbers: demands on dense grids, the error by its formulas.

It shares nothing with the package but the problem's numbers. What it finds admissible may miss a demand between its
angles and hands by little.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import floor, pi

import numpy as np
from force_loop import Mechanics
from scipy.linalg import expm

from vctune.model.device import Device
from vctune.model.problem import Problem

ALIASES = 3000
"""On either side, of a disc: the rest is 1e-4 of the disc."""
THETA = np.concatenate((np.geomspace(1e-3, 0.3, 60), np.linspace(0.305, pi, 160)))


def mechanics(device: Device, hand=(0.0, 0.0, 0.0)) -> Mechanics:
    handle, motor = None, device.mass
    if device.structure is not None:
        part = device.structure
        motor = device.mass - part.handle_mass
        reduced, w = motor * part.handle_mass / device.mass, 2 * pi * part.frequency_hz
        handle = (part.handle_mass, reduced * w * w, 2 * part.damping_ratio * reduced * w)
    lag = device.actuator.bandwidth_hz if device.actuator else None
    return Mechanics(motor, device.damping, handle, hand, [], lag)


def answer(device: Device, hand, theta: np.ndarray) -> np.ndarray:
    """Return G_y, from the held command to the differenced position, in a hand."""
    T = device.sample_time
    A, B = mechanics(device, hand).matrices()
    n, whole = len(A), floor(device.delay / T + 1e-9)
    part = max(device.delay - whole * T, 0.0)

    def held(t):
        both = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * t)
        return both[:n, :n], both[:n, n]

    (A_1, B_1), (A_2, B_2) = held(part), held(T - part)
    z = np.exp(1j * theta)
    pushed = B_2[None] + (A_2 @ B_1)[None] / z[:, None]
    x = np.linalg.solve(z[:, None, None] * np.eye(n) - A_2 @ A_1, pushed[..., None])[:, 0, 0]
    return (1 - 1 / z) / T * x * z**-whole


def low_pass(device: Device, theta: np.ndarray) -> np.ndarray:
    """Return F of the firmware, without the difference."""
    estimate = device.velocity
    if estimate is None or estimate.filter_hz is None:
        return np.ones_like(theta, complex)
    p = np.exp(-2 * pi * estimate.filter_hz * device.sample_time)
    return ((1 - p) / (1 - p * np.exp(-1j * theta))) ** estimate.filter_order


def lag(device: Device, omega: np.ndarray) -> np.ndarray:
    """Return the actuator's A."""
    if device.actuator is None:
        return np.ones_like(omega, complex)
    s = 1j * omega / (2 * pi * device.actuator.bandwidth_hz)
    return 1 / (1 + s) if device.actuator.order == 1 else 1 / (1 + np.sqrt(2) * s + s * s)


def disc(device: Device, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and radius of G_y in any passive hand."""
    T, n = device.sample_time, np.arange(-ALIASES, ALIASES + 1)
    omega = (theta[:, None] + 2 * pi * n) / T
    half = 1 / (2 * (device.damping + (device.operator.damping if device.operator else 0.0)))
    centre, radius = np.full(omega.shape, half, complex), np.full(omega.shape, half)
    if device.structure is not None:
        _, k, c = mechanics(device).handle
        m_1 = device.mass - device.structure.handle_mass
        # behind the spring a passive hand is any impedance in the disc of centre and radius 1/(2 g), beside the motor's
        most = 0.5 / (1 / (c + k / (1j * omega))).real
        loaded = 1j * omega * m_1 + device.damping
        inside = np.abs(loaded) ** 2 + 2 * loaded.real * most
        centre, radius = (loaded + most).conj() / inside, most / inside
    turn = lag(device, omega) * np.exp(-1j * (theta[:, None] + omega * device.delay))
    weight = 4 * np.sin(theta[:, None] / 2) ** 2 / (omega * T) ** 2
    return (weight * turn * centre).sum(axis=1), (weight * np.abs(turn) * radius).sum(axis=1)


@dataclass
class Oracle:
    """What a problem asks of the couplings of one K_v.

    Attributes
    ----------
    theta : angles
    required : R/s^2 there, the greatest of all hands
    stable : whether the loop of K_v alone is, in every hand, with |S| below its limit
    """

    theta: np.ndarray
    required: np.ndarray
    stable: bool


def hands_of(problem: Problem) -> list[tuple[float, float, float]]:
    """Return some hands of the box, its corners among them."""
    low, high = problem.hands.low, problem.hands.high
    ends = [(low.mass, high.mass), (low.damping, high.damping), (low.stiffness, high.stiffness)]
    return list(product(*(np.unique(a + (b - a) * np.array([0, 0.01, 0.1, 0.4, 1])) for a, b in ends)))


def angles(problem: Problem, devices: list[Device]) -> np.ndarray:
    """Return `THETA`, and more where a device rings in a hand."""
    found = [THETA]
    for device, (M, B, K) in product(devices, hands_of(problem) if problem.hands_met is not None else ()):
        if K > 0:
            mass = device.mass + M
            ring = np.sqrt(K / mass)
            width = np.arctan((device.damping + B) / (2 * mass * ring))  # relative, at most a radian
            around = ring * np.exp(width * np.linspace(-3, 3, 25)) * device.sample_time
            found.append(around[(around > THETA[0]) & (around < pi)])
    return np.unique(np.concatenate(found))


def winding(curve: np.ndarray) -> float:
    """Return how often a curve up to Nyquist, with its mirror image, goes around 0."""
    return float(np.round(np.unwrap(np.angle(curve))[[0, -1]] @ [-1, 1] / pi))


def demanded(problem: Problem, devices: list[Device], K_v: float) -> Oracle:
    """Return what all devices ask of a coupling with a K_v."""
    theta, stable = angles(problem, devices), True
    s2, required = np.sin(theta / 2) ** 2, np.full(theta.size, -np.inf)
    for device in devices:
        F = low_pass(device, theta)
        free = 1 + K_v * F * answer(device, (0.0, 0.0, 0.0), theta)
        stable &= winding(free) == 0 and bool((np.abs(1 / free) <= problem.stability.max_sensitivity).all())
        if problem.any_hand:
            c, r = disc(device, theta)
            # what 1 + K_v F G and G/(1 + K_v F G) come to in the disc
            size = np.abs(1 + K_v * F * c) ** 2 - (K_v * np.abs(F) * r) ** 2
            stable &= bool((size > 0).all())
            far = (c * (1 + K_v * F * c).conj() - (K_v * F).conj() * r**2) / size
            required = np.maximum(required, -(far.real - r / size) / s2)
        if problem.hands_met is not None:
            for hand in hands_of(problem):
                G = answer(device, hand, theta)
                stable &= winding(1 + K_v * F * G) == 0
                required = np.maximum(required, -(G / (1 + K_v * F * G)).real / s2)
    return Oracle(theta, required, stable)


def offered(device: Device, theta: np.ndarray, b_c: np.ndarray, k_c: np.ndarray) -> np.ndarray:
    """Return Re(1/Z_c)/s^2 of couplings, arrays of shape (n,), at angles."""
    Z_c = b_c[:, None] * low_pass(device, theta) + k_c[:, None] * device.sample_time / (1 - np.exp(-1j * theta))
    return (1 / Z_c).real / np.sin(theta / 2) ** 2


def admissible(problem: Problem, devices: list[Device], asked: Oracle, b_c: np.ndarray, k_c: np.ndarray) -> np.ndarray:
    """Return which couplings, arrays of shape (n,), meet the demand of their K_v on every device."""
    least = np.maximum(asked.required, problem.stability.safety_factor * asked.required)
    good = np.full(b_c.shape, asked.stable)
    for device in devices:
        good &= (offered(device, asked.theta, b_c, k_c) >= least).all(axis=1)
    return good


def errors(
    problem: Problem, device: Device, K_v: float, b_c: np.ndarray, k_c: np.ndarray, weights: tuple[float, float, float],
    points: int = 2001,
) -> np.ndarray:  # fmt: skip
    """Return the error of designs of one K_v on a device, with weights of its own."""
    band, T, Z_0 = problem.transparency.band, device.sample_time, problem.transparency.reference_impedance
    omega = np.geomspace(band.min, band.max, points)
    theta = omega * T
    s, z, F = 1j * omega, np.exp(1j * theta), low_pass(device, theta)
    drive = lag(device, omega) * (1 - 1 / z) / (s * T) * np.exp(-s * device.delay)
    W, y, Z_2 = s * device.mass + device.damping, 0.0, 0.0
    if device.structure is not None:
        m_2, k, c = mechanics(device).handle
        W, y, Z_2 = W - s * m_2, 1 / (c + k / s), s * m_2
    W = W + drive * K_v * F * (1 - 1 / z) / (s * T)
    N = 1 + y * W
    D = W + Z_2 * N
    Z_c = b_c[:, None] * F + k_c[:, None] * T / (1 - 1 / z)
    terms = np.abs(D / N) / Z_0, np.abs(1 - drive / N), Z_0 / np.abs(Z_c)
    square = sum((weight * term) ** 2 for weight, term in zip(weights, terms, strict=True))
    if problem.transparency.norm == "peak":
        return np.sqrt(square.max(axis=-1))
    average = np.full(points, 1 / (points - 1))
    average[[0, -1]] /= 2
    return np.sqrt(square @ average)
