"""Implement the theory independently, in plain complex numbers, without any code of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from math import inf, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, series_coupling
from vctune.model.problem import Problem

POINTS = 20_001  # Number of frequencies in each grid
SLOWEST = 1e-15  # Least frequency at which `stable` follows a loop, as a share of the Nyquist frequency
# If the stability band begins at 0, its grid begins at this number times the least of three frequencies: the edges of
# the transparency band and the Nyquist frequency
ENDLESS = 1e-6
WHOLE = 1e-12  # Greatest deviation of a delay that counts as whole samples, as a share of a sample
SERIES = 1e-2  # Argument below which digits cancel in the closed forms of `_integrals`, so that Taylor series serve


@dataclass(frozen=True, slots=True)
class Scene:
    """An admittance display without parts, with a design, or many of them, in SI units."""

    mass: Any  # parameters of the device
    damping: Any
    sample_time: Any
    delay: Any
    hold: str
    K_v: Any  # gains of the velocity loop
    K_p: Any
    b_c: Any = 1.0  # damping, mass and drag of the coupling; b_c must be finite
    m_c: Any = 1.0
    b_0: Any = 0.0
    m_h: Any = 0.0  # mass and damping of the least operator; 0 if the handle may be free
    b_h: Any = 0.0


def cases(device: Device, design: ArrayLike) -> Scene:
    """Return the cases of a device with one design or with many."""
    hand = (device.operator.mass, device.operator.damping) if device.operator else (0.0, 0.0)
    numbers = (device.mass, device.damping, device.sample_time, device.delay, device.hold)
    return Scene(*numbers, *np.asarray(design, float), *hand)


def case_of(device: Device, gains: Gains, coupling: AnyCoupling) -> Scene:
    """Return the case of one design."""
    return cases(device, (*astuple(gains), *astuple(series_coupling(coupling))))


def _column(number: Any) -> Any:
    """Return a number, or an array of cases that broadcasts over frequencies."""
    return number[:, None] if np.ndim(number) else number


def impedances(case: Scene, s: Any) -> tuple[Any, Any]:
    """Return Z_d = m s + b and C = (K_v + K_p/s) H(s) e^(-s delay) (paper eq. 9 for C), where H is the hold."""
    T = case.sample_time
    hold = -np.expm1(-s * T) / (s * T) if case.hold == "zoh" else 2 / (2 + s * T)
    law = _column(case.K_v) + _column(case.K_p) / s
    return _column(case.mass) * s + _column(case.damping), law * hold * np.exp(-s * _column(case.delay))


def coupling_impedance(case: Scene, s: Any) -> Any:
    """Return Z_c = b_0 + b_c m_c s/(b_c + m_c s) (paper eq. 17): damper and mass in series, and the drag in
    parallel."""
    damper, moving = _column(case.b_c), _column(case.m_c) * s
    return _column(case.b_0) + damper * moving / (damper + moving)


def required(case: Scene, omega: Any) -> Any:
    """Return R = (|q| - Re q)/(2 Re h11) - Re h22, the least feasible Re Z_c (paper eq. 19)."""
    Z_d, C = impedances(case, 1j * omega)
    W = Z_d + case.b_h
    D = W + C
    q, rest = C * (Z_d + C) / D**2, ((2 * W - Z_d) * C + W**2) / D**2
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(q.real > 0, rest.imag**2 / (np.abs(q) + np.abs(q.real)), np.abs(q) - q.real)
        R = excess * np.abs(D) ** 2 / (2 * D.real) - case.b_h * (C / D).real
        return np.where(D.real > 0, R, inf)


def stability_ratio(case: Scene, omega: Any) -> Any:
    """Return Re Z_c / R."""
    R = required(case, omega)
    with np.errstate(divide="ignore"):
        ratio = np.where(R > 0, coupling_impedance(case, 1j * omega).real / R, inf)
    return np.where(inf > R, ratio, -inf)


def return_difference(case: Scene, omega: Any) -> tuple[Any, Any]:
    """Return 1 + K_v G_v + K_p G_x of the sampled loop without a hand, and its denominator over a power of z."""
    T, m, rate = case.sample_time, _column(case.mass), _column(case.damping) / _column(case.mass)
    whole, remainder = (_column(x) for x in samples(case))
    back = np.exp(-1j * omega * T)  # 1/z
    (v, x), (v_new, x_new) = _integrals(rate, T), _integrals(rate, T - remainder)
    # effects of a force that begins `remainder` late in a sample and lasts T: the rest of it acts in the next sample
    velocity, position = ((new + (old - new) * back) / m for new, old in ((v_new, v), (x_new, x)))
    acting, forward = back**whole, -np.expm1(-1j * omega * T)  # z^-whole, 1 - 1/z
    slowed = forward + back * -np.expm1(-rate * T)
    G_v = acting * back * velocity / slowed
    G_x = back * (v * G_v + acting * position) / forward
    K_v, K_p = _column(case.K_v), _column(case.K_p)
    return 1 + K_v * G_v + K_p * G_x, slowed * np.where(K_p > 0, forward, 1.0)


def sensitivity(case: Scene, omega: Any) -> Any:
    """Return |S| of the sampled loop without a hand."""
    return 1 / np.abs(return_difference(case, omega)[0])


def stable(case: Scene) -> bool:
    """Return whether one sampled loop without a hand is stable: its characteristic polynomial over a power of z makes
    no turn along the upper half of the unit circle."""
    omega = np.union1d(np.geomspace(SLOWEST, 1.0, POINTS), np.linspace(0.0, 1.0, POINTS)[1:]) * pi / case.sample_time
    difference, denominator = return_difference(case, omega)
    angle = np.unwrap(np.angle(difference * denominator))
    return bool(abs(angle[-1] - angle[0]) < pi / 2)


def samples(case: Scene) -> tuple[Any, Any]:
    """Return the delay as whole samples and a remainder in seconds, 0 <= remainder < T."""
    T = case.sample_time
    whole = np.floor(np.asarray(case.delay) / T + WHOLE)
    remainder = np.maximum(case.delay - whole * T, 0.0)
    return whole, np.where(remainder < WHOLE * T, 0.0, remainder)


def _integrals(rate: Any, t: Any) -> tuple[Any, Any]:
    """Return the integral of e^(-rate s) over [0, t], and the integral of that integral."""
    x = rate * t
    small = x < SERIES
    y = np.where(small, 1.0, x)
    first = np.where(small, 1 - x / 2 + x**2 / 6 - x**3 / 24 + x**4 / 120 - x**5 / 720, -np.expm1(-y) / y)
    second = 1 / 2 - x / 6 + x**2 / 24 - x**3 / 120 + x**4 / 720 - x**5 / 5040
    return t * first, t**2 * np.where(small, second, (y + np.expm1(-y)) / y**2)


def violation(problem: Problem, case: Scene, extra: Sequence[float] = ()) -> float:
    """Return the logarithm of one case's greatest violation of the constraints on Re Z_c/R and |S|."""
    device, stability, nyquist = problem.device, problem.stability, pi / problem.device.sample_time
    middle = [problem.transparency.band.min, problem.transparency.band.max, nyquist]
    low = stability.band.min or ENDLESS * min(middle)
    high = stability.band.max if stability.band.max < inf else max(middle) / ENDLESS
    known = np.array([w for w in extra if 0 < w < inf])
    missed = 0.0
    if problem.passive:
        inside = known[(known >= low) & (known <= high)]
        ratio = float(stability_ratio(case, np.concatenate((np.geomspace(low, high, POINTS), inside))).min())
        missed = stability.safety_factor / ratio if ratio > 0 else inf
    # |S| peaks near the resonance of mass and K_p, for which two grids within a factor of 4 are added
    ringing = min(float(np.sqrt(case.K_p / device.mass)), nyquist) or nyquist
    lowest = min(1e-4 * nyquist, 0.1 * ringing, problem.transparency.band.min, low)
    grids = np.geomspace(lowest, nyquist, POINTS), ringing * np.geomspace(0.25, 4.0, 2 * POINTS), known
    omega = np.concatenate(grids)
    loud = float(sensitivity(case, omega[omega <= nyquist]).max()) / stability.max_sensitivity
    return float(np.log(max(missed, loud, 1.0)))
