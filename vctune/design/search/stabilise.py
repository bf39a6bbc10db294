"""Stable loops to start an exchange, and tangents that keep its answers stable (design/README.md, section 6)."""

from __future__ import annotations

from vctune.analysis.stability import clearly_stable, stability_cut
from vctune.design.search.start import Start
from vctune.design.search.violations import least_resistance, of_own_loops
from vctune.design.search.working_set import WorkingSet
from vctune.design.variables import Point, point
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.problem import Problem
from vctune.proof.claims.model_poles import prove_model_poles
from vctune.proof.claims.sampled_poles import prove_sampled_poles
from vctune.proof.engine.interval import Verdict

GAIN_REDUCTIONS = (1.0, 0.99, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
"""Factors of K_p, or of both gains, that are tried until a start's loops are proved stable. The scan errs by some per
cent on its frequencies, hence the first ones; the last are for devices that no estimate fits. The NLP moves on from
there within its box, so that other factors lead to the same optimum."""
STABILITY_MARGIN = 1e-4
"""Least distance from the stability boundary, as a share of the open loop's F, if no other constraint stops a design. A
limit on |S| keeps it further away; without one, half or twice is that much of a share of the gains."""
MAX_CUTS = 24
"""Greatest number of tangents of the stability boundary: a curve in the plane of the gains, of which a box contains a
piece. Beyond, the box is halved as after any bad step."""


def stabilised(problem: Problem, cases: list[Problem], start: Start) -> Point | None:
    """Return the start, K_p or both gains reduced until its loops are sound: the scan's estimate may be off.

    That is, proved stable and, if that can be obtained, with Re(D + Z_h) > 0, for else the NLP has no values there.

    Parameters
    ----------
    problem : problem, dimensionless, with the bounds of the gains
    cases : the problem of each device that is evaluated
    start : the design, dimensionless

    Returns
    -------
    Point or None
        None if the loops are stable with none of the gains that are tried.
    """
    bounds, K_v, K_p = problem.bounds, start.gains.velocity, start.gains.position
    fallback: Point | None = None
    for velocity, position in ((v * K_v, share * K_p) for share in GAIN_REDUCTIONS for v in (1.0, share)):
        gains = Gains(max(velocity, bounds.velocity.min), max(position, bounds.position.min))
        if all(stable(case, gains) for case in of_own_loops(cases)):
            if all(least_resistance(case, gains).value[0] > 0 for case in cases if case.passive):
                return point(gains, start.coupling)
            fallback = fallback or point(gains, start.coupling)
    return fallback


def stable(problem: Problem, gains: Gains) -> bool:
    """Return whether all loops are stable; close to the boundary by proof, where an estimate would not do.

    Parameters
    ----------
    problem : problem of one device
    gains : gains in the problem's units
    """
    return all(_loop_stable(device, gains) for device in problem.device.loops)


def _loop_stable(device: Device, gains: Gains) -> bool:
    estimate = clearly_stable(device, gains)
    if estimate is not None:
        return estimate
    return all(prove(device, gains).verdict is Verdict.PROVED for prove in (prove_sampled_poles, prove_model_poles))


def add_stability_cut(problem: Problem, working_set: WorkingSet, inside: Gains, outside: Gains) -> bool:
    """After a step into instability add the tangent of the boundary that was crossed; return whether it is new.

    Parameters
    ----------
    problem : problem of one device, dimensionless
    working_set : working set to which the tangent is added
    inside, outside : stable and unstable gains
    """
    cuts = (stability_cut(device, inside, outside, STABILITY_MARGIN) for device in problem.device.loops)
    new = [cut for cut in cuts if cut is not None and cut not in working_set.stability]
    if len(working_set.stability) + len(new) > MAX_CUTS:
        return False
    working_set.stability.extend(new)
    return bool(new)
