"""Why a problem has no design: the demand that the nearest miss fails, and where."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from vctune.analysis.demands import demand_grid, ratio_minima, response, sampled_span, sensitivity_maxima
from vctune.analysis.extrema import local_minima
from vctune.design.prepared import Prepared
from vctune.design.scan import ScanResult
from vctune.design.variables import design_of, point
from vctune.model.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.proof.sampled_loop import spectral_radius

OPENINGS = {True: "there is no admissible design", False: "no admissible design was found, nor proved impossible"}
"""How the reason begins, by whether it is proved."""


@dataclass(frozen=True, slots=True)
class Infeasibility:
    """Why there is no admissible design.

    Attributes
    ----------
    cause : which demand fails, where and by how much
    advice : what may repair it
    proved : whether it follows from a theorem or from a search that has emptied every box of gains, not from one that
        found nothing
    """

    cause: str
    advice: str
    proved: bool

    @property
    def reason(self) -> str:
        """Cause and advice."""
        return f"{self.cause}; {self.advice}"


def nearest_miss(prepared: Prepared, scanned: ScanResult, *, proved: bool) -> Infeasibility:
    """Describe how the scanned point that fails least fails.

    Parameters
    ----------
    prepared : the problem
    scanned : the scan's result
    proved : whether every box of gains has been searched in vain
    """
    opening = OPENINGS[proved]
    if not scanned.starts:
        return Infeasibility(opening, "widen the bounds", proved)
    start = scanned.starts[0]
    gains, coupling = design_of(prepared.units.to_si(point(start.gains, start.coupling)))
    prefix = f"{opening}; the nearest miss has velocity {gains.velocity:.4g} N s/m, position {gains.position:.4g} N/m: "
    failures = (_first_failure(case, gains, coupling) for case in prepared.given.cases)
    missed = next((failure for failure in failures if failure is not None), None)
    unknown = "it meets every demand on a grid of frequencies, but IPOPT or the proof did not", "widen the bounds"
    cause, advice = missed or unknown
    return Infeasibility(prefix + cause, advice, proved)


def _first_failure(problem: Problem, gains: Gains, coupling: Coupling) -> tuple[str, str] | None:
    """Return the gravest failure of a design on one device and what may repair it; None where it fails nothing."""
    device, stability = problem.device, problem.stability
    if gains.velocity == 0 and gains.position == 0 and device.damping == 0:
        return "without a loop and without damping the device drifts", "allow a higher gains.velocity"
    radius = spectral_radius(device, gains)
    if radius >= 1:
        return (
            f"its sampled loop is unstable, spectral radius {radius:.4g}",
            "allow a lower gains.velocity or gains.position, or shorten device.sample_time or device.delay",
        )
    grid = demand_grid(device, *sampled_span(problem))
    resistance = local_minima(lambda omega: response(device, gains, omega).resistance, grid)
    lack, hz = -resistance.value[0], resistance.omega[0] / (2 * pi)
    if lack >= 0:
        return (
            f"Re G_hh < 0 at {hz:.4g} Hz, where b + Re C = {-lack:.4g} N s/m",
            f"add {lack:.4g} N s/m of device damping, shorten the delay, or end stability.band_hz below {hz:.4g} Hz",
        )
    peaks, ratio = sensitivity_maxima(problem, gains), ratio_minima(problem, gains, coupling)
    peak, least = -peaks.value[0], ratio.value[0]
    excess, shortfall = peak / stability.max_sensitivity, stability.safety_factor / least
    if excess > max(shortfall, 1):
        return (
            f"|S| reaches {peak:.4g} at {peaks.omega[0] / (2 * pi):.4g} Hz, above max_sensitivity "
            f"{stability.max_sensitivity:.4g}",
            "allow lower gains or a higher max_sensitivity",
        )
    if shortfall > 1:
        return (
            f"Re Z_c is {least:.4g} of the required R at {ratio.omega[0] / (2 * pi):.4g} Hz, short of the safety "
            f"factor {stability.safety_factor:.4g} by a factor of {shortfall:.4g}",
            f"raise the upper bound of {_tight_coupling(problem, coupling)}, or narrow stability.band_hz",
        )
    return None


def _tight_coupling(problem: Problem, coupling: Coupling) -> str:
    at_damping = np.isclose(coupling.damping, problem.bounds.damping.max, rtol=1e-3)
    at_mass = np.isclose(coupling.mass, problem.bounds.mass.max, rtol=1e-3)
    names = [name for name, tight in (("coupling.damping", at_damping), ("coupling.mass", at_mass)) if tight]
    return " and ".join(names) if names else "coupling.damping"
