"""What decides about given gains: error, least ratio, greatest |S|, certificate. Knows nothing of the optimiser."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import inf

import numpy as np

from vctune.analysis.demands import (
    TransparencyError,
    ratio_minima,
    sensitivity_maxima,
    transparency_error,
)
from vctune.document.problem import Problem
from vctune.exits import ExitCode
from vctune.model.limits import high_frequency_limit, low_frequency_limit
from vctune.model.quantities import Coupling, Gains
from vctune.proof.certificate import Certificate, certify
from vctune.proof.claims import Design
from vctune.proof.interval import Verdict


class Status(StrEnum):
    """What became of a problem."""

    CERTIFIED = "certified"
    VIOLATED = "violated"
    UNDECIDED = "undecided"
    INFEASIBLE = "infeasible"


STATUS_OF = {
    Verdict.PROVED: Status.CERTIFIED,
    Verdict.REFUTED: Status.VIOLATED,
    Verdict.UNDECIDED: Status.UNDECIDED,
}
EXIT_CODES = {
    Status.CERTIFIED: ExitCode.OK,
    Status.VIOLATED: ExitCode.FAILED,
    Status.UNDECIDED: ExitCode.UNDECIDED,
    Status.INFEASIBLE: ExitCode.FAILED,
}


@dataclass(frozen=True, slots=True)
class Judgement:
    """A design and what is known of it.

    Attributes
    ----------
    gains, coupling : the design
    transparency : its error and the three terms
    min_ratio, worst : least Re Z_c / R on the band and where, rad/s (0 or inf at an end of the axis)
    peak_sensitivity, worst_sensitivity : greatest |S| up to Nyquist and where, rad/s
    certificate : what is proved
    """

    gains: Gains
    coupling: Coupling
    transparency: TransparencyError
    min_ratio: float
    worst: float
    peak_sensitivity: float
    worst_sensitivity: float
    certificate: Certificate

    @property
    def status(self) -> Status:
        """The certificate's verdict as a status."""
        return STATUS_OF[self.certificate.verdict]


@np.errstate(all="ignore")
def judge(problem: Problem, gains: Gains, coupling: Coupling) -> Judgement:
    """Judge given gains against a problem's demands.

    The certificate proves the problem's own safety factor where the design seems to have it, else absolute stability.
    """
    band = (problem.stability.band.min, problem.stability.band.max)
    design = Design(problem.device, gains, coupling)
    min_ratio, worst = least_ratio(problem, gains, coupling)
    sensitivity = sensitivity_maxima(problem, gains)
    limit = problem.stability.max_sensitivity
    factors = (problem.stability.safety_factor, 1.0) if min_ratio >= problem.stability.safety_factor else (1.0,)
    certificate = certify(design, band, factors, limit)
    return Judgement(
        gains=gains,
        coupling=coupling,
        transparency=transparency_error(problem, gains, coupling),
        min_ratio=min_ratio,
        worst=worst,
        peak_sensitivity=float(-sensitivity.value[0]),
        worst_sensitivity=float(sensitivity.omega[0]),
        certificate=certificate,
    )


def least_ratio(problem: Problem, gains: Gains, coupling: Coupling) -> tuple[float, float]:
    """Return the least Re Z_c / R on the stability band and its frequency, the ends of the axis by exact limits."""
    device, band = problem.device, problem.stability.band
    minima = ratio_minima(problem, gains, coupling)
    candidates = [(float(minima.value[0]), float(minima.omega[0]))]
    if band.min == 0:
        limit = low_frequency_limit(device, gains, coupling, integrator=gains.position > 0)
        candidates.append((_quotient(limit.coupling, limit.required), 0.0))
    if band.max == inf:
        limit = high_frequency_limit(device, gains, coupling)
        candidates.append((_quotient(limit.coupling, limit.required), inf))
    return min(candidates)


def _quotient(coupling: float, required: float) -> float:
    return coupling / required if required > 0 else inf
