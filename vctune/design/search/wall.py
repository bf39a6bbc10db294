"""Find the stiffest wall of an impedance display, for the stated or the best damping (model/README.md, section 15).

A wall of small stiffness and little damping is stable. Its stiffness may grow until some hand puts a pole on the unit
circle, so that each damping has a stiffness to find by halving, and the best damping is left to find along one line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from math import exp, inf, log, pi

import numpy as np

from vctune.analysis.before_wall import LoopsBeforeWall
from vctune.analysis.damped import WallOnCurve
from vctune.analysis.extrema import last_to_hold
from vctune.analysis.in_hands import least_up_to
from vctune.analysis.loops_in_hands import answers, loops_in_any_hand
from vctune.design.judging.kicked import hands_at_rest, ringing_of, stays_calm
from vctune.design.prepared import Posed
from vctune.design.search.first_proved import RATIO_RESERVE, RESERVE, Law, LookedAt, Proved, first_proved
from vctune.design.variables import design_of, point, rounded
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.rest import greatest_at_rest, read_in_steps, step_of_damper
from vctune.running import boxes_at_most, check_time
from vctune.simulation.kicks import calm, calm_all_over

PER_DECADE = 480  # angles for any passive hand
FINE_ANGLES = 1e-5, pi, 800  # for hands: first and last, rad, and their number
# First reserve with a structure, whose sum of aliases has a bound that leaves less undecided, and boxes of a proof
ALIASED, MOST_BOXES = 2e-3, 20_000
DAMPINGS = np.append(0.0, np.geomspace(1e-3, 2.0, 25))  # that are compared first, as shares of m/lag + b
NO_LOOP = Gains(0.0, 0.0)  # of an impedance display that injects no damping
HALVINGS, STEPS = 30, 20  # of the logarithm of the stiffness, and of the range of the best damping
GREATEST, LEAST = 4.0, 1e-6  # stiffness that is tried, times T over m/lag + b, and as a share of the greatest

# Of calm walls: dampings of the grid, over the lesser of what the friction holds and that of the stiffest wall; ratio
# of its stiffnesses, and the least over the greatest; parts into which each finer grid divides the distances to the
# neighbours; and walls that are kicked together, by the fixed kicks and by those all over a box
SHARES = np.append(0.0, np.geomspace(0.01, 1.5, 20))
DOWN, SOFTEST = 0.7, 2e-3
PARTS = (6, 3)
BEYOND = 8  # Dampings from what the friction holds to that of the stiffest wall
TOGETHER, ALL_OVER = 64, 4
ROUNDED = 1e-9  # Share within which two stiffnesses are one

Bears = Callable[[SpringDamper], bool]  # whether a device seems to bear a wall and what it must be able to bear


@np.errstate(all="ignore")
def stiffest_wall(posed: Posed) -> Proved | None:
    """Return the stiffest wall that is proved, or else the last that was tried; None if there is none."""
    problem, ratio = posed.problem, posed.problem.stability.damping_ratio

    def best(seen: LookedAt, _: Law | None) -> Law | None:
        needed = problem.stability.safety_factor * (1 + seen.reserve)
        kind = _in_any_hand if problem.any_hand else _in_hands
        bears = [kind(device, seen, needed, ratio) for device in seen.devices]
        wall = _stiffest(posed, bears)
        if wall is not None and problem.stability.calm:
            wall = _calmest(posed, bears, wall)
        return None if wall is None else (NO_LOOP, wall)

    devices = list(dict.fromkeys(case.device for case in posed.cases))
    aliased = problem.any_hand and any(each.structure is not None for each in devices)
    hands, reserve = [*problem.hands.corners, problem.hands.middle], ALIASED if aliased else RESERVE
    with boxes_at_most(MOST_BOXES):
        return first_proved(posed, LookedAt(devices, hands, reserve=reserve), best)


def _in_any_hand(device: Device, seen: LookedAt, needed: float, _ratio: float | None) -> Bears:
    """Also at the angles beside which a proof has refuted a wall."""
    theta, T = np.union1d(loops_in_any_hand(device, PER_DECADE).theta, seen.angles), device.sample_time
    at = answers(device, theta)
    return lambda wall: bool(least_up_to(needed, *at.before_wall(wall, T, theta, FLOATS)).min() > 0)


def _in_hands(device: Device, seen: LookedAt, needed: float, ratio: float | None) -> Bears:
    close = np.union1d(np.geomspace(*FINE_ANGLES), seen.angles)  # the wall is as stiff as the crossings are exact
    loops = LoopsBeforeWall.of(device, list(seen.hands), close)
    curve = (
        None
        if ratio is None
        else WallOnCurve.of(device, list(seen.hands), ratio * (1 + RATIO_RESERVE + seen.reserve), seen.angles)
    )

    def bears(wall: SpringDamper) -> bool:
        if curve is not None and not curve.bears(wall):
            return False
        return bool(loops.unstable_from(1.0, wall)[0].min() >= needed)

    return bears


def _stiffness_at(posed: Posed, devices: Sequence[Bears]) -> Callable[[float], float]:
    """Return the greatest stiffness that every device bears, as a function of the damping; 0 if there is none."""
    problem = posed.problem
    springs = problem.bounds.stiffness
    greatest = min(springs.max, GREATEST * _scale(problem.device) / problem.device.sample_time)
    least = max(springs.min, LEAST * greatest)

    def stiffness(damping: float) -> float:
        def stable(log_stiffness: float) -> bool:
            check_time()
            return all(bears(SpringDamper(damping, exp(log_stiffness))) for bears in devices)

        low, high = log(least), log(max(greatest, least))
        if stable(high) or not stable(low):
            return exp(high) if stable(high) else 0.0
        return exp(last_to_hold(stable, low, high, HALVINGS))

    return stiffness


def _scale(device: Device) -> float:
    """Return about the greatest damping that a sampled device bears, N s/m."""
    return float(device.mass / device.loop_lag + device.damping)


def _stiffest(posed: Posed, devices: Sequence[Bears]) -> SpringDamper | None:
    """Return the stiffest wall that every device bears; of several equally stiff, that of least
    error."""
    problem, stiffness = posed.problem, _stiffness_at(posed, devices)
    dampings, scale = problem.bounds.damping, _scale(problem.device)

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
    return _rounded(posed, SpringDamper(best, stiffness(best)))


def _damper_held(device: Device) -> float:
    """Return the damping, N s/m, whose answer to one step of the reading is as great as the friction both ways; inf if
    step or friction is not known."""
    if read_in_steps(device) is None or device.friction is None:
        return inf
    step = step_of_damper(device, NO_LOOP, SpringDamper(1.0, 0.0))
    return 2 * device.friction / step if step > 0 else inf


def _rounded(posed: Posed, wall: SpringDamper) -> SpringDamper:
    _, found = design_of(rounded(posed.problem, point(NO_LOOP, wall)))
    assert isinstance(found, SpringDamper)
    return found


def _calmest(posed: Posed, devices: Sequence[Bears], stiffest: SpringDamper) -> SpringDamper | None:
    """Return about the stiffest wall that no kick keeps moving; None if no wall of a grid is calm (model/README.md,
    section 20).

    The grid has, for each damping b, stiffnesses from the lesser of 2 f/q and the greatest that is stable with b
    downwards. Around the stiffest wall that is calm it becomes finer.
    """
    bounds = posed.problem.bounds
    stable = cache(_stiffness_at(posed, devices))
    most = max(min(stiffest.stiffness, greatest_at_rest(posed.problem.device) or inf), bounds.stiffness.min)
    least = max(bounds.stiffness.min, SOFTEST * most)
    scale = min(_damper_held(posed.problem.device), stiffest.damping)
    # friction may hold less damping than a demanded damping ratio takes
    beyond = np.geomspace(scale, stiffest.damping, BEYOND) if 0 < scale < stiffest.damping else np.empty(0)
    compared = np.append(scale * SHARES, beyond)
    dampings = np.unique(np.clip(compared, bounds.damping.min, bounds.damping.max)).tolist()
    walls = [
        SpringDamper(damping, stiffness)
        for damping in dampings
        for stiffness in _down(min(stable(damping), most), least, DOWN)
    ]
    best = _stiffest_calm(posed, walls)
    ratio = DOWN
    for parts in PARTS:
        if best is None:
            break
        greatest = min(most, best.stiffness / ratio)  # from there on, all of the coarser grid have been tried
        ratio **= 1 / parts
        dampings = _finer(dampings, best.damping, parts)
        walls = [
            SpringDamper(damping, stiffness)
            for damping in dampings
            for stiffness in _down(min(stable(damping), greatest), best.stiffness / ratio**0.5, ratio)
        ]
        best = _stiffest_calm(posed, walls) or best
    return best


def _stiffest_calm(posed: Posed, walls: Sequence[SpringDamper]) -> SpringDamper | None:
    """Return the stiffest of several walls that are calm, as those tell that are kicked together and then alone."""
    device = posed.problem.device.undisturbed.bare
    hands = hands_at_rest(posed.problem)
    candidates = [_rounded(posed, wall) for wall in sorted(walls, key=lambda wall: -wall.stiffness)]
    for batch in _batches(candidates, TOGETHER):
        bearing = [wall for wall, rests in zip(batch, calm(device, hands, batch), strict=True) if rests]
        for few in _batches(bearing, ALL_OVER):
            for wall, rests in zip(few, calm_all_over(device, hands, few), strict=True):
                if rests and _is_calm(posed, wall):
                    return wall
    return None


def _batches(walls: Sequence[SpringDamper], count: int) -> list[Sequence[SpringDamper]]:
    """Return walls in groups of at most so many."""
    return [walls[first : first + count] for first in range(0, len(walls), count)]


def _is_calm(posed: Posed, wall: SpringDamper) -> bool:
    """Return whether no kick, nor any of many more, keeps a wall moving on the device that rings most."""
    rings = ringing_of(posed, posed.problem.device, NO_LOOP, wall)
    return stays_calm(posed.problem, rings, NO_LOOP, wall)


def _down(most: float, least: float, ratio: float) -> list[float]:
    """Return numbers from the greatest down to the least, each a share of the one before; none if the least is more."""
    if most < least * (1 - ROUNDED):
        return []
    return [most * ratio**step for step in range(1 + int(log(least / most) / log(ratio) + ROUNDED))]


def _finer(values: list[float], value: float, parts: int) -> list[float]:
    """Return the values from one neighbour of a value to the other, with the distances divided into parts."""
    k = int(np.argmin(np.abs(np.array(values) - value)))
    beside = values[max(k - 1, 0) : k + 2]
    places = np.linspace(0, len(beside) - 1, parts * (len(beside) - 1) + 1)
    return np.interp(places, range(len(beside)), beside).tolist()
