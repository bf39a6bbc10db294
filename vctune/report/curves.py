"""The curves behind the figures, from a problem and a design (paper eqs. 10, 11, 17; model/README.md, sections 2 to 8,
14 and 15)."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from math import inf, pi, sqrt

import numpy as np

from vctune.analysis.demands import error_terms, ratio_minima, response, weighted_square
from vctune.analysis.extrema import Floats, round_at_resonance
from vctune.analysis.felt_impedance import impedance_felt
from vctune.analysis.in_hands import least_ratios_in_any_hand, least_ratios_in_hands
from vctune.analysis.requirement import Requirement, in_any_hand, in_hands, on_band
from vctune.design.prepared import pose
from vctune.model.gains import AnyCoupling, Coupling, Gains, series_coupling
from vctune.model.hands import Hands
from vctune.model.numbers.units import hertz
from vctune.model.problem import Band, Problem
from vctune.model.worlds import World
from vctune.proof.claims.band import PASSIVE
from vctune.proof.claims.claim import ClaimId

POINTS = 400  # Number of frequencies of a curve without a resonance
PER_DECADE = 40  # Number of frequencies per decade of a curve of the sampled loop
WORST = 3  # Number of hands with a curve of their own
UNMOVED = 1e-6  # Share of a command below which a servo counts as at rest, for example at Nyquist with interpolation
SPRING, DAMPER = 200.0, 14.0  # The two environments of the paper (section 5) on a linear device, N/m and N s/m


def no_coupling(problem: Problem) -> Coupling:
    """Return a coupling that is practically absent, without drag."""
    Z_0 = 1e-18 * problem.transparency.reference_impedance
    return Coupling(Z_0, Z_0 * problem.device.sample_time, 0.0)


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
    min_ratio: float | None  # least ratio of the two curves, its frequency, Hz, and its hand in words
    worst_hz: float | None
    where: str = ""
    band: Band | None = None  # band of the claim, rad/s; None for every frequency up to Nyquist


def requirements(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[Required]:
    """Return the requirement of each claim of a problem that compares the coupling with a resistance."""
    device, posed, found = problem.device, pose(problem), list[Required]()
    # a wall, and a handle with nothing behind it, have a limit: nothing is offered to an environment
    if problem.rigid or (problem.worlds is not None and problem.worlds.nothing):
        return found
    devices = [device, *(case.device for case in posed.hand_cases if case.device != device)]
    if (hands := problem.hands_met) is not None:
        minima = [least_ratios_in_hands(each, hands, gains, coupling) for each in devices]
        shown = {each.hand.in_words(problem.units): Hands(each.hand, each.hand) for each in minima[0]}
        alone = {f"R in {name}": in_hands(device, shown[name], gains, PER_DECADE) for name in list(shown)[:WORST]}
        stated = [in_hands(each, hands, gains, PER_DECADE) for each in devices]
        least = min((each[0] for each in minima), key=lambda minimum: minimum.ratio)
        curves = _curves(problem, coupling, stated, alone, least.ratio, least.omega)
        found.append(replace(curves, where=least.hand.in_words(problem.units)))
    if problem.any_hand:
        stated = [in_any_hand(each, gains, PER_DECADE) for each in devices]
        every = [least_ratios_in_any_hand(each, gains, coupling)[0] for each in devices]
        lowest = min(every, key=lambda minimum: minimum.ratio)
        found.append(_curves(problem, coupling, stated, {}, lowest.ratio, lowest.omega))
    if problem.passive:
        omega, cases = 2 * pi * frequencies(problem), posed.cases
        stated = [on_band(case.device, gains, omega) for case in cases]
        alone = {"R of the stated device": stated[0]} if len(cases) > 1 else {}
        if device.operator is not None:
            alone["R without operator"] = on_band(device.bare, gains, omega)
        each_least = [ratio_minima(case, gains, series_coupling(coupling)) for case in cases]
        ratio, at = min((float(each.value[0]), float(each.omega[0])) for each in each_least)
        curves = _curves(problem, coupling, stated, alone, ratio, at)
        found.append(replace(curves, band=problem.stability.band))
    return found


def _curves(
    problem: Problem, coupling: AnyCoupling, of: list[Requirement], others: dict[str, Requirement], least: float,
    at: float,
) -> Required:  # fmt: skip
    """Return the curves of a claim for the devices of a problem, the stated one first; its least ratio is at `at`,
    rad/s."""
    first, kind = of[0], problem.device.kind
    places = first.places[first.places > 0]
    # the curves of an impedance display are divided by sin^2(theta/2)
    scale = np.sin(places / 2) ** 2 if kind.inverse else 1.0

    def shown(each: Requirement) -> Floats:
        R = scale * np.interp(places, each.places, each.required[0])
        return np.where(R > 0, R, np.nan)

    return Required(
        claim=first.claim,
        name=f"Re {kind.couples}",
        unit=kind.coupling_unit(problem.units),
        hz=places / (2 * pi * (1.0 if first.claim == PASSIVE.id else problem.device.sample_time)),
        offered=scale * replace(first, places=places).offered(coupling) + 0 * places,
        required=np.fmax.reduce([shown(each) for each in of]),
        others={name: shown(each) for name, each in others.items()},
        min_ratio=least if abs(least) < inf else None,
        worst_hz=hertz(at) if max(abs(least), at) < inf else None,
    )


def frequencies(problem: Problem) -> Floats:
    """Return the frequencies of the curves of the frequency model, Hz."""
    bands = (problem.transparency.band, problem.stability.band)
    low = min(band.min for band in bands if band.min > 0)
    high = max(band.max for band in bands if np.isfinite(band.max))
    omega = np.geomspace(low / 10, min(high * 10, problem.nyquist * (1 - 1e-9)), POINTS)
    return round_at_resonance(problem.device, omega / (2 * pi))


def transparency(problem: Problem, gains: Gains, coupling: AnyCoupling) -> tuple[Floats, dict[str, Floats]]:
    """Return frequencies, Hz, the three terms of the error and the error: the root of the weighted sum of their
    squares."""
    hz = frequencies(problem)
    squares = error_terms(problem, gains, coupling, 2 * pi * hz)
    each = (*astuple(squares), weighted_square(problem.weights, squares))
    names = ("admittance", "tracking", "coupling", "error")
    return hz, {name: np.sqrt(square) + 0 * hz for name, square in zip(names, each, strict=True)}


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
    environments = {
        "free": World(0.0, 0.0, 0.0),
        f"{damper:.3g} {units.damping}": World(0.0, damper, 0.0),
        f"{spring:.3g} {units.stiffness}": World(0.0, 0.0, spring),
        "rigid": None,
    }
    if problem.worlds is not None and problem.worlds.nothing:  # it renders no environment
        environments = {"free": World(0.0, 0.0, 0.0)}
    if problem.rigid:
        environments = {"free": World(0.0, 0.0, 0.0), "rigid": None}
    moves = np.ones(hz.size, bool)
    if device.servo is not None:  # with a rigid environment a servo is at rest
        environments.pop("rigid", None)
        C = response(device, gains, omega).C_scaled
        moves = np.hypot(C.re, C.im) > UNMOVED
    felt = {}
    for name, world in environments.items():
        impedance = np.abs(impedance_felt(device, gains, coupling, omega, world))
        ideal = np.full(hz.size, np.inf)
        if world is not None:
            ideal = np.abs(world.damping + world.stiffness / s)
        felt[name] = np.where(moves, impedance, np.nan), ideal
    return hz, felt
