"""The oracles on dense grids: least ratio, greatest |S|, and how many poles of the frequency model are unstable."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, pi
from typing import Any

import numpy as np
from device_arithmetic import DIGITS, DOUBLES
from device_oracle import (
    Coupling,
    Gains,
    Real,
    coupling_impedance,
    low_pass,
    mechanism,
    operator_impedance,
    response_at,
    velocity_estimate,
)
from device_oracle import hold as hold_of
from firmware import spectral_radius
from sampled_device_oracle import LET_GO, Hand, pulses

GRID = 3000
"""Frequencies of a scan; each local extremum is then refined."""
AROUND = 400
"""More frequencies within a factor 2 of a structure's resonances, whose damping ratios are above 0.005 in the tests."""
REFINED = 6
"""How many of the local extrema are refined."""
GOLDEN = (5**0.5 - 1) / 2
STEPS = 45
"""Of golden sections: down to 1e-9 of two grid steps."""


def resonances(real: Real) -> list[float]:
    """Return where a structure resonates: free, with its motor held and with its handle held, rad/s."""
    if real.structure is None:
        return []
    free, share = 2 * pi * real.structure.frequency_hz, real.structure.handle_mass / real.mass
    return [free, free * (1 - share) ** 0.5, free * share**0.5]


def frequencies(real: Real, low: float, high: float) -> np.ndarray:
    """Return a grid between two frequencies, rad/s, denser around resonances."""
    grids = [np.geomspace(low, high, GRID), *(w * np.geomspace(0.5, 2, AROUND) for w in resonances(real))]
    grid = np.unique(np.concatenate(grids))
    return grid[(grid >= low) & (grid <= high)]


def required(real: Real, gains: Gains, omega: Any) -> tuple[Any, Any]:
    """Return R without its cancellation, and Re G_hh in the operator's hand, in doubles at frequencies in rad/s."""
    s = 1j * np.asarray(omega)
    with np.errstate(all="ignore"):
        found = response_at(real, gains, s, DOUBLES)
        Z_h = operator_impedance(real, s, DOUBLES)
        A_h = 1 + Z_h * found.G_hh
        q, resistance = found.q, (found.G_hh / A_h).real
        excess = np.where(q.real > 0, q.imag**2 / (np.abs(q) + np.abs(q.real)), np.abs(q) - q.real)
        relief = (low_pass(real.force_sensor, s, DOUBLES) * Z_h * found.G_he / A_h).real
        return excess / (2 * resistance) - relief, resistance


def ratio(real: Real, gains: Gains, coupling: Coupling, omega: Any) -> Any:
    """Return Re Z_c/R in doubles, inf where R <= 0, -inf where the resistance is not positive."""
    R, resistance = required(real, gains, omega)
    offered = coupling_impedance(coupling, 1j * np.asarray(omega), DOUBLES).real
    with np.errstate(all="ignore"):
        return np.where(resistance > 0, np.where(R > 0, offered / R, inf), -inf)


def exact(real: Real, gains: Gains, coupling: Coupling, omega: Any) -> tuple[Any, Any]:
    """Return Re Z_c/R and Re G_hh in the operator's hand, with 50 digits; the ratio is inf where R <= 0."""
    s = DIGITS.i * DIGITS.number(omega)
    found, offered = response_at(real, gains, s), coupling_impedance(coupling, s).real
    resistance = (found.G_hh / (1 + operator_impedance(real, s) * found.G_hh)).real
    return (offered / found.required if found.required > 0 else DIGITS.context.inf), resistance


def least(f: Callable[[Any], Any], grid: np.ndarray) -> tuple[float, float]:
    """Return the least value of a function over a grid's span, and where, each of its lowest minima refined."""
    values = f(grid)
    inner = np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] <= values[2:])) + 1
    candidates = [0, len(grid) - 1, *inner[np.argsort(values[inner])][:REFINED]]
    return min(_refined(f, grid, values, index) for index in candidates)


def _refined(f: Callable[[Any], Any], grid: np.ndarray, values: np.ndarray, index: int) -> tuple[float, float]:
    if index in (0, len(grid) - 1) or not np.isfinite(values[index]):
        return float(values[index]), float(grid[index])
    a, b = float(grid[index - 1]), float(grid[index + 1])
    x, y = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_x, at_y = float(f(x)), float(f(y))
    for _ in range(STEPS):
        if at_x < at_y:
            b, y, at_y = y, x, at_x
            x = b - GOLDEN * (b - a)
            at_x = float(f(x))
        else:
            a, x, at_x = x, y, at_y
            y = a + GOLDEN * (b - a)
            at_y = float(f(y))
    return (at_x, x) if at_x < at_y else (at_y, y)


def sensitivity(real: Real, gains: Gains, omega: Any, num: Any = DOUBLES) -> Any:
    """Return |S| of the sampled loop let go, at a frequency in rad/s."""
    z = num.exp(num.i * num.number(omega) * num.number(real.sample_time))
    G_x, G_v, _ = pulses(real, LET_GO, z, num)
    return 1 / abs(1 + num.number(gains.velocity) * G_v + num.number(gains.position) * G_x)


def peak(real: Real, gains: Gains, count: int = 300) -> tuple[float, float]:
    """Return the greatest |S| of the sampled loop and where, rad/s."""
    nyquist = pi / real.sample_time
    grids = [np.linspace(nyquist / count, nyquist, count), np.geomspace(1e-3 * nyquist, nyquist, count)]
    grids += [w * np.geomspace(0.7, 1.4, 100) for w in resonances(real)]
    grid = np.unique(np.concatenate(grids))
    grid = grid[grid <= nyquist]

    def lower(omega: Any) -> Any:
        values = [-sensitivity(real, gains, w) for w in np.atleast_1d(omega).tolist()]
        return np.array(values) if np.ndim(omega) else values[0]

    value, where = least(lower, grid)
    return -value, where


def unstable_model_poles(real: Real, gains: Gains, *, held: bool) -> float:
    """Return how many zeros Delta has in the right half plane, by its turns along the imaginary axis.

    Delta = 1 + P_mu C_f has no pole to the right and tends to 1; a line just right of the axis passes what lies on it.
    """
    T = real.sample_time
    grids = [np.geomspace(1e-13, 1e5, 20_000) / T, *(w * np.geomspace(0.5, 2, 4000) for w in resonances(real))]
    s = 1e-10 / T + 1j * np.unique(np.concatenate(grids))
    push = low_pass(real.actuator, s, DOUBLES) * hold_of(real, s, DOUBLES)
    C_f = push * (gains.velocity * velocity_estimate(real, s, DOUBLES) + gains.position / s)
    P_hh, P_hu, P_mh, P_mu = mechanism(real, s, DOUBLES)
    if held:
        Z_h = operator_impedance(real, s, DOUBLES)
        P_mu = P_mu - P_mh * Z_h * P_hu / (1 + Z_h * P_hh)
    phase = np.unwrap(np.angle(1 + P_mu * C_f))
    return float(-(phase[-1] - phase[0]) / pi)


def sampled_radius(real: Real, gains: Gains, *, held: bool) -> float:
    """Return the spectral radius of the sampled loop, let go or in the least operator's hand, in doubles."""
    hand = Hand(real.operator_mass, real.operator_damping) if held else LET_GO
    return float(spectral_radius(real, gains, hand, DOUBLES))
