"""The error of a problem's best design where an estimate will do: found by the optimiser, proved by nobody."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from vctune.design.exchange import TIGHTENING, polish
from vctune.design.optimum import WORTH_POLISHING, local_optima
from vctune.design.prepared import Prepared, prepare
from vctune.design.result import Polished
from vctune.design.scan import ScanResult, scan
from vctune.design.start import Start
from vctune.design.theorems import impossible
from vctune.design.variables import design_of
from vctune.design.working_set import WorkingSet
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem


@dataclass(frozen=True, slots=True)
class Estimate:
    """A design that meets the demands in double precision, SI units, and its error."""

    gains: Gains
    coupling: AnyCoupling
    error: float


@np.errstate(all="ignore")
def estimated(problem: Problem, tightening: float = TIGHTENING) -> Estimate | None:
    """Return the best design of a problem; the demands are met in double precision, nothing is proved.

    Parameters
    ----------
    problem : that leaves something free
    tightening : relative sharpening of the demands

    Returns
    -------
    Estimate or None
        None if none is found.
    """
    if impossible(problem) is not None:
        return None
    prepared = prepare(problem)
    return estimated_from(prepared, scan(prepared.scaled), tightening=tightening)


def estimated_from(
    prepared: Prepared,
    scanned: ScanResult,
    *,
    demands: WorkingSet | None = None,
    tightening: float = TIGHTENING,
    incumbent: float = inf,
) -> Estimate | None:
    """Return the best design that starts lead to, as `estimated` does.

    Parameters
    ----------
    prepared : of a problem that leaves something free
    scanned : starts, dimensionless
    demands : of a like device's optimum, to begin with at the first start
    tightening : relative sharpening of the demands
    incumbent : what the error cannot get below is given up
    """
    scaled, units = prepared.scaled, prepared.units

    def polished(start: Start, least: float) -> Polished | None:
        known, limit = demands if start is scanned.starts[0] else None, min(least, incumbent / units.error)
        return polish(scaled, start, scanned, incumbent=limit, tightening=tightening, demands=known)

    optima = local_optima(scaled, scanned, lambda stage: None, WORTH_POLISHING, polished)
    if not optima:
        return None
    gains, coupling = design_of(units.to_si(optima[0].values))
    return Estimate(gains, coupling, prepared.given.error(gains, coupling))
