"""Find the stiffest wall of an impedance display, for the stated or the best damping (model/README.md, section 15).

A wall of small stiffness and little damping is stable. Its stiffness may grow until some hand puts a pole on the unit
circle, so that each damping has a stiffness to find by halving, and the best damping is left to find along one line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp, inf, log

import numpy as np

from vctune.analysis.extrema import last_to_hold
from vctune.analysis.in_hands import least_multiples
from vctune.analysis.loops_in_hands import loops_in_any_hand
from vctune.analysis.worst_hand import ANGLES, LoopsBeforeWall
from vctune.design.prepared import Posed
from vctune.design.search.first_proved import Law, LookedAt, Proved, first_proved
from vctune.design.variables import design_of, point, rounded
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.numbers.arithmetic import FLOATS
from vctune.running import check_time

PER_DECADE = 120  # angles for any passive hand
DAMPINGS = np.append(0.0, np.geomspace(1e-3, 2.0, 25))  # that are compared first, as shares of m/lag + b
NO_LOOP = Gains(0.0, 0.0)  # of an impedance display that injects no damping
HALVINGS, STEPS = 30, 20  # of the logarithm of the stiffness, and of the range of the best damping
GREATEST, LEAST = 4.0, 1e-6  # stiffness that is tried, times T over m/lag + b, and as a share of the greatest

Multiple = Callable[[SpringDamper], float]  # the least multiple of a wall that is unstable, by an estimate


@np.errstate(all="ignore")
def stiffest_wall(posed: Posed) -> Proved | None:
    """Return the stiffest wall that is proved, or else the last that was tried; None if there is none."""
    problem = posed.problem

    def best(seen: LookedAt, _: Law | None) -> Law | None:
        multiples = [_in_any_hand(each) if problem.any_hand else _in_hands(each, seen) for each in seen.devices]
        wall = _stiffest(posed, multiples, problem.stability.safety_factor * (1 + seen.reserve))
        return None if wall is None else (NO_LOOP, wall)

    devices = list(dict.fromkeys(case.device for case in posed.cases))
    return first_proved(posed, LookedAt(devices, [*problem.hands.corners, problem.hands.middle]), best)


def _in_any_hand(device: Device) -> Multiple:
    at, T = loops_in_any_hand(device, PER_DECADE), device.sample_time
    return lambda wall: float(least_multiples(*at.answers.before_wall(wall, T, at.theta, FLOATS)).min())


def _in_hands(device: Device, seen: LookedAt) -> Multiple:
    loops = LoopsBeforeWall.of(device, list(seen.hands), np.union1d(ANGLES, seen.angles))
    return lambda wall: float(loops.limits(wall)[0].min())


def _stiffest(posed: Posed, multiples: Sequence[Multiple], needed: float) -> SpringDamper | None:
    """Return the stiffest wall of which every device bears a multiple; of several equally stiff, that of least
    error."""
    problem = posed.problem
    device, dampings, springs = problem.device, problem.bounds.damping, problem.bounds.stiffness
    scale = device.mass / device.loop_lag + device.damping
    greatest = min(springs.max, GREATEST * scale / device.sample_time)
    least = max(springs.min, LEAST * greatest)

    def stiffness(damping: float) -> float:
        def stable(log_stiffness: float) -> bool:
            check_time()
            return all(each(SpringDamper(damping, exp(log_stiffness))) >= needed for each in multiples)

        low, high = log(least), log(max(greatest, least))
        if stable(high) or not stable(low):
            return exp(high) if stable(high) else 0.0
        return exp(last_to_hold(stable, low, high, HALVINGS))

    def worth(damping: float) -> tuple[float, float]:
        """Minus the stiffness, and the error."""
        k = stiffness(damping)
        return -k, posed.error(NO_LOOP, SpringDamper(damping, k)) if k > 0 else inf

    tried = np.unique(np.clip(scale * DAMPINGS, dampings.min, dampings.max))
    found = [worth(float(damping)) for damping in tried]
    k = min(range(len(found)), key=lambda n: found[n])
    if found[k][0] == 0:
        return None
    best, (low, high) = float(tried[k]), (float(tried[max(k - 1, 0)]), float(tried[min(k + 1, len(tried) - 1)]))
    golden = (5**0.5 - 1) / 2
    for _ in range(STEPS if high > low else 0):
        inner = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, inner[1]) if worth(inner[0]) <= worth(inner[1]) else (inner[0], high)
    # the best damping may be the greatest or the least that is stable, so that it is rounded both ways
    decimals = {float(f"{x * (1 + up):.6g}") for x in (low, 0.5 * (low + high), high) for up in (-1e-6, 0, 1e-6)}
    best = min((x for x in (best, *sorted(decimals)) if dampings.min <= x <= dampings.max), key=worth)
    _, wall = design_of(rounded(problem, point(NO_LOOP, SpringDamper(best, stiffness(best)))))
    assert isinstance(wall, SpringDamper)
    return wall
