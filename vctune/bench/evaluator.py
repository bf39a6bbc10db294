"""A second opinion in plain complex numbers: DESIGN section 1 written down once more, sharing nothing with the model.

Dense grids instead of a proof, matrix exponentials and eigenvalues instead of a return difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, log2, pi

import numpy as np
from numpy.typing import NDArray

from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Device, Gains

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

POINTS = 20_001
"""Frequencies looked at in each band."""
ENDLESS = 1e-6
"""Where a band from 0 begins, and the reciprocal of where one to inf ends, relative to the other frequencies."""


@dataclass(frozen=True, slots=True)
class Opinion:
    """What dense evaluation finds.

    Attributes
    ----------
    error : transparency error
    violation : log of the worst of safety_factor R/Re Z_c and |S|/max_sensitivity, 0 if both are met; inf where
        Re G_hh <= 0
    radius : spectral radius of the sampled loop
    """

    error: float
    violation: float
    radius: float

    @property
    def stable(self) -> bool:
        """Whether the sampled loop is stable."""
        return self.radius < 1


def opinion(problem: Problem, gains: Gains, coupling: Coupling, extra: Sequence[float] = ()) -> Opinion:
    """Evaluate a design densely, and at extra frequencies, rad/s, that someone has pointed at."""
    return Opinion(
        error(problem, gains, coupling),
        violation(problem, gains, coupling, extra),
        spectral_radius(problem.device, gains),
    )


def impedances(device: Device, K_v: Floats | float, K_p: Floats | float, omega: Floats) -> tuple[Complexes, Complexes]:
    """Return Z_d and C at omega > 0 (DESIGN 1.1)."""
    s = 1j * omega
    T = device.sample_time
    hold = -np.expm1(-s * T) / (s * T) if device.hold == "zoh" else 2 / (2 + s * T)
    return device.mass * s + device.damping, (K_v + K_p / s) * hold * np.exp(-s * device.delay)


def coupling_impedance(coupling: Coupling, omega: Floats) -> Complexes:
    """Return Z_c at omega > 0 (DESIGN 1.3): damper and mass in series, the drag beside them."""
    moving = 1j * omega * coupling.mass
    if coupling.damping == 0 or coupling.mass == 0:
        return np.full(np.shape(omega), coupling.drag, dtype=np.complex128)
    return coupling.drag + 1 / (1 / coupling.damping + 1 / moving)


def required(Z_d: Complexes, C: Complexes) -> Floats:
    """Return R = (|q| - Re q)/(2 Re G_hh), inf where Re G_hh <= 0 (DESIGN 1.4, 1.5)."""
    D = Z_d + C
    q, S, G = C / D, Z_d / D, 1 / D
    kind = q.real > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(kind, S.imag**2 / (np.abs(q) + np.abs(q.real)), np.abs(q) - q.real)
        return np.where(G.real > 0, excess / (2 * G.real), inf)


def violation(problem: Problem, gains: Gains, coupling: Coupling, extra: Sequence[float] = ()) -> float:
    """Return by how much the demands of DESIGN 1.9 on frequencies are exceeded, as a logarithm; 0 if they are met."""
    device, stability = problem.device, problem.stability
    nyquist = pi / device.sample_time
    middle = [problem.transparency.band.min, problem.transparency.band.max, nyquist]
    low = stability.band.min or ENDLESS * min(middle)
    high = stability.band.max if stability.band.max < inf else max(middle) / ENDLESS
    noted = np.array([w for w in extra if 0 < w < inf])
    inside = noted[(noted >= low) & (noted <= high)]
    omega = np.concatenate((np.geomspace(low, high, POINTS), inside))
    R = required(*impedances(device, gains.velocity, gains.position, omega))
    with np.errstate(divide="ignore", invalid="ignore"):
        short = float(np.max(stability.safety_factor * R / coupling_impedance(coupling, omega).real))
    ringing = min(np.sqrt(gains.position / device.mass), nyquist) or nyquist
    bottom = min(1e-4 * nyquist, 0.1 * ringing, problem.transparency.band.min, low)
    nearby = ringing * np.geomspace(0.25, 1.0, POINTS), np.minimum(ringing * np.geomspace(1.0, 4.0, POINTS), nyquist)
    omega = np.concatenate((np.geomspace(bottom, nyquist, POINTS), *nearby, noted[noted <= nyquist]))
    loud = float(np.max(sensitivity(device, gains, omega))) / stability.max_sensitivity
    return float(np.log(max(short, loud, 1.0)))


def error(problem: Problem, gains: Gains, coupling: Coupling) -> float:
    """Return the transparency error (DESIGN 1.8) by Simpson's rule, or the greatest value on the grid."""
    wanted = problem.transparency
    omega = np.geomspace(wanted.band.min, wanted.band.max, POINTS)
    Z_d, C = impedances(problem.device, gains.velocity, gains.position, omega)
    D, Z_0, weights = Z_d + C, wanted.reference_impedance, wanted.weights
    square = (weights.admittance * Z_0 * np.abs(1 / D)) ** 2 + (weights.tracking * np.abs(1 - C / D)) ** 2
    square = square + (weights.coupling * np.abs(coupling_impedance(coupling, omega)) / Z_0) ** 2
    if wanted.norm == "peak":
        return float(np.sqrt(square.max()))
    simpson = np.full(POINTS, 2.0)
    simpson[1::2] = 4.0
    simpson[[0, -1]] = 1.0
    return float(np.sqrt(np.average(square, weights=simpson)))


def spectral_radius(device: Device, gains: Gains) -> float:
    """Return the spectral radius of the sampled loop (DESIGN 1.7) from its companion matrix."""
    return float(np.abs(np.linalg.eigvals(loop_matrix(device, gains, order_of(gains)))).max())


def sensitivity(device: Device, gains: Gains, omega: Floats) -> Floats:
    """Return |S| of the sampled loop at omega > 0: product of z less each pole with the loop open over those closed."""
    z = np.exp(1j * omega * device.sample_time)
    unit = Gains(0.0, 0.0), gains
    opened, closed = (np.linalg.eigvals(loop_matrix(device, law, order_of(gains))) for law in unit)
    S = np.ones(z.shape)
    for free, bound in zip(opened, closed, strict=True):
        S *= np.abs((z - free) / (z - bound))
    return S


def order_of(gains: Gains) -> int:
    """Return how many of v and x are in the loop."""
    return 2 if gains.position > 0 else 1


def loop_matrix(device: Device, gains: Gains, order: int) -> Floats:
    """Return the matrix that takes v, x and the forces on their way from one sample to the next.

    A force that is told at a sample acts `whole` samples and `late` seconds afterwards. Without K_p there is no x.
    """
    T, delay = device.sample_time, device.delay
    whole = floor(delay / T + 1e-9)
    late = max(delay - whole * T, 0.0)
    A, held = _sampled(device, T, order)
    _, newest = _sampled(device, T - late, order)
    size = order + whole + 1
    loop = np.zeros((size, size))
    law = np.zeros(size)
    law[:order] = [-gains.velocity, -gains.position][:order]
    told = [law, *np.eye(size)[order:]]  # the force that is told now, the one a sample ago, ...
    loop[:order, :order] = A
    loop[:order] += np.outer(newest, told[whole]) + np.outer(held - newest, told[whole + 1])
    loop[order:] = told[: whole + 1]
    return loop


def _sampled(device: Device, t: float, order: int) -> tuple[Floats, Floats]:
    """Return the motion over t: its matrix and what a constant unit force adds to it."""
    rates = np.zeros((order + 1, order + 1))
    rates[0, 0], rates[0, order] = -device.damping / device.mass, 1 / device.mass
    if order == 2:
        rates[1, 0] = 1.0
    whole = _exponential(rates * t)
    return whole[:order, :order], whole[:order, order]


def _exponential(A: Floats) -> Floats:
    """Return e^A by scaling, Taylor's series and squaring."""
    norm = float(np.abs(A).sum(axis=1).max())
    halvings = max(0, ceil(log2(norm)) + 4) if norm > 0 else 0
    scaled = A / 2.0**halvings
    term = total = np.eye(len(A))
    for k in range(1, 16):
        term = term @ scaled / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total
