"""Why a problem has no design: a theorem, or the demand that the best miss fails (DESIGN 1.6)."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from vctune.analysis.demands import demand_grid, ratio_minima, response, sampled_span, sensitivity_maxima
from vctune.analysis.extrema import local_minima
from vctune.design.scan import ScanResult
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.proof.poles import spectral_radius

OPENINGS = {True: "there is no admissible design", False: "no admissible design was found, nor proved impossible"}
"""How the reason begins, by whether it is proved."""


@dataclass(frozen=True, slots=True)
class Infeasibility:
    """Why there is no admissible design.

    Attributes
    ----------
    reason : which demand fails, where, by how much, and what would repair it
    proved : whether it follows from a theorem or from a search that has emptied every box of gains, not from one that
        found nothing
    """

    reason: str
    proved: bool


def impossible(problem: Problem) -> Infeasibility | None:
    """Return the theorem of DESIGN 1.6 that excludes every design of the problem, or None."""
    reason = None
    if problem.stability.band.min == 0:
        reason = _impossible_at_zero(problem)
    if reason is None and problem.stability.band.max == inf:
        reason = _impossible_at_infinity(problem)
    return None if reason is None else Infeasibility(reason, proved=True)


def _impossible_at_zero(problem: Problem) -> str | None:
    device, bounds = problem.device, problem.bounds
    b, held, tau, K_p = device.damping, device.held.damping, device.lag, bounds.position.min
    most = held + bounds.velocity.max
    if tau * K_p > most:
        return (
            f"Re G_hh >= 0 for omega -> 0 needs tau K_p <= b + K_v, but tau times the least gains.position is "
            f"{tau * K_p:.4g} N s/m and all damping plus the greatest gains.velocity {most:.4g} N s/m; "
            f"lower gains.position.min to {most / tau:.4g} N/m"
        )
    left = most - tau * K_p
    need = (b * b - 4 * (held - b) * (left - held)) / (4 * left) if left > 0 else inf
    if K_p > 0 and b > 0 and bounds.drag.max < need:
        drag = need * problem.stability.safety_factor
        return (
            f"with K_p > 0 and damping {b:.4g} N s/m the required R tends to at least {need:.4g} N s/m for omega -> 0, "
            f"where Re Z_c tends to the drag, at most {bounds.drag.max:.4g} N s/m; raise stability.band_hz[0] above 0, "
            f"allow gains.position = 0, or allow a coupling.drag of {drag:.4g} N s/m"
        )
    return None


def _impossible_at_infinity(problem: Problem) -> str | None:
    device, bounds = problem.device, problem.bounds
    b, K_v = device.held.damping, bounds.velocity.min
    most = bounds.damping.max + bounds.drag.max
    need = 2 * device.mass * K_v / (b * device.sample_time) if b > 0 else inf
    if K_v == 0 or need <= most:
        return None
    if b == 0:
        return (
            "omega -> inf needs b_c + b_0 >= 2 m K_v/(b T), which no coupling has for a device without damping; "
            "lower stability.band_hz[1] to a finite edge, or add device damping"
        )
    return (
        f"omega -> inf needs b_c + b_0 >= 2 m K_v/(b T), at least {need:.4g} N s/m, but the bounds allow "
        f"{most:.4g} N s/m; lower stability.band_hz[1] to a finite edge, or raise coupling.damping.max to {need:.4g}"
    )


def nearest_miss(problem: Problem, scaled: Problem, seen: ScanResult, *, proved: bool) -> Infeasibility:
    """Describe how the scanned point that fails least fails.

    Parameters
    ----------
    problem, scaled : in SI and in dimensionless units
    seen : the scan's result
    proved : whether every box of gains has been searched in vain
    """
    opening = OPENINGS[proved]
    if not seen.starts:
        return Infeasibility(f"{opening}; widen the bounds", proved)
    start = seen.starts[0]
    Z, T = problem.transparency.reference_impedance, problem.device.sample_time
    gains = Gains(start.gains.velocity * Z, start.gains.position * Z / T)
    coupling = Coupling(start.coupling.damping * Z, start.coupling.mass * Z * T, start.coupling.drag * Z)
    prefix = f"{opening}; the nearest miss has velocity {gains.velocity:.4g} N s/m, position {gains.position:.4g} N/m: "
    return Infeasibility(prefix + _first_failure(problem, gains, coupling), proved)


def _first_failure(problem: Problem, gains: Gains, coupling: Coupling) -> str:
    device, stability = problem.device, problem.stability
    if gains.velocity == 0 and gains.position == 0 and device.damping == 0:
        return "without a loop and without damping the device drifts; allow a higher gains.velocity"
    radius = spectral_radius(device, gains)
    if radius >= 1:
        return (
            f"its sampled loop is unstable, spectral radius {radius:.4g}; allow a lower gains.velocity or "
            "gains.position, or shorten device.sample_time or device.delay"
        )
    grid = demand_grid(device, *sampled_span(problem))
    resistance = local_minima(lambda omega: response(device, gains, omega).resistance, grid)
    lack, hz = -resistance.value[0], resistance.omega[0] / (2 * pi)
    if lack >= 0:
        return (
            f"Re G_hh < 0 at {hz:.4g} Hz, where b + Re C = {-lack:.4g} N s/m; add {lack:.4g} N s/m of device "
            f"damping, shorten the delay, or end stability.band_hz below {hz:.4g} Hz"
        )
    peaks, ratio = sensitivity_maxima(problem, gains), ratio_minima(problem, gains, coupling)
    peak, least = -peaks.value[0], ratio.value[0]
    excess, shortfall = peak / stability.max_sensitivity, stability.safety_factor / least
    if excess > max(shortfall, 1):
        return (
            f"|S| reaches {peak:.4g} at {peaks.omega[0] / (2 * pi):.4g} Hz, above max_sensitivity "
            f"{stability.max_sensitivity:.4g}; allow lower gains or a higher max_sensitivity"
        )
    if shortfall > 1:
        return (
            f"Re Z_c is {least:.4g} of the required R at {ratio.omega[0] / (2 * pi):.4g} Hz, short of the safety "
            f"factor {stability.safety_factor:.4g} by a factor of {shortfall:.4g}; raise the upper bound of "
            f"{_tight_coupling(problem, coupling)}, or narrow stability.band_hz"
        )
    return "it meets every demand on a grid of frequencies, but IPOPT or the proof did not; widen the bounds"


def _tight_coupling(problem: Problem, coupling: Coupling) -> str:
    at_damping = np.isclose(coupling.damping, problem.bounds.damping.max, rtol=1e-3)
    at_mass = np.isclose(coupling.mass, problem.bounds.mass.max, rtol=1e-3)
    names = [name for name, tight in (("coupling.damping", at_damping), ("coupling.mass", at_mass)) if tight]
    return " and ".join(names) if names else "coupling.damping"
