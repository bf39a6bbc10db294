"""Explain why a problem has no design: the constraint that the nearest miss violates, and its frequency and hand."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import inf, pi

from vctune.analysis.demands import demand_grid, response, sampled_span, sensitivity_maxima
from vctune.analysis.extrema import local_minima
from vctune.analysis.sampled_loop import spectral_radius
from vctune.design.judging.judge import margin_on_band, margins_in_hands
from vctune.design.prepared import Prepared
from vctune.design.search.scan import ScanResult
from vctune.design.variables import design_of, point
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import OF_KEYS, UNITS
from vctune.model.problem import Problem
from vctune.model.servo import latency, latency_parts
from vctune.proof.claims.registry import CLAIMS

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
    nearest: tuple[Gains, AnyCoupling] | None = None  # the nearest miss, SI units

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
            return Infeasibility(prefix + _on(case, prepared.problem) + cause, advice, proved, (gains, coupling))
    unknown = "it meets every constraint on a grid of frequencies, but vctune could not make it a proved design"
    return Infeasibility(prefix + unknown, "widen the bounds", proved)


def _tried(problem: Problem, gains: Gains, coupling: AnyCoupling) -> str:
    """Return the values that identify a design: the gains of its loop, or the coupling if there is no loop."""
    units, kind = problem.units, problem.device.kind
    if kind.own_loop:
        return f"velocity {gains.velocity:.4g} {units.damping}, position {gains.position:.4g} {units.stiffness}"
    values = dict(zip(kind.keys, (*astuple(gains), *astuple(coupling)), strict=True))
    named = ((key.rpartition(".")[2], values[key], units.of(OF_KEYS[key])) for key in kind.stated)
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
    on_band = [margin_on_band(problem, gains, coupling)] if problem.passive else []
    worst = min([*on_band, *margins_in_hands(problem.demands, [device], gains, coupling)], key=lambda at: at.ratio)
    ratio, place = worst.ratio, f"at {worst.omega / (2 * pi):.4g} Hz"
    if CLAIMS[worst.claim].quantity != "ratio":
        hand = "any passive hand" if worst.hand is None else f"the hand of {worst.hand.in_words(problem.units)}"
        place += f" in {hand}"
    excess, most = -peaks.value[0] / stability.max_sensitivity, stability.max_sensitivity
    shortfall = stability.safety_factor / ratio if ratio > 0 else inf
    if excess > max(shortfall, 1):
        hz = peaks.omega[0] / (2 * pi)
        return (
            f"|S| reaches {-peaks.value[0]:.4g} at {hz:.4g} Hz, above max_sensitivity {most:.4g}",
            "allow lower gains or a higher max_sensitivity",
        )
    if device.servo is not None and worst.omega == 0 and shortfall > 1:
        return _short_of_drag(problem, ratio, place)
    return _shortfall(problem, coupling, ratio, place) if shortfall > 1 else None


def _short_of_drag(problem: Problem, ratio: float, place: str) -> tuple[str, str]:
    """Return the factor by which the drag of a servo is too small, and a possible repair, in words."""
    factor, late = problem.stability.safety_factor, latency(problem.device, FLOATS)
    parts = latency_parts(problem.device)
    longest = max(parts, key=lambda part: float(getattr(late, part)))
    missed = f", short of the safety factor {factor:.4g} by a factor of {factor / ratio:.4g}" if ratio > 0 else ""
    return (
        f"the drag is {ratio:.4g} of what contacts behind {1e3 * float(late.total):.4g} ms of latency ask for "
        f"{place}{missed}",
        f"allow a greater coupling.drag, state softer contacts in [operator], or {parts[longest].quicker}",
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
    """Return the keys of the coupling's numbers that lie on their upper bounds."""
    upper = ((name, getattr(problem.bounds, name).max) for name in ("drag", "damping", "mass"))
    found = [f"coupling.{name}" for name, most in upper if 0 < most <= getattr(coupling, name, 0.0) * (1 + 1e-3)]
    return " and ".join(found) or "coupling.damping"
