"""One design judged on many devices at once in plain complex arithmetic (DESIGN 1.1 to 1.9), not from vctune's model.

Devices are arrays of shape (3, n): mass, damping, delay. A problem is only read for its numbers.
"""

from __future__ import annotations

import numpy as np
from oracles import sampled_sensitivity

from vctune.document.problem import Problem

CHUNK = 500


def random_devices(problem: Problem, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return devices of the problem's box, half of them on its faces."""
    nominal, widths = _numbers(problem)
    share = rng.uniform(-1, 1, (3, count))
    snapped = rng.random((3, count)) < 0.5
    share[:, ::2] = np.where(snapped[:, ::2], np.sign(share[:, ::2]), share[:, ::2])
    return nominal[:, None] * (1 + widths[:, None] * share)


def corners(problem: Problem) -> np.ndarray:
    nominal, widths = _numbers(problem)
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1)
    return nominal[:, None] * (1 + widths[:, None] * signs)


def _numbers(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    names = ("mass", "damping", "delay")
    device, uncertainty = problem.device, problem.uncertainty
    return np.array([getattr(device, n) for n in names]), np.array([getattr(uncertainty, n) for n in names])


def loops(problem: Problem, design: np.ndarray, devices: np.ndarray, omega: np.ndarray):
    """Return Z_d and C, shape (devices, frequencies)."""
    m, b, delay = devices[:, :, None]
    s, T = 1j * omega, problem.device.sample_time
    shape = -np.expm1(-s * T) / (s * T) if problem.device.hold == "zoh" else 2 / (2 + s * T)
    return m * s + b, (design[0] + design[1] / s) * shape * np.exp(-s * delay)


def errors(problem: Problem, design: np.ndarray, devices: np.ndarray, nodes: int = 2000) -> np.ndarray:
    """Return the error on each device by the midpoint rule in log frequency, or on so many frequencies."""
    band, Z_0, weights = (
        problem.transparency.band,
        problem.transparency.reference_impedance,
        problem.transparency.weights,
    )
    peak = problem.transparency.norm == "peak"
    at = np.linspace(0, 1, nodes) if peak else (np.arange(nodes) + 0.5) / nodes
    omega = band.min * (band.max / band.min) ** at
    Z_d, C = loops(problem, design, devices, omega)
    squared = (
        (weights.admittance * Z_0 / np.abs(Z_d + C)) ** 2
        + (weights.tracking * np.abs(Z_d / (Z_d + C))) ** 2
        + (weights.coupling * np.abs(coupling(design, omega)) / Z_0) ** 2
    )
    return np.sqrt(squared.max(axis=1) if peak else squared.mean(axis=1))


def coupling(design: np.ndarray, omega: np.ndarray) -> np.ndarray:
    b_c, m_c, b_0 = design[2:]
    return b_0 + b_c * m_c * 1j * omega / (b_c + m_c * 1j * omega)


def least_ratio(problem: Problem, design: np.ndarray, devices: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the least Re Z_c / R over the frequencies, -inf where Re(D + Z_h) is not positive somewhere.

    R is by its definition from the two-port that has absorbed the operator's damping, Im q from 1 - q.
    """
    Z_d, C = loops(problem, design, devices, omega)
    b_h = problem.device.operator.damping if problem.device.operator else 0.0
    W = Z_d + b_h
    h11, h12, h21 = 1 / (C + W), -C / (C + W), (Z_d + C) / (C + W)
    q, rest = -h12 * h21, ((2 * W - Z_d) * C + W**2) / (C + W) ** 2
    excess = np.where(q.real > 0, rest.imag**2 / (np.abs(q) + q.real), np.abs(q) - q.real)
    R = excess / (2 * h11.real) - (b_h * C / (C + W)).real
    with np.errstate(divide="ignore"):
        ratio = np.where(R > 0, coupling(design, omega).real / R, np.inf)
    return np.where((h11.real > 0).all(axis=1), ratio.min(axis=1), -np.inf)


def spectral_radii(problem: Problem, design: np.ndarray, devices: np.ndarray) -> np.ndarray:
    """Return the spectral radius of each sampled loop, by matrix exponentials of continuous state and held force."""
    T, order = problem.device.sample_time, 2 if design[1] > 0 else 1
    m, b, delay = devices
    whole = np.floor(delay / T + 1e-12).astype(int)
    late = np.maximum(delay - whole * T, 0.0)
    radii = np.empty(devices.shape[1])
    for N in np.unique(whole):
        at = np.flatnonzero(whole == N)
        generator = np.zeros((len(at), order + 1, order + 1))
        generator[:, 0, 0], generator[:, 0, order] = -b[at] / m[at], 1 / m[at]
        generator[:, 1:order, 0] = 1.0

        def over(t, generator=generator):
            full = exponentials(generator * t[:, None, None])
            return full[:, :order, :order], full[:, :order, order]

        (transition, _), (rest, new) = over(np.full(len(at), T)), over(T - late[at])
        old = np.einsum("nij,nj->ni", rest, over(late[at])[1])
        matrix = np.zeros((len(at), order + N + 1, order + N + 1))
        matrix[:, :order, :order] = transition
        law = -design[:order]
        matrix[:, order, :order] = law
        if N == 0:
            matrix[:, :order, :order] += new[:, :, None] * law
            matrix[:, :order, order] += old
        else:
            matrix[:, :order, order + N - 1] += new
            matrix[:, :order, order + N] += old
        for k in range(1, N + 1):
            matrix[:, order + k, order + k - 1] = 1.0
        radii[at] = np.abs(np.linalg.eigvals(matrix)).max(axis=1)
    return radii


def exponentials(matrices: np.ndarray) -> np.ndarray:
    """Return matrix exponentials by Taylor's series of a small part, squared again."""
    halvings = max(0, int(np.ceil(np.log2(np.abs(matrices).sum(axis=-1).max() + 1e-300))) + 4)
    small = matrices / 2.0**halvings
    total = term = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    for k in range(1, 13):
        term = term @ small / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def model_turns(problem: Problem, design: np.ndarray, devices: np.ndarray, points: int) -> np.ndarray:
    """Return how often D (times s with an integrator) turns around 0 less than that of a stable loop does."""
    lightest, nyquist = devices[0].min(), np.pi / problem.device.sample_time
    last = 40 * max(design[0] / lightest, np.sqrt(design[1] / lightest), nyquist)
    omega = np.concatenate(
        (np.geomspace(last * 1e-9, last * 1e-3, points), np.linspace(1e-3, 1, 4 * points)[1:] * last)
    )
    Z_d, C = loops(problem, design, devices, omega)
    angle = np.unwrap(np.angle((Z_d + C) * (1j * omega if design[1] > 0 else 1)), axis=1)
    return (np.pi / 2 * (2 if design[1] > 0 else 1) - (angle[:, -1] - angle[:, 0])) / (2 * np.pi)


def held(problem: Problem, devices: np.ndarray) -> np.ndarray:
    """Return the devices with the operator's least impedance added to their own."""
    operator = problem.device.operator
    return devices + np.array([[operator.mass], [operator.damping], [0.0]]) if operator else devices


def violations(problem: Problem, design: np.ndarray, devices: np.ndarray, points: int = 400) -> dict[str, np.ndarray]:
    """Return by how much each device fails each demand, > 0 where it does: conditions, |S|, sampled and model poles."""
    stability, nyquist = problem.stability, np.pi / problem.device.sample_time
    omega = np.geomspace(stability.band.min, stability.band.max, points)
    upto = np.unique(np.concatenate((np.geomspace(1e-5, 1, points), np.linspace(0, 1, points)[1:]))) * nyquist
    parts = []
    for i in range(0, devices.shape[1], CHUNK):
        part = devices[:, i : i + CHUNK]
        m, b, delay = part[:, :, None]
        S = sampled_sensitivity(m, b, problem.device.sample_time, delay, *design[:2], upto)
        both = [part] if problem.device.operator is None else [part, held(problem, part)]
        parts.append(
            [
                1 - least_ratio(problem, design, part, omega) / stability.safety_factor,
                S.max(axis=1) / stability.max_sensitivity - 1,
                np.max([spectral_radii(problem, design, there) - 1 for there in both], axis=0),
                np.max([np.abs(model_turns(problem, design, there, points)) - 0.5 for there in both], axis=0),
            ]
        )
    rows = np.concatenate(parts, axis=1)
    return dict(zip(("conditions", "sensitivity", "sampled poles", "model poles"), rows, strict=True))
