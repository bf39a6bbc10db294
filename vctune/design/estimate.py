"""The error of a problem's best design where an estimate will do: found by the optimiser, proved by nobody."""

from __future__ import annotations

from math import inf

import numpy as np

from vctune.design.exchange import TIGHTENING, polish
from vctune.design.optimum import WORTH_POLISHING, local_optima
from vctune.design.prepared import Prepared, prepare
from vctune.design.result import Polished
from vctune.design.scan import ScanResult, scan
from vctune.design.start import Start
from vctune.design.theorems import impossible
from vctune.design.working_set import WorkingSet
from vctune.model.problem import Problem


@np.errstate(all="ignore")
def estimated(problem: Problem, tightening: float = TIGHTENING) -> float:
    """Return the error of the best design of a problem; the demands are met in double precision, nothing is proved.

    Parameters
    ----------
    problem : that leaves something free
    tightening : relative sharpening of the demands

    Returns
    -------
    float
        inf if none is found.
    """
    if impossible(problem) is not None:
        return inf
    prepared = prepare(problem)
    return estimated_from(prepared, scan(prepared.scaled), tightening=tightening)


def estimated_from(
    prepared: Prepared,
    scanned: ScanResult,
    *,
    demands: WorkingSet | None = None,
    tightening: float = TIGHTENING,
    incumbent: float = inf,
) -> float:
    """Return the error of the best design that starts lead to, as `estimated` does.

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
    return optima[0].error * units.error if optima else inf
