"""Find stable loops to start an exchange, and tangents that keep its loops stable (design/README.md, section 6)."""

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

# Factors of K_p, or of both gains, that the search tries until the loops of a start are stable (`stable`)
GAIN_REDUCTIONS = (1.0, 0.99, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
STABILITY_MARGIN = 1e-4  # Least distance of a design from the stability boundary, as a share of the open loop's F
MAX_CUTS = 24  # Greatest number of tangents of the stability boundary, which is a curve in the plane of the gains


def stabilised(problem: Problem, cases: list[Problem], start: Start) -> Point | None:
    """Return the start with K_p, or both gains, reduced until its loops are stable, as `stable` decides."""
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
    """Return whether all loops are stable. Near the stability boundary, where estimates are unreliable, a proof
    decides."""
    return all(_loop_stable(device, gains) for device in problem.device.loops)


def _loop_stable(device: Device, gains: Gains) -> bool:
    estimate = clearly_stable(device, gains)
    if estimate is not None:
        return estimate
    return all(prove(device, gains).verdict is Verdict.PROVED for prove in (prove_sampled_poles, prove_model_poles))


def add_stability_cut(problem: Problem, working_set: WorkingSet, inside: Gains, outside: Gains) -> bool:
    """Add a tangent of the stability boundary where a step crosses it."""
    cuts = (stability_cut(device, inside, outside, STABILITY_MARGIN) for device in problem.device.loops)
    new = [cut for cut in cuts if cut is not None and cut not in working_set.stability]
    if len(working_set.stability) + len(new) > MAX_CUTS:
        return False
    working_set.stability.extend(new)
    return bool(new)
