"""Independent evaluations: mpmath at 50 digits and plain complex arithmetic, from DESIGN section 1, not from vctune."""

from __future__ import annotations

import cmath
from collections.abc import Callable
from dataclasses import dataclass

import mpmath as mp
import numpy as np
import scipy.linalg

DIGITS = 50


@dataclass(frozen=True)
class Case:
    """A device with its gains and its coupling, as plain numbers."""

    mass: float
    damping: float
    sample_time: float
    delay: float
    hold: str
    K_v: float
    K_p: float
    b_c: float = 1.0
    m_c: float = 1.0
    b_0: float = 0.0


def exact_required_resistance(case: Case, omega: float, digits: int = DIGITS) -> mp.mpf:
    """R = (|q| - Re q)/(2 Re G_hh) by its definition, with `digits` digits more than cancel."""
    with mp.workdps(digits + 60):
        Z_d, C = _exact_loop(case, omega)
        q, G_hh = C / (Z_d + C), 1 / (Z_d + C)
        return (abs(q) - mp.re(q)) / (2 * mp.re(G_hh))


def exact_ratio(case: Case, omega: float) -> mp.mpf:
    """Re Z_c / R."""
    with mp.workdps(DIGITS + 60):
        s = mp.mpc(0, omega)
        series = 1 / (1 / mp.mpf(repr(case.b_c)) + 1 / (mp.mpf(repr(case.m_c)) * s))
        return (mp.mpf(repr(case.b_0)) + mp.re(series)) / exact_required_resistance(case, omega)


def _exact_loop(case: Case, omega: float) -> tuple[mp.mpc, mp.mpc]:
    m, b, T, d, K_v, K_p = (
        mp.mpf(repr(float(x))) for x in (case.mass, case.damping, case.sample_time, case.delay, case.K_v, case.K_p)
    )
    s = mp.mpc(0, omega)
    hold = (1 - mp.exp(-s * T)) / (s * T) if case.hold == "zoh" else 2 / (2 + s * T)
    return m * s + b, (K_v + K_p / s) * hold * mp.exp(-s * d)


def loop(case: Case, s: complex) -> tuple[complex, complex]:
    """Z_d and C at a complex frequency, in doubles."""
    hold = (1 - cmath.exp(-s * case.sample_time)) / (s * case.sample_time)
    if case.hold == "lag":
        hold = 2 / (2 + s * case.sample_time)
    return case.mass * s + case.damping, (case.K_v + case.K_p / s) * hold * cmath.exp(-s * case.delay)


def coupling(case: Case, s: complex) -> complex:
    """Z_c at a complex frequency."""
    return case.b_0 + case.b_c * case.m_c * s / (case.b_c + case.m_c * s)


def sampled_radius(case: Case) -> float:
    """Spectral radius of the sampled loop from a state-space model with matrix exponentials."""
    T, whole = case.sample_time, int(np.floor(case.delay / case.sample_time + 1e-12))
    late = max(case.delay - whole * T, 0.0)
    late = 0.0 if late < 1e-12 * T else late
    order = 2 if case.K_p > 0 else 1
    A = np.array([[-case.damping / case.mass, 0.0], [1.0, 0.0]])[:order, :order]
    B = np.array([[1 / case.mass], [0.0]])[:order]

    def transition(t: float) -> tuple[np.ndarray, np.ndarray]:
        block = np.zeros((order + 1, order + 1))
        block[:order, :order], block[:order, order:] = A * t, B * t
        full = scipy.linalg.expm(block)
        return full[:order, :order], full[:order, order:]

    A_T, _ = transition(T)
    A_0, B_new = transition(T - late)
    _, B_part = transition(late)
    B_old = A_0 @ B_part
    size = order + whole + 1
    full = np.zeros((size, size))
    law = np.zeros(size)
    law[:order] = [-case.K_v, -case.K_p][:order]
    full[:order, :order] = A_T
    if whole == 0:
        full[:order] += B_new @ law[None, :]
        full[:order, order] += B_old[:, 0]
    else:
        full[:order, order + whole - 1] += B_new[:, 0]
        full[:order, order + whole] += B_old[:, 0]
    full[order] = law
    for k in range(1, whole + 1):
        full[order + k, order + k - 1] = 1.0
    return float(np.abs(np.linalg.eigvals(full)).max())


def sampled_sensitivity(m, b, T, delay, K_v, K_p, omega):
    """|S| = 1/|1 + K_v G_v + K_p G_x| of the sampled loop; everything broadcasts.

    The plant's motion in a part t of a sample under a unit force, by Taylor's series where the closed form cancels.
    """
    m, b, delay, K_v, K_p, omega = np.broadcast_arrays(*(np.asarray(x, float) for x in (m, b, delay, K_v, K_p, omega)))
    rate = b / m
    whole = np.floor(delay / T + 1e-12)
    late = np.maximum(delay - whole * T, 0.0)

    def faded(t):
        """The integral of e^(-rate s) over [0, t], and the integral of that."""
        x = rate * t
        small = x < 1e-2
        y = np.where(small, 1.0, x)
        first = np.where(small, 1 - x / 2 + x**2 / 6 - x**3 / 24 + x**4 / 120 - x**5 / 720, -np.expm1(-y) / y)
        second = np.where(
            small, 1 / 2 - x / 6 + x**2 / 24 - x**3 / 120 + x**4 / 720 - x**5 / 5040, (y + np.expm1(-y)) / y**2
        )
        return t * first, t**2 * second

    (v_all, x_all), (v_new, x_new) = faded(T), faded(T - late)
    one_over_z = np.exp(-1j * omega * T)
    acting = one_over_z**whole
    beta, gamma = ((new + (old - new) * one_over_z) / m for new, old in ((v_new, v_all), (x_new, x_all)))
    forward = -np.expm1(-1j * omega * T)  # 1 - 1/z
    decay = forward + one_over_z * -np.expm1(-rate * T)  # 1 - a/z
    G_v = acting * one_over_z * beta / decay
    with np.errstate(all="ignore"):
        G_x = np.where(K_p > 0, one_over_z * (v_all * G_v + acting * gamma) / forward, 0.0)
    return 1 / np.abs(1 + K_v * G_v + K_p * G_x)


def exact_sampled_sensitivity(case: Case, omega: float) -> mp.mpf:
    """|S| of the sampled loop as a quotient of determinants of state matrices, with 50 digits."""
    with mp.workdps(DIGITS + 20):
        T, m, b, d = (mp.mpf(repr(float(x))) for x in (case.sample_time, case.mass, case.damping, case.delay))
        whole = int(mp.floor(d / T))
        order = 2 if case.K_p > 0 else 1

        def over(t):
            full = mp.expm(mp.matrix([[-b / m, 0, 1 / m], [1, 0, 0], [0, 0, 0]]) * t)
            return full[:order, :order], full[:order, 2]

        (A, _), (rest, new), (_, old) = over(T), over(T - (d - whole * T)), over(d - whole * T)
        z = mp.expj(mp.mpf(omega) * T)
        arriving = z**-whole * new + z ** (-whole - 1) * (rest * old)
        response = mp.lu_solve(z * mp.eye(order) - A, arriving)
        law = [mp.mpf(repr(float(case.K_v))), mp.mpf(repr(float(case.K_p)))][:order]
        return 1 / abs(1 + sum(gain * x for gain, x in zip(law, response, strict=True)))


@dataclass(frozen=True)
class Demand:
    """A device and what is demanded of its designs; the band in rad/s. Designs are columns K_v, K_p, b_c, m_c, b_0."""

    mass: float
    damping: float
    sample_time: float
    delay: float
    hold: str
    band: tuple[float, float]
    safety_factor: float
    max_sensitivity: float

    @property
    def nyquist(self) -> float:
        return np.pi / self.sample_time


GRID, PLACES, ZOOMS = 500, 3, 6
ZOOM = np.linspace(0.0, 1.0, 13)
TOGETHER = 500
"""Designs judged at a time."""


def impedances(demand: Demand, K_v, K_p, s):
    """Z_d and C at complex frequencies."""
    sT = s * demand.sample_time
    hold = -np.expm1(-sT) / sT if demand.hold == "zoh" else 2 / (2 + sT)
    return demand.mass * s + demand.damping, (K_v + K_p / s) * hold * np.exp(-s * demand.delay)


def required(demand: Demand, K_v, K_p, omega):
    """R = (|q| - Re q)/(2 Re G_hh) where Re G_hh > 0, else inf: no coupling will do."""
    Z_d, C = impedances(demand, K_v, K_p, 1j * omega)
    q, S, G_hh = C / (Z_d + C), Z_d / (Z_d + C), 1 / (Z_d + C)
    excess = np.where(q.real > 0, S.imag**2 / (np.abs(q) + q.real), np.abs(q) - q.real)
    return np.where(G_hh.real > 0, excess / (2 * G_hh.real), np.inf)


def least(f: Callable, low: float, high: float, count: int):
    """Return the least value of f over [low, high] for each design: a grid's lowest places, each refined."""
    steps = max(GRID, int(100 * np.log10(high / low)))
    omega = np.union1d(np.geomspace(low, high, steps)[1:-1], np.linspace(low, high, GRID))
    values = np.broadcast_to(f(omega), (count, omega.size)).copy()
    best, rows = values.min(axis=1), np.arange(count)
    for _ in range(PLACES):
        at = values.argmin(axis=1)
        left, right = omega[np.maximum(at - 1, 0)], omega[np.minimum(at + 1, omega.size - 1)]
        for away in range(-3, 4):
            values[rows, np.clip(at + away, 0, omega.size - 1)] = np.inf
        for _ in range(ZOOMS):
            fine = left[:, None] + (right - left)[:, None] * ZOOM
            near = f(fine)
            k = near.argmin(axis=1)
            best = np.minimum(best, near[rows, k])
            left, right = fine[rows, np.maximum(k - 1, 0)], fine[rows, np.minimum(k + 1, ZOOM.size - 1)]
    return best


def conditions_surplus(demand: Demand, designs):
    """Least Re Z_c/(factor R) - 1 on the band, at most 1; -1 where Re G_hh <= 0."""
    K_v, K_p, b_c, m_c, b_0 = designs[:, :, None]

    def surplus(omega):
        needed = demand.safety_factor * required(demand, K_v, K_p, omega)
        return np.minimum((b_0 + 1 / (1 / b_c + 1 / (1j * omega * m_c))).real / needed - 1, 1.0)

    with np.errstate(divide="ignore"):
        return least(surplus, *demand.band, designs.shape[1])


def sensitivity_surplus(demand: Demand, designs):
    """1 - max |S|/limit of the sampled loop."""
    K_v, K_p = designs[:2, :, None]

    def surplus(omega):
        S = sampled_sensitivity(demand.mass, demand.damping, demand.sample_time, demand.delay, K_v, K_p, omega)
        return 1 - S / demand.max_sensitivity

    ringing = np.sqrt(designs[1, designs[1] > 0] / demand.mass)
    low = 0.1 * np.clip(ringing, demand.nyquist * 1e-8, demand.nyquist * 1e-3).min(initial=demand.nyquist * 1e-3)
    return least(surplus, low, demand.nyquist, designs.shape[1])


def _sampled_loops(demand: Demand, designs, expm: Callable):
    """State matrices of sampled loops, all with an integrator or all without: v, x, forces of the samples before."""
    T, whole = demand.sample_time, int(np.floor(demand.delay / demand.sample_time + 1e-12))
    late = demand.delay - whole * T
    late = late if late > 1e-12 * T else 0.0
    order = 2 if designs[1, 0] > 0 else 1
    size = order + whole + 1

    def over(t):
        full = expm(np.array([[-demand.damping, 0, 1], [demand.mass, 0, 0], [0, 0, 0]]) * (t / demand.mass))
        return full[:order, :order], full[:order, 2]

    (transition, _), (rest, new) = over(T), over(T - late)
    loops = np.zeros((designs.shape[1], size, size), transition.dtype)
    loops[:, :order, :order] = transition
    loops[:, :order, order + whole] = rest @ over(late)[1]
    loops[:, order, :order] = law = -designs[:order].T
    if whole:
        loops[:, :order, order + whole - 1] = new
    else:
        loops[:, :order, :order] += new[:, None] * law[:, None, :]
    for k in range(1, whole + 1):
        loops[:, order + k, order + k - 1] = 1
    return loops


MANY_STATES = 12


def sampled_surplus(demand: Demand, designs):
    """1 - spectral radius of each sampled loop, with 40 digits where it is next to 0.

    Loops of many states have too many for that: a real pole next to 1 is inside there, for F(1) > 0 with K_p > 0.
    """
    found = np.empty(designs.shape[1])
    for at in (np.flatnonzero(designs[1] == 0), np.flatnonzero(designs[1] > 0)):
        if len(at):
            loops = _sampled_loops(demand, designs[:, at], scipy.linalg.expm)
            poles = np.linalg.eigvals(loops)
            found[at] = 1 - np.abs(poles).max(axis=1)
            first = np.take_along_axis(poles, np.abs(poles).argmax(axis=1)[:, None], axis=1)[:, 0]
            creeping = (loops.shape[1] > MANY_STATES) & (np.abs(found[at]) < 1e-9) & (np.abs(first - 1) < 1e-6)
            found[at[creeping]] = 1e-9
    for i in np.flatnonzero(np.abs(found) < 1e-9):
        with mp.workdps(40):
            exact = _sampled_loops(demand, designs[:, [i]], lambda A: np.array(mp.expm(mp.matrix(A)).tolist()))
            found[i] = 1 - max(map(abs, mp.eig(mp.matrix(exact[0]), right=False)))
    return found


def unstable_poles(demand: Demand, K_v: float, K_p: float) -> float:
    """How many poles the frequency model has in the right half plane; nan where D comes too close to 0 to say.

    s D/(m (s + a)^2), or D/(m (s + a)) without K_p, is real at 0 and at infinity and turns by pi for each of them.
    """
    m, b = demand.mass, demand.damping
    a = max(K_v / m, np.sqrt(K_p / m), b / m)
    slow = [a, (K_v + b) / m, *([K_p / (K_v + b), np.sqrt(K_p / m)] if K_p > 0 else [])]
    even = np.linspace(0, 10 * a, 400 + int(10 * a * (demand.sample_time + demand.delay) / 0.02))[1:]
    s = 1j * np.union1d(np.geomspace(1e-3 * min(slow), 10 * a, 1500), even)
    D = sum(impedances(demand, K_v, K_p, s))
    turn = np.unwrap(np.angle(D / (s + a) * (s / (s + a) if K_p > 0 else 1)))
    number = 2 * np.round((turn[0] - turn[-1]) / (2 * np.pi))
    return number if np.abs(np.diff(turn)).max() < 2 else np.nan


def surpluses(demand: Demand, designs):
    """By how much each design meets each demand, > 0 where it does: conditions, |S|, sampled loop, model; (4, n)."""
    found = np.empty((4, designs.shape[1]))
    for i in range(0, designs.shape[1], TOGETHER):
        part = designs[:, i : i + TOGETHER]
        rows = [f(demand, part) for f in (conditions_surplus, sensitivity_surplus, sampled_surplus)]
        found[:3, i : i + TOGETHER] = rows
    found[3] = 1.0
    for i in np.flatnonzero((found[:3] > 0).all(axis=0)):
        found[3, i] = 0.5 - unstable_poles(demand, *designs[:2, i])
    return found


def best_damping(demand: Demand, designs, low: float, high: float):
    """The b_c in [low, high] with the greatest least ratio, by search: that is a quasiconcave function of log b_c."""
    found = np.empty(designs.shape[1])
    omega = np.geomspace(*demand.band, 300)
    for i in range(0, designs.shape[1], TOGETHER):
        K_v, K_p, _, m_c, b_0 = designs[:, i : i + TOGETHER, None]
        needed = required(demand, K_v, K_p, omega)
        left, right = np.full(len(K_v), np.log(low)), np.full(len(K_v), np.log(high))
        rows = np.arange(len(K_v))
        for _ in range(8):
            tried = left[:, None] + (right - left)[:, None] * ZOOM
            with np.errstate(divide="ignore"):
                scores = np.stack(
                    [
                        ((b_0 + 1 / (np.exp(-z)[:, None] + 1 / (1j * omega * m_c))).real / needed).min(axis=1)
                        for z in tried.T
                    ],
                    axis=1,
                )
            k = scores.argmax(axis=1)
            found[i : i + TOGETHER] = np.exp(tried[rows, k])
            left, right = tried[rows, np.maximum(k - 1, 0)], tried[rows, np.minimum(k + 1, ZOOM.size - 1)]
    return np.clip(found, low, high)
