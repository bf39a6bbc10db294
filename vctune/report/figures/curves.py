"""The curves behind the figures, from a problem and a design. See paper eqs. 10, 11, 17; model/README.md, sections 2 to
8."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import pi, sqrt

import numpy as np

from vctune.analysis.demands import error_terms, response, stability_ratio, weighted_square
from vctune.analysis.extrema import Floats
from vctune.analysis.feel import felt_impedance
from vctune.analysis.resonance import round_at_resonance
from vctune.analysis.sampled_loop import Complex
from vctune.model.coupling import coupling_impedance
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem

POINTS = 400  # Number of frequencies of a curve without a resonance
UNMOVED = 1e-6  # Share of a command below which a servo counts as at rest, for example at Nyquist with interpolation
SPRING, DAMPER = 200.0, 14.0  # The two environments of the paper (section 5) on a linear device, N/m and N s/m


@dataclass(frozen=True, slots=True)
class Llewellyn:
    """Re Z_c, the required R and their ratio for an admittance display, as functions of the frequency hz, Hz."""

    hz: Floats
    coupling: Floats
    required: Floats
    ratio: Floats


@dataclass(frozen=True, slots=True)
class Transparency:
    """|Z_0 G_hh|, |1 - G_he|, |Z_c|/Z_0 and the error e, as functions of the frequency hz, Hz."""

    hz: Floats
    admittance: Floats
    tracking: Floats
    coupling: Floats
    error: Floats


def frequencies(problem: Problem) -> Floats:
    """Return the frequencies of the page's curves, Hz."""
    bands = (problem.transparency.band, problem.stability.band)
    nyquist = problem.nyquist / (2 * pi)
    low = min(band.min for band in bands if band.min > 0) / (2 * pi)
    high = max(band.max for band in bands if np.isfinite(band.max)) / (2 * pi)
    hz = np.geomspace(low / 10, min(high * 10, nyquist * (1 - 1e-9)), POINTS)
    return round_at_resonance(problem.device, hz)


def llewellyn(problem: Problem, gains: Gains, coupling: Coupling) -> Llewellyn:
    """Return Re Z_c, R and their ratio."""
    hz = frequencies(problem)
    omega = 2 * pi * hz
    loop = response(problem.device, gains, omega)
    with np.errstate(all="ignore"):
        required = np.where(loop.resistance > 0, required_resistance(loop, FLOATS), np.nan)
        ratio = stability_ratio(problem.device, gains, coupling, omega)
    return Llewellyn(
        hz, coupling_impedance(coupling, omega).re + 0 * omega, required, np.where(loop.resistance > 0, ratio, np.nan)
    )


def transparency(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Transparency:
    """Return the three terms of the error, and the error: the root of the weighted sum of their squares."""
    hz = frequencies(problem)
    omega = 2 * pi * hz
    squares = error_terms(problem, gains, coupling, omega)
    error = np.sqrt(weighted_square(problem.transparency.weights, squares)) + 0 * omega
    admittance, tracking, share = (np.sqrt(part) + 0 * omega for part in astuple(squares))
    return Transparency(hz, admittance, tracking, share, error)


def handle_impedance(
    problem: Problem, gains: Gains, coupling: AnyCoupling
) -> tuple[Floats, dict[str, tuple[Floats, Floats]]]:
    """Return frequencies and the impedance at the handle for several environments, with the ideal impedance of each."""
    hz = frequencies(problem)
    s = np.asarray(2j * pi * hz, np.complex128)
    units, damper, spring = problem.units, DAMPER, SPRING
    if problem.device.units == "rotary":
        wanted = problem.transparency
        damper = wanted.reference_impedance
        spring = damper * sqrt(wanted.band.min * wanted.band.max)
    environments: dict[str, Complex | None] = {
        "free": 0 * s,
        f"{damper:.3g} {units.damping}": damper + 0 * s,
        f"{spring:.3g} {units.stiffness}": spring / s,
        "rigid": None,
    }
    if problem.device.servo is not None:  # with a rigid environment a servo is at rest
        del environments["rigid"]
    felt, moves = {}, np.ones(hz.size, bool)
    if problem.device.servo is not None:
        C = response(problem.device, gains, 2 * pi * hz).C_scaled
        moves = np.hypot(C.re, C.im) > UNMOVED
    for name, Z_e in environments.items():
        impedance = felt_impedance(problem.device, gains, coupling, 2 * pi * hz, Z_e)
        felt[name] = (
            np.where(moves, np.abs(impedance), np.nan),
            np.full(hz.size, np.inf) if Z_e is None else np.abs(Z_e),
        )
    return hz, felt
