"""Explain why a problem has no design: the constraint that the nearest miss violates, and its frequency and hand."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import inf, pi

import numpy as np

from vctune.analysis.demands import demand_grid, ratio_minima, response, sampled_span, sensitivity_maxima
from vctune.analysis.extrema import local_minima
from vctune.analysis.in_hands import least_ratios
from vctune.analysis.sampled_loop import spectral_radius
from vctune.design.prepared import Prepared
from vctune.design.search.scan import ScanResult
from vctune.design.variables import design_of, point
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.keys import QUANTITIES
from vctune.model.numbers.units import UNITS
from vctune.model.problem import Problem
from vctune.model.servo import LATENCY_PARTS, latency

# Beginning of the reason
OPENINGS = {True: "there is no admissible design", False: "no admissible design was found, nor proved impossible"}

CUT_SHORT = "the time limit ended the search before it had found a design"

NEXT_TO_NOTHING = 1e-9  # Ratio Re Z_c / R below which the message calls Re Z_c "next to 0", as at 0 Hz without drag


@dataclass(frozen=True, slots=True)
class Infeasibility:
    """The reason why there is no feasible design."""

    cause: str  # violated constraint, with its place and amount
    advice: str  # possible repair
    proved: bool  # True if a theorem, or a search that pruned every box of designs, proves that there is no design

    @property
    def reason(self) -> str:
        """The cause and the advice."""
        return f"{self.cause}; {self.advice}"


def out_of_time_before_a_design() -> Infeasibility:
    """Return the reason why there is no design if the time limit ended the search."""
    return Infeasibility(CUT_SHORT, "allow more time", proved=False)


def nearest_miss(prepared: Prepared, scanned: ScanResult, *, proved: bool) -> Infeasibility:
    """Describe the constraint that the nearest miss violates."""
    opening = OPENINGS[proved]
    if not scanned.starts:
        return Infeasibility(opening, "widen the bounds", proved)
    start = scanned.starts[0]
    gains, coupling = design_of(prepared.units.to_si(point(start.gains, start.coupling)))
    prefix = f"{opening}; the nearest miss has {_tried(prepared.problem, gains, coupling)}: "
    for case in prepared.given.cases:
        failure = _first_failure(case, gains, coupling)
        if failure is not None:
            cause, advice = failure
            return Infeasibility(prefix + _on(case, prepared.problem) + cause, advice, proved)
    unknown = "it meets every constraint on a grid of frequencies, but vctune could not make it a proved design"
    return Infeasibility(prefix + unknown, "widen the bounds", proved)


def _tried(problem: Problem, gains: Gains, coupling: AnyCoupling) -> str:
    """Return the values that identify a design: the gains of its loop, or the coupling if there is no loop."""
    units, kind = problem.units, problem.device.kind
    if kind.own_loop:
        return f"velocity {gains.velocity:.4g} {units.damping}, position {gains.position:.4g} {units.stiffness}"
    values = dict(zip(kind.keys, (*astuple(gains), *astuple(coupling)), strict=True))
    named = ((key.rpartition(".")[2], values[key], units.of(QUANTITIES[key])) for key in kind.stated)
    return ", ".join(f"{name} {value:.4g} {unit}" for name, value, unit in named)


def _on(case: Problem, problem: Problem) -> str:
    """Return the parameters in which the device of a case differs from the device of the problem, in words; "" if no
    parameter differs."""
    own = problem.device
    other = {key: number for key, number in case.device.numbers().items() if number != own.number(key)}
    return f"with {', '.join(f'{key} {number:.6g}' for key, number in other.items())}: " if other else ""


def _first_failure(problem: Problem, gains: Gains, coupling: AnyCoupling) -> tuple[str, str] | None:
    """Return the most serious violation of a design on one device, and a possible repair; None without a violation."""
    device, stability = problem.device, problem.stability
    looped = device.kind.own_loop
    if looped and gains.velocity == 0 and gains.position == 0 and device.damping == 0:
        return "without a loop and without damping the device drifts", "allow a higher gains.velocity"
    radius = spectral_radius(device, gains) if looped else 0.0
    if radius >= 1:
        return (
            f"its sampled loop is unstable, spectral radius {radius:.4g}",
            "allow a lower gains.velocity or gains.position, or shorten device.sample_time or device.delay",
        )
    lacking = _lacking_resistance(problem, gains) if problem.passive else None
    if lacking is not None:
        return lacking
    peaks = sensitivity_maxima(problem, gains)
    ratio, omega, place = _least_ratio(problem, gains, coupling)
    peak = -peaks.value[0]
    excess = peak / stability.max_sensitivity
    shortfall = stability.safety_factor / ratio if ratio > 0 else inf
    if excess > max(shortfall, 1):
        return (
            f"|S| reaches {peak:.4g} at {peaks.omega[0] / (2 * pi):.4g} Hz, above max_sensitivity "
            f"{stability.max_sensitivity:.4g}",
            "allow lower gains or a higher max_sensitivity",
        )
    if device.servo is not None and omega == 0 and shortfall > 1:
        return _short_of_drag(problem, ratio, place)
    return _shortfall(problem, coupling, ratio, place) if shortfall > 1 else None


def _short_of_drag(problem: Problem, ratio: float, place: str) -> tuple[str, str]:
    """Return the factor by which the drag of a servo is too small, and a possible repair, in words."""
    factor, late = problem.stability.safety_factor, latency(problem.device, FLOATS)
    longest = max(LATENCY_PARTS, key=lambda part: float(getattr(late, part)))
    missed = f", short of the safety factor {factor:.4g} by a factor of {factor / ratio:.4g}" if ratio > 0 else ""
    return (
        f"the drag is {ratio:.4g} of what contacts behind {1e3 * float(late.total):.4g} ms of latency ask for "
        f"{place}{missed}",
        f"allow a greater coupling.drag, state softer contacts in [operator], or {LATENCY_PARTS[longest].quicker}",
    )


def _shortfall(problem: Problem, coupling: AnyCoupling, ratio: float, place: str) -> tuple[str, str]:
    """Return the factor by which the coupling is too weak, and a possible repair, in words."""
    factor, narrower = problem.stability.safety_factor, "stability.band_hz"
    if not problem.passive:
        narrower = "the hands of [operator]"
    if problem.device.kind.inverse and ratio < NEXT_TO_NOTHING:
        return (
            f"no coupling is soft enough {place}: K_v alone makes a loop unstable there, or b_c drives",
            "allow a lower gains.velocity or coupling.damping, or raise device.velocity.filter_hz",
        )
    if problem.device.kind.inverse:
        return (
            f"Re 1/Z_c is {ratio:.4g} of the required R {place}, short of the safety factor {factor:.4g} "
            f"by a factor of {factor / ratio:.4g}",
            "lower coupling.stiffness.min, add device damping, or shorten device.sample_time or device.delay",
        )
    if ratio < NEXT_TO_NOTHING:
        return (
            f"Re Z_c is next to 0 {place}, where some is required",
            f"allow a greater coupling.drag, or narrow {narrower}",
        )
    return (
        f"Re Z_c is {ratio:.4g} of the required R {place}, short of the safety factor {factor:.4g} by a factor of "
        f"{factor / ratio:.4g}",
        f"raise the upper bound of {_tight_coupling(problem, coupling)}, or narrow {narrower}",
    )


def _least_ratio(problem: Problem, gains: Gains, coupling: AnyCoupling) -> tuple[float, float, str]:
    """Return the least Re Z_c / R over the required hands, its frequency, rad/s, and its place in words."""
    found = []
    if problem.passive:
        minima = ratio_minima(problem, gains, coupling)
        found.append((float(minima.value[0]), float(minima.omega[0]), f"at {minima.omega[0] / (2 * pi):.4g} Hz"))
    for worst in least_ratios(problem, gains, coupling):
        hand = "any passive hand" if worst.hand is None else f"the hand of {worst.hand.in_words(problem.units)}"
        found.append((worst.ratio, worst.omega, f"at {worst.omega / (2 * pi):.4g} Hz in {hand}"))
    return min(found)


def _lacking_resistance(problem: Problem, gains: Gains) -> tuple[str, str] | None:
    """Return the place on the band at which Re G_hh is negative, and a possible repair, in words; None if there is no
    such place."""
    device = problem.device
    grid = demand_grid(device, *sampled_span(problem))
    resistance = local_minima(lambda omega: response(device, gains, omega).resistance, grid)
    lack, hz = -resistance.value[0], resistance.omega[0] / (2 * pi)
    if lack >= 0:
        unit = UNITS[device.units].damping
        return (
            f"Re G_hh < 0 at {hz:.4g} Hz, where b + Re C = {-lack:.4g} {unit}",
            f"add {lack:.4g} {unit} of device damping, shorten the delay, or end stability.band_hz below {hz:.4g} Hz",
        )
    return None


def _tight_coupling(problem: Problem, coupling: AnyCoupling) -> str:
    most = problem.bounds
    at_damping = np.isclose(coupling.damping, most.damping.max, rtol=1e-3)
    at_mass = isinstance(coupling, Coupling) and np.isclose(coupling.mass, most.mass.max, rtol=1e-3)
    at_drag = isinstance(coupling, Coupling) and 0 < most.drag.max <= coupling.drag * (1 + 1e-3)
    bounds = ("coupling.drag", at_drag), ("coupling.damping", at_damping), ("coupling.mass", at_mass)
    names = [name for name, tight in bounds if tight]
    return " and ".join(names) if names else "coupling.damping"
