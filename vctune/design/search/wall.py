"""Find the stiffest wall of an impedance display, for the stated or the best damping (model/README.md, section 15).

A wall of small stiffness and little damping is stable. Its stiffness may grow until some hand puts a pole on the unit
circle, so that each damping has a stiffness to find by halving, and the best damping is left to find along one line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from math import ceil, exp, inf, log

import numpy as np

from vctune.analysis.before_wall import LoopsBeforeWall
from vctune.analysis.damped import WallOnCurve
from vctune.analysis.extrema import last_to_hold
from vctune.analysis.in_hands import least_up_to
from vctune.analysis.loops_in_hands import answers, loops_in_any_hand
from vctune.design.judging.kicked import buzz_of, ringing_of
from vctune.design.prepared import Posed
from vctune.design.search.first_proved import RATIO_RESERVE, RESERVE, Law, LookedAt, Proved, first_proved
from vctune.design.variables import design_of, point, rounded
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.rest import greatest_at_rest, read_in_steps, settles, step_of_damper
from vctune.running import boxes_at_most, check_time

PER_DECADE = 480  # angles for any passive hand
# First reserve with a structure, whose sum of aliases has a bound that leaves less undecided, and boxes of a proof
ALIASED, MOST_BOXES = 2e-3, 20_000
DAMPINGS = np.append(0.0, np.geomspace(1e-3, 2.0, 25))  # that are compared first, as shares of m/lag + b
NO_LOOP = Gains(0.0, 0.0)  # of an impedance display that injects no damping
HALVINGS, STEPS = 30, 20  # of the logarithm of the stiffness, and of the range of the best damping
GREATEST, LEAST = 4.0, 1e-6  # stiffness that is tried, times T over m/lag + b, and as a share of the greatest

# Of calm walls: dampings that are compared, over the lesser of what the friction holds and that of the stiffest wall;
# least stiffness, over the greatest that rests or is stable; ratios of the stiffnesses that are tried from there
# downwards, where some wall comes to rest for sure and where none does; dampings over that of the stiffest that does;
# and how many times as many kicks it must bear
SHARES, SOFTEST, MORE = np.geomspace(0.01, 1.5, 48), 0.02, 16
STEP, WIDE_STEP, DAMPED, FEW = 0.87, 0.7, (1.0, 1.3, 1.7), 4
BETWEEN = (2 / 3, 1 / 3)  # shares of a step by which a wall is then tried stiffer
ROUNDED = 1 + 1e-9  # over a stiffness that was found by halving its logarithm

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
    loops = LoopsBeforeWall.of(device, list(seen.hands), seen.angles)
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
    """Return the damping, N s/m, whose answer to one step of the reading is as great as the friction both ways."""
    step = step_of_damper(device, NO_LOOP, SpringDamper(1.0, 0.0))
    return 2 * (device.friction or 0.0) / step if step > 0 else inf


def _rounded(posed: Posed, wall: SpringDamper) -> SpringDamper:
    _, found = design_of(rounded(posed.problem, point(NO_LOOP, wall)))
    assert isinstance(found, SpringDamper)
    return found


def _calmest(posed: Posed, devices: Sequence[Bears], stiffest: SpringDamper) -> SpringDamper | None:
    """Return about the stiffest wall that no kick keeps moving; None if none of those that were tried is calm.

    The walls that are tried become softer from the stiffest that may rest, down to the stiffest that comes to rest for
    sure (model/README.md, section 20).
    """
    problem, stiffness = posed.problem, cache(_stiffness_at(posed, devices))
    dampings, springs = problem.bounds.damping, problem.bounds.stiffness
    most = min(stiffest.stiffness, greatest_at_rest(problem.device) or inf)
    least = max(springs.min, SOFTEST * most)

    def calm(wall: SpringDamper) -> bool:
        rings = ringing_of(posed, problem.device, NO_LOOP, wall)
        kicks = (buzz_of(problem, rings, NO_LOOP, wall, more) for more in (1, MORE))
        return all(of is None or of.moving == 0 for of in kicks)

    def settled(damping: float) -> float:
        def comes_to_rest(log_stiffness: float) -> bool:
            wall = SpringDamper(damping, exp(log_stiffness))
            return all(settles(Design(case.device, NO_LOOP, wall)) for case in posed.cases)

        high = min(stiffness(damping), most)
        if high * ROUNDED < least or not comes_to_rest(log(least)):
            return 0.0
        return high if comes_to_rest(log(high)) else exp(last_to_hold(comes_to_rest, log(least), log(high), HALVINGS))

    known = problem.device.friction is not None and read_in_steps(problem.device) is not None
    held = _damper_held(problem.device) if known else inf
    tried = np.unique(np.clip(min(held, stiffest.damping) * SHARES, dampings.min, dampings.max)).tolist()
    found = max((settled(damping), damping) for damping in tried) if known else (0.0, 0.0)
    if found[0] > 0:
        springs_tried = _down(most, max(found[0] * (1 - RESERVE), least), STEP)
        tried = np.unique(np.clip(found[1] * np.array(DAMPED), dampings.min, dampings.max)).tolist()
    else:  # what rests is not known: the softer and the less damped a wall, the less it buzzes
        springs_tried, tried = _down(most, least, WIDE_STEP), tried[:: ceil(len(tried) / FEW)]

    def calm_wall(spring: float, damping: float) -> SpringDamper | None:
        wall = _rounded(posed, SpringDamper(damping, spring))
        return wall if spring <= stiffness(damping) * ROUNDED and calm(wall) else None

    for spring, damping in product(springs_tried, tried):
        if (wall := calm_wall(spring, damping)) is not None:
            stiffer = (calm_wall(min(spring / STEP**share, most), damping) for share in BETWEEN if spring < most)
            return next((each for each in stiffer if each is not None), wall)
    return None


def _down(most: float, least: float, ratio: float) -> list[float]:
    """Return numbers from the greatest to the least, each a share of the one before."""
    steps = max(0, ceil(log(least / most) / log(ratio)))
    return [*(most * ratio**n for n in range(steps)), least]
