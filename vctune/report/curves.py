"""The curves behind the figures, from a problem and a design (paper eqs. 10, 11, 17; model/README.md, sections 2 to 8,
14 and 15)."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from math import inf, pi, sqrt

import numpy as np

from vctune.analysis.demands import error_terms, ratio_minima, response, weighted_square
from vctune.analysis.extrema import Floats
from vctune.analysis.feel import felt_impedance
from vctune.analysis.in_hands import least_ratios_in_any_hand, least_ratios_in_hands
from vctune.analysis.requirement import Requirement, in_any_hand, in_hands, on_band
from vctune.analysis.resonance import round_at_resonance
from vctune.analysis.sampled_loop import Complex
from vctune.design.prepared import pose
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, series_coupling
from vctune.model.hands import Hands
from vctune.model.numbers.units import hertz
from vctune.model.problem import Band, Problem
from vctune.proof.claims.registry import ClaimId

POINTS = 400  # Number of frequencies of a curve without a resonance
PER_DECADE = 40  # Number of frequencies per decade of a curve of the sampled loop
WORST = 3  # Number of hands with a curve of their own
UNMOVED = 1e-6  # Share of a command below which a servo counts as at rest, for example at Nyquist with interpolation
NOTHING = Coupling(1e-18, 1e-18, 0.0)  # A coupling that is practically absent, without drag
SPRING, DAMPER = 200.0, 14.0  # The two environments of the paper (section 5) on a linear device, N/m and N s/m


@dataclass(frozen=True, slots=True)
class Required:
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


def requirements(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[Required]:
    """Return the requirement of each claim of a problem that compares the coupling with a resistance."""
    device, found = problem.device, []
    if (hands := problem.hands_met) is not None:
        of_hands, devices = hands, [device, *_others(problem)]
        minima = least_ratios_in_hands(device, hands, gains, coupling)
        shown = list(dict.fromkeys(each.hand for each in minima))[:WORST]
        alone = {
            f"R in {hand.in_words(problem.units)}": in_hands(device, Hands(hand, hand), gains, PER_DECADE)
            for hand in shown
        }
        stated = [in_hands(each, of_hands, gains, PER_DECADE) for each in devices]
        curves = _curves(problem, coupling, stated, alone, minima[0].ratio, minima[0].omega)
        found.append(replace(curves, where=minima[0].hand.in_words(problem.units)))
    if problem.any_hand:
        stated = [in_any_hand(each, gains, PER_DECADE) for each in [device, *_others(problem)]]
        first = least_ratios_in_any_hand(device, gains, coupling)[0]
        found.append(_curves(problem, coupling, stated, {}, first.ratio, first.omega))
    if problem.passive:
        omega, cases = 2 * pi * frequencies(problem), pose(problem).cases
        stated = [on_band(case.device, gains, omega) for case in cases]
        alone = {"R of the stated device": stated[0]} if len(cases) > 1 else {}
        if device.operator is not None:
            alone["R without operator"] = on_band(device.bare, gains, omega)
        each_least = [ratio_minima(case, gains, series_coupling(coupling)) for case in cases]
        ratio, at = min((float(each.value[0]), float(each.omega[0])) for each in each_least)
        curves = _curves(problem, coupling, stated, alone, ratio, at)
        found.append(replace(curves, band=problem.stability.band))
    return found


def _others(problem: Problem) -> list[Device]:
    return [case.device for case in pose(problem).hand_cases if case.device != problem.device]


def _curves(
    problem: Problem,
    coupling: AnyCoupling,
    of: list[Requirement],
    others: dict[str, Requirement],
    least: float,
    at: float,
) -> Required:
    """Return the curves of a claim for the devices of a problem, the stated one first; its least ratio is at `at`,
    rad/s."""
    first, kind = of[0], problem.device.kind
    places = first.places[first.places > 0]
    # the curves of an impedance display are divided by sin^2(theta/2)
    scale = np.sin(places / 2) ** 2 if kind.inverse else 1.0

    def shown(each: Requirement) -> Floats:
        R = scale * np.interp(places, each.places, each.required[0])
        return np.where(R > 0, R, np.nan)

    known = (least, hertz(at)) if abs(least) < inf else (None, None)
    turn = 2 * pi * (1.0 if first.claim == "passive" else problem.device.sample_time)
    offered = scale * replace(first, places=places).offered(coupling) + 0 * places
    names, alone = (f"Re {kind.couples}", kind.coupling_unit(problem.units)), {n: shown(e) for n, e in others.items()}
    required = np.fmax.reduce([shown(each) for each in of])
    return Required(first.claim, *names, places / turn, offered, required, alone, *known)


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
    low = min(band.min for band in bands if band.min > 0)
    high = max(band.max for band in bands if np.isfinite(band.max))
    omega = np.geomspace(low / 10, min(high * 10, problem.nyquist * (1 - 1e-9)), POINTS)
    return round_at_resonance(problem.device, omega / (2 * pi))


def transparency(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Transparency:
    """Return the three terms of the error, and the error: the root of the weighted sum of their squares."""
    hz = frequencies(problem)
    squares = error_terms(problem, gains, coupling, 2 * pi * hz)
    error = weighted_square(problem.transparency.weights, squares)
    return Transparency(hz, *(np.sqrt(each) + 0 * hz for each in (*astuple(squares), error)))


def handle_impedance(
    problem: Problem, gains: Gains, coupling: AnyCoupling
) -> tuple[Floats, dict[str, tuple[Floats, Floats]]]:
    """Return frequencies and the impedance at the handle for several environments, with the ideal impedance of each."""
    hz, device, wanted = frequencies(problem), problem.device, problem.transparency
    omega, units, damper, spring = 2 * pi * hz, problem.units, DAMPER, SPRING
    s = np.asarray(1j * omega, np.complex128)
    if device.units == "rotary":
        damper = wanted.reference_impedance
        spring = damper * sqrt(wanted.band.min * wanted.band.max)
    environments: dict[str, Complex | None] = {
        "free": 0 * s,
        f"{damper:.3g} {units.damping}": damper + 0 * s,
        f"{spring:.3g} {units.stiffness}": spring / s,
        "rigid": None,
    }
    moves = np.ones(hz.size, bool)
    if device.servo is not None:  # with a rigid environment a servo is at rest
        del environments["rigid"]
        C = response(device, gains, omega).C_scaled
        moves = np.hypot(C.re, C.im) > UNMOVED
    felt = {}
    for name, Z_e in environments.items():
        impedance = np.abs(felt_impedance(device, gains, coupling, omega, Z_e))
        ideal = np.full(hz.size, np.inf) if Z_e is None else np.abs(Z_e)
        felt[name] = np.where(moves, impedance, np.nan), ideal
    return hz, felt
