"""The curves behind the figures, from a problem and a design (paper eqs. 10, 11, 17; model/README.md, sections 2 to 8,
14 and 15)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from math import inf, pi, sqrt

import numpy as np

from vctune.analysis.demands import error_terms, ratio_minima, response, weighted_square
from vctune.analysis.extrema import Floats
from vctune.analysis.feel import felt_impedance
from vctune.analysis.in_hands import least_ratios_in_any_hand, least_ratios_in_hands
from vctune.analysis.loops_in_hands import loops_in_any_hand, loops_in_hands
from vctune.analysis.resonance import round_at_resonance
from vctune.analysis.sampled_loop import Complex
from vctune.design.prepared import pose
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, coupling_impedance, series_coupling
from vctune.model.hands import Hand, Hands
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import hertz
from vctune.model.problem import Band, Problem
from vctune.model.sampled.hand_loop import offered
from vctune.proof.claims.registry import ClaimId

POINTS = 400  # Number of frequencies of a curve without a resonance
PER_DECADE = 40  # Number of frequencies per decade of a curve of the sampled loop
WORST = 3  # Number of hands with a curve of their own
UNMOVED = 1e-6  # Share of a command below which a servo counts as at rest, for example at Nyquist with interpolation
NOTHING = Coupling(1e-18, 1e-18, 0.0)  # A coupling that is practically absent, without drag
SPRING, DAMPER = 200.0, 14.0  # The two environments of the paper (section 5) on a linear device, N/m and N s/m


@dataclass(frozen=True, slots=True)
class Requirement:
    """What one claim requires of the coupling, and what the coupling offers, over the frequency hz, Hz."""

    claim: ClaimId
    name: str  # of the offered curve, such as "Re Z_c"
    unit: str  # of both curves
    hz: Floats
    offered: Floats
    required: Floats  # worst hand and device at each frequency; nan where nothing positive is required
    others: dict[str, Floats]  # further requirements by name, each below `required` or without the least operator
    least: float | None  # least ratio of the two curves, its frequency, Hz, and its hand in words
    least_hz: float | None
    where: str = ""
    band: Band | None = None  # band of the claim, rad/s; None for every frequency up to Nyquist

    @property
    def ratio(self) -> Floats:
        """Offered / required."""
        return self.offered / self.required


def requirements(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[Requirement]:
    """Return the requirement of each claim of a problem that compares the coupling with a resistance."""
    found = []
    if (hands := problem.hands_met) is not None:
        found.append(_in_hands(problem, hands, gains, coupling))
    if problem.any_hand:
        found.append(_in_any_hand(problem, gains, coupling))
    if problem.passive:
        found.append(_on_band(problem, gains, coupling))
    return found


def _in_hands(problem: Problem, hands: Hands, gains: Gains, coupling: AnyCoupling) -> Requirement:
    device = problem.device

    def required(device: Device, hands: Hands = hands) -> tuple[Floats, Floats]:
        loops = loops_in_hands(device, hands, per_decade=PER_DECADE)
        return loops.theta[loops.theta > 0], loops.required(gains)[:, loops.theta > 0].max(axis=0)

    theta, stated = required(device)
    minima, shown = least_ratios_in_hands(device, hands, gains, coupling), list[Hand]()
    for each in minima:
        shown += [each.hand] if each.hand not in shown else []
    scale, others = _scale(device, theta), {}
    for hand in shown[:WORST]:
        others[f"R in {hand.in_words(problem.units)}"] = scale * _positive(required(device, Hands(hand, hand))[1])
    least = minima[0]
    return Requirement(
        "hands", *_named(problem), theta / (2 * pi * device.sample_time),
        scale * offered(coupling, device, theta, FLOATS),
        scale * _positive(_worst(problem, theta, stated, required)), others,
        *_finite(least.ratio, least.omega), least.hand.in_words(problem.units),
    )  # fmt: skip


def _in_any_hand(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Requirement:
    device = problem.device

    def required(device: Device) -> tuple[Floats, Floats]:
        loops = loops_in_any_hand(device, PER_DECADE)
        return loops.theta[loops.theta > 0], loops.required(gains)[0, loops.theta > 0]

    theta, stated = required(device)
    scale = _scale(device, theta)
    least = least_ratios_in_any_hand(device, gains, coupling)[0]
    return Requirement(
        "any_hand", *_named(problem), theta / (2 * pi * device.sample_time),
        scale * offered(coupling, device, theta, FLOATS),
        scale * _positive(_worst(problem, theta, stated, required)), {},
        *_finite(least.ratio, least.omega),
    )  # fmt: skip


def _worst(
    problem: Problem, theta: Floats, stated: Floats, required: Callable[[Device], tuple[Floats, Floats]]
) -> Floats:
    """Return the greatest R of the devices of an uncertain problem, at the angles of the stated device."""
    others = [required(case.device) for case in pose(problem).hand_cases if case.device != problem.device]
    return np.fmax.reduce([stated, *(np.interp(theta, *curve) for curve in others)])


def _on_band(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Requirement:
    """Return the requirement of any passive hand on the stability band, in the frequency model."""
    hz, virtual = frequencies(problem), series_coupling(coupling)
    cases = pose(problem).cases
    curves = [_required(case, gains, hz) for case in cases]
    others = {"R of the stated device": curves[0]} if len(cases) > 1 else {}
    if problem.device.operator is not None:
        others["R without operator"] = _required(replace(problem, device=problem.device.bare), gains, hz)
    minima = [ratio_minima(case, gains, virtual) for case in cases]
    least = min(minima, key=lambda each: float(each.value[0]))
    return Requirement(
        "passive", *_named(problem), hz, coupling_impedance(virtual, 2 * pi * hz).re + 0 * hz,
        np.fmax.reduce(curves), others, *_finite(float(least.value[0]), float(least.omega[0])),
        band=problem.stability.band,
    )  # fmt: skip


def _required(problem: Problem, gains: Gains, hz: Floats) -> Floats:
    loop = response(problem.device, gains, 2 * pi * hz)
    with np.errstate(all="ignore"):
        return _positive(np.where(loop.resistance > 0, required_resistance(loop, FLOATS), np.nan))


def _named(problem: Problem) -> tuple[str, str]:
    """Return name and unit of the offered curve."""
    kind = problem.device.kind
    return f"Re {kind.couples}", kind.coupling_unit(problem.units)


def _scale(device: Device, theta: Floats) -> Floats | float:
    """Return s^2 with s = sin(theta/2) for an impedance display, whose curves are divided by s^2; otherwise 1."""
    return np.sin(theta / 2) ** 2 if device.kind.inverse else 1.0


def _positive(required: Floats) -> Floats:
    return np.where(required > 0, required, np.nan)


def _finite(ratio: float, omega: float) -> tuple[float | None, float | None]:
    return (ratio, hertz(omega)) if abs(ratio) < inf else (None, None)


@dataclass(frozen=True, slots=True)
class Transparency:
    """|Z_0 G_hh|, |1 - G_he|, |Z_c|/Z_0 and the error e, as functions of the frequency hz, Hz."""

    hz: Floats
    admittance: Floats
    tracking: Floats
    coupling: Floats
    error: Floats


def frequencies(problem: Problem) -> Floats:
    """Return the frequencies of the curves of the frequency model, Hz."""
    bands = (problem.transparency.band, problem.stability.band)
    nyquist = problem.nyquist / (2 * pi)
    low = min(band.min for band in bands if band.min > 0) / (2 * pi)
    high = max(band.max for band in bands if np.isfinite(band.max)) / (2 * pi)
    hz = np.geomspace(low / 10, min(high * 10, nyquist * (1 - 1e-9)), POINTS)
    return round_at_resonance(problem.device, hz)


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
    moves = np.ones(hz.size, bool)
    if problem.device.servo is not None:  # with a rigid environment a servo is at rest
        del environments["rigid"]
        C = response(problem.device, gains, 2 * pi * hz).C_scaled
        moves = np.hypot(C.re, C.im) > UNMOVED
    felt = {}
    for name, Z_e in environments.items():
        impedance = felt_impedance(problem.device, gains, coupling, 2 * pi * hz, Z_e)
        ideal = np.full(hz.size, np.inf) if Z_e is None else np.abs(Z_e)
        felt[name] = np.where(moves, np.abs(impedance), np.nan), ideal
    return hz, felt
