"""Implement the theory independently, in plain complex numbers, without any code of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from math import inf, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import simpson
from scipy.linalg import expm

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, series_coupling
from vctune.model.problem import Problem

Floats = NDArray[np.float64]

POINTS = 20_001  # Number of frequencies in each grid
# If the stability band begins at 0, its grid begins at this number times the least of three frequencies: the edges of
# the transparency band and the Nyquist frequency
ENDLESS = 1e-6
# Greatest deviation of a delay from a whole number of samples, as a share of a sample, for the delay to count as whole
WHOLE = 1e-12
# Argument x below which the code uses Taylor series for (1 - e^-x)/x and (x - 1 + e^-x)/x^2, because digits cancel in
# the closed forms
SERIES = 1e-2


@dataclass(frozen=True, slots=True)
class Case:
    """An admittance display without parts, with a design, or many of them, in SI units."""

    mass: Any  # parameters of the device
    damping: Any
    sample_time: float
    delay: Any
    hold: str
    K_v: Any  # gains of the velocity loop
    K_p: Any
    b_c: Any = 1.0  # damping, mass and drag of the coupling; b_c must be finite
    m_c: Any = 1.0
    b_0: Any = 0.0
    m_h: float = 0.0  # mass and damping of the least operator; 0 if the handle may be free
    b_h: float = 0.0

    @property
    def bare(self) -> Case:
        """The case without the least operator."""
        return replace(self, m_h=0.0, b_h=0.0)

    @property
    def loops(self) -> tuple[Case, ...]:
        """The loops that must be stable on their own: without a hand and, if the problem has a least operator, with
        this operator. The second loop is a device with the sums of the masses and of the dampings."""
        if self.m_h == self.b_h == 0:
            return (self,)
        return self.bare, replace(self.bare, mass=self.mass + self.m_h, damping=self.damping + self.b_h)

    def at(self, index: Any) -> Case:
        """Return some of the cases, by a NumPy index."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: x[index] for name, x in arrays.items() if np.ndim(x)})


def cases(device: Device, design: ArrayLike) -> Case:
    """Return the cases of a device with one design or with many."""
    hand = (device.operator.mass, device.operator.damping) if device.operator else (0.0, 0.0)
    numbers = (device.mass, device.damping, device.sample_time, device.delay, device.hold)
    return Case(*numbers, *np.asarray(design, float), *hand)


def case_of(device: Device, gains: Gains, coupling: AnyCoupling) -> Case:
    """Return the case of one design."""
    return cases(device, (*astuple(gains), *astuple(series_coupling(coupling))))


def _column(number: Any) -> Any:
    """Return a number, or an array of cases that broadcasts over frequencies."""
    return number[:, None] if np.ndim(number) else number


def impedances(case: Case, s: Any) -> tuple[Any, Any]:
    """Return Z_d = m s + b and C = (K_v + K_p/s) H(s) e^(-s delay) (paper eq. 9 for C), where H is the hold."""
    T = case.sample_time
    hold = -np.expm1(-s * T) / (s * T) if case.hold == "zoh" else 2 / (2 + s * T)
    law = _column(case.K_v) + _column(case.K_p) / s
    return _column(case.mass) * s + _column(case.damping), law * hold * np.exp(-s * _column(case.delay))


def coupling_impedance(case: Case, s: Any) -> Any:
    """Return Z_c = b_0 + b_c m_c s/(b_c + m_c s) (paper eq. 17): damper and mass in series, and the drag in
    parallel."""
    damper, moving = _column(case.b_c), _column(case.m_c) * s
    return _column(case.b_0) + damper * moving / (damper + moving)


def required(case: Case, omega: Any) -> Any:
    """Return R = (|q| - Re q)/(2 Re h11) - Re h22, the least feasible Re Z_c (paper eq. 19)."""
    Z_d, C = impedances(case, 1j * omega)
    W = Z_d + case.b_h
    D = W + C
    q, rest = C * (Z_d + C) / D**2, ((2 * W - Z_d) * C + W**2) / D**2
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(q.real > 0, rest.imag**2 / (np.abs(q) + np.abs(q.real)), np.abs(q) - q.real)
        R = excess * np.abs(D) ** 2 / (2 * D.real) - case.b_h * (C / D).real
        return np.where(D.real > 0, R, inf)


def stability_ratio(case: Case, omega: Any) -> Any:
    """Return Re Z_c / R."""
    R = required(case, omega)
    with np.errstate(divide="ignore"):
        ratio = np.where(R > 0, coupling_impedance(case, 1j * omega).real / R, inf)
    return np.where(inf > R, ratio, -inf)


def sensitivity(case: Case, omega: Any) -> Any:
    """Return |S| = 1/|1 + K_v G_v + K_p G_x| of the sampled loop without a hand."""
    T, m, rate = case.sample_time, _column(case.mass), _column(case.damping) / _column(case.mass)
    whole, remainder = (_column(x) for x in _samples(case))
    back = np.exp(-1j * omega * T)  # 1/z
    (v, x), (v_new, x_new) = _integrals(rate, T), _integrals(rate, T - remainder)
    # effects of a force that begins `remainder` late in a sample and lasts T: the rest of it acts in the next sample
    velocity, position = ((new + (old - new) * back) / m for new, old in ((v_new, v), (x_new, x)))
    acting, forward = back**whole, -np.expm1(-1j * omega * T)  # z^-whole, 1 - 1/z
    G_v = acting * back * velocity / (forward + back * -np.expm1(-rate * T))
    G_x = back * (v * G_v + acting * position) / forward
    return 1 / np.abs(1 + _column(case.K_v) * G_v + _column(case.K_p) * G_x)


def _samples(case: Case) -> tuple[Any, Any]:
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
    second = np.where(small, second, (y + np.expm1(-y)) / y**2)
    return t * first, t**2 * second


def spectral_radius(case: Case) -> Any:
    """Return the spectral radius of each sampled loop without a hand: one number, or shape (n,) for n cases."""
    return by_kind(case, lambda loops: np.abs(np.linalg.eigvals(loop_matrices(loops))).max(axis=1))


def by_kind(case: Case, evaluate: Callable[[Case], Floats]) -> Any:
    """Evaluate a function of loops without a hand and a coupling, on groups of loops with the same number of states."""
    names = ("mass", "damping", "delay", "K_v", "K_p")
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(getattr(case, name), float)) for name in names))
    loops: dict[str, Any] = dict(zip(names, arrays, strict=True))
    flat, results = replace(case, b_c=1.0, m_c=1.0, b_0=0.0, **loops), np.empty(arrays[0].size)
    kinds = np.stack((_samples(flat)[0], flat.K_p > 0))
    for kind in np.unique(kinds, axis=1).T:
        members = np.flatnonzero((kinds == kind[:, None]).all(axis=0))
        results[members] = evaluate(flat.at(members))
    return results if any(np.ndim(getattr(case, name)) for name in names) else float(results[0])


def loop_matrices(case: Case) -> Floats:
    """Return the matrices that advance v, x and the earlier commands by one sample, of shape (n, size, size)."""
    order, whole = 2 if case.K_p[0] > 0 else 1, int(_samples(case)[0][0])
    remainder, n = _samples(case)[1], len(case.K_v)
    (A, full_sample), (_, newest_effect) = (
        _motion(case, np.full(n, case.sample_time), order),
        _motion(case, case.sample_time - remainder, order),
    )
    size = order + whole + 1
    # rows: the force commanded now, the force commanded one sample ago, ...
    commands_from_state = np.zeros((n, whole + 2, size))
    commands_from_state[:, 0, :order] = -np.stack((case.K_v, case.K_p)[:order], axis=1)
    commands_from_state[:, 1:, order:] = np.eye(whole + 1)
    loops = np.zeros((n, size, size))
    loops[:, :order, :order] = A
    loops[:, :order] += newest_effect[:, :, None] * commands_from_state[:, None, whole]
    loops[:, :order] += (full_sample - newest_effect)[:, :, None] * commands_from_state[:, None, whole + 1]
    loops[:, order:] = commands_from_state[:, : whole + 1]
    return loops


def _motion(case: Case, t: Floats, order: int) -> tuple[Floats, Floats]:
    """Return the matrix of the motion over a time t, and the effect of a constant unit force: shapes (n, order, order)
    and (n, order)."""
    rates = np.zeros((len(t), order + 1, order + 1))
    rates[:, 0, 0], rates[:, 0, order], rates[:, 1:order, 0] = -case.damping / case.mass, 1 / case.mass, 1.0
    whole = expm(rates * t[:, None, None])
    return whole[:, :order, :order], whole[:, :order, order]


def error(problem: Problem, case: Case, points: int = POINTS) -> Any:
    """Return the transparency error of each case on a dense grid (model/README.md, section 8)."""
    band = problem.transparency.band
    square = squared_error(problem, case, np.geomspace(band.min, band.max, points))
    if problem.transparency.norm == "peak":
        return np.sqrt(square.max(axis=-1))
    return np.sqrt(simpson(square, dx=1 / (points - 1), axis=-1))


def squared_error(problem: Problem, case: Case, omega: Any) -> Any:
    """Return the square of the transparency error at frequencies (paper eq. 21), without the least operator."""
    objective, (Z_d, C) = problem.transparency, impedances(case, 1j * omega)
    D, Z_0, weights = Z_d + C, objective.reference_impedance, objective.weights
    square = (weights.admittance * Z_0 / np.abs(D)) ** 2 + (weights.tracking * np.abs(Z_d / D)) ** 2
    return square + (weights.coupling * np.abs(coupling_impedance(case, 1j * omega)) / Z_0) ** 2


def violation(problem: Problem, case: Case, extra: Sequence[float] = ()) -> float:
    """Return the logarithm of one case's greatest violation of the constraints on Re Z_c/R and |S|."""
    device, stability, nyquist = problem.device, problem.stability, pi / problem.device.sample_time
    middle = [problem.transparency.band.min, problem.transparency.band.max, nyquist]
    low = stability.band.min or ENDLESS * min(middle)
    high = stability.band.max if stability.band.max < inf else max(middle) / ENDLESS
    extra_finite = np.array([w for w in extra if 0 < w < inf])
    inside = extra_finite[(extra_finite >= low) & (extra_finite <= high)]
    ratio = float(stability_ratio(case, np.concatenate((np.geomspace(low, high, POINTS), inside))).min())
    resistance_violation = stability.safety_factor / ratio if ratio > 0 else inf
    # |S| peaks near the resonance of mass and K_p, for which two grids within a factor of 4 are added
    ringing = min(float(np.sqrt(case.K_p / device.mass)), nyquist) or nyquist
    lowest = min(1e-4 * nyquist, 0.1 * ringing, problem.transparency.band.min, low)
    near_resonance = (
        ringing * np.geomspace(0.25, 1.0, POINTS),
        np.minimum(ringing * np.geomspace(1.0, 4.0, POINTS), nyquist),
    )
    omega = np.concatenate(
        (np.geomspace(lowest, nyquist, POINTS), *near_resonance, extra_finite[extra_finite <= nyquist])
    )
    sensitivity_violation = float(sensitivity(case, omega).max()) / stability.max_sensitivity
    return float(np.log(max(resistance_violation, sensitivity_violation, 1.0)))
