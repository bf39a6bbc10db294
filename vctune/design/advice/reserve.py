"""Estimate in double precision how far a given design is from its limits, on few devices and in few hands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isnan

import numpy as np

from vctune.analysis.before_wall import LoopsBeforeWall
from vctune.analysis.damped import BoxOnCurve, WallOnCurve
from vctune.analysis.demands import sensitivity_maxima, unmodelled_maxima
from vctune.analysis.in_hands import least_ratio_before_wall, least_ratios_in_any_hand
from vctune.analysis.multiples import angles_of, ratio_in_these
from vctune.analysis.stability import clearly_stable
from vctune.design.judging.judge import margin_on_band
from vctune.design.judging.kicked import buzz_of, ringing_of
from vctune.design.prepared import Posed, pose
from vctune.design.search.theorems import impossible
from vctune.model.demands import Demands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, series_coupling
from vctune.model.hands import Hand, Hands
from vctune.model.problem import Problem

MOST_DEVICES = 16  # Greatest number of devices of a box on which a design is estimated
SLACK = 1e-5  # Share by which more than the safety factor is asked for, so that the proof succeeds


@np.errstate(all="ignore")
def reserve(problem: Problem, also: Sequence[Hand]) -> float:
    """Return the least ratio of a fixed design over the one that is asked for, in the hands at the vertices of the box
    and in those other hands that are in it. Below 1 the design fails, by at least as much; above 1 it may pass."""
    posed, (gains, coupling), stability = pose(problem), problem.fixed_design, problem.stability
    cases, held = posed.cases[:MOST_DEVICES], posed.hand_cases[:MOST_DEVICES]
    if problem.device.kind.inverse and impossible(problem) is not None:  # without damping nothing can be estimated
        return 0.0
    safe, ratios = stability.safety_factor * (1 + SLACK), list[float]()
    for case in held:
        ratios += _in_hands(case.device, posed.demands, gains, coupling, also)
    ratios += [margin_on_band(case, gains, coupling).ratio for case in cases if problem.passive]
    least = min((ratio / safe for ratio in ratios if not isnan(ratio)), default=inf)
    if stability.damping_ratio is not None and least >= 1:
        least = min(least, *(_damped(case, coupling, also) for case in held))
    if least < 1 or not problem.device.kind.own_loop:
        return least if least < 1 or _calm(posed, gains, coupling) else 0.0
    least = min(
        least, *(-stability.max_sensitivity / float(sensitivity_maxima(case, gains).value[0]) for case in cases)
    )
    if posed.box is not None and posed.box.nominal.unmodelled is not None and gains.closed:
        least = min(least, *(-1 / float(unmodelled_maxima(case, gains).value[0]) for case in cases))
    loops = (loop for case in cases for loop in case.device.loops)
    unstable = least >= 1 and any(clearly_stable(loop, gains) is False for loop in loops)
    return 0.0 if unstable or not _calm(posed, gains, coupling) else least


def _calm(posed: Posed, gains: Gains, coupling: AnyCoupling) -> bool:
    """Return whether no kick keeps a design moving, if that is demanded."""
    problem = posed.problem
    if not problem.stability.calm:
        return True
    kicked = buzz_of(problem, ringing_of(posed, problem.device, gains, coupling), gains, coupling)
    return kicked is not None and not kicked.moving


def _damped(problem: Problem, coupling: AnyCoupling, also: Sequence[Hand]) -> float:
    """Return the number by which a coupling may be divided until an oscillation misses the demanded damping ratio; of a
    wall inf or 0."""
    assert problem.hands_met is not None and problem.stability.damping_ratio is not None
    ratio = problem.stability.damping_ratio * (1 + SLACK)
    if isinstance(coupling, SpringDamper):
        loops = WallOnCurve.of(problem.device, _hands(problem.hands_met, also), ratio, np.empty(0))
        return inf if loops.bears(coupling) else 0.0
    assert problem.worlds is not None
    on_curve = BoxOnCurve.of(problem.device, problem.hands_met, problem.worlds, ratio, angles_of(problem.device))
    least, most = on_curve.room(series_coupling(coupling))
    return min(1 / least if least > 0 else inf, most)


def _hands(box: Hands, also: Sequence[Hand]) -> list[Hand]:
    """Return the hands at the vertices of a box, its middle, and those other hands that are in it."""
    ends = box.ranges
    within = [hand for hand in also if all(low <= hand.numbers[key] <= high for key, (low, high) in ends.items())]
    return [*box.corners, box.middle, *within]


def _in_hands(
    device: Device, demands: Demands, gains: Gains, coupling: AnyCoupling, also: Sequence[Hand]
) -> Iterator[float]:
    """Yield the least ratio of each claim in hands on one device."""
    if demands.hands is not None:
        hands = _hands(demands.hands, also)
        if demands.rigid:
            assert isinstance(coupling, SpringDamper)
            yield float(LoopsBeforeWall.of(device, hands).limits(coupling)[0].min())
        else:
            yield ratio_in_these(device, hands, gains, coupling, demands.worlds)
    elif demands.any_hand and demands.rigid:
        assert isinstance(coupling, SpringDamper)
        yield least_ratio_before_wall(device, coupling).ratio
    if demands.any_hand and not demands.rigid:
        yield least_ratios_in_any_hand(device, gains, coupling)[0].ratio
