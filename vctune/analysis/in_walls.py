"""Find the corner of the multiplier that proves walls, for a given design (model/README.md, section 19)."""

from __future__ import annotations

from dataclasses import replace
from math import log

import numpy as np

from vctune.analysis.hardest_hands import met_in_shares, rooms_at_walls
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.model.worlds import WorldsMet

HIGHEST = 1 - 1e-5  # Greatest corner, in units of 2/T
LOWEST = 1e-4  # Least corner that the search evaluates, in units of 2/T
# Number of corners that the search evaluates first, evenly spaced on a log scale, because the reserve may have two
# maxima
CORNERS = 17
FINER = 3  # Number of times that the search then quarters the spacing around the best corner, down to 1 %
# Shares of each range of hands, and number of angles per decade, that the search evaluates
SHARES, PER_DECADE = (0.0, 0.1, 1.0), 16


def corner_of(problem: Problem, gains: Gains, coupling: AnyCoupling) -> float:
    """Return the corner, rad/s, with which the condition for walls has the greatest reserve."""
    device, worlds, hands = problem.device, problem.worlds, problem.hands_met
    assert worlds is not None
    assert hands is not None
    most = 2 * HIGHEST / device.sample_time
    where = loops_in_hands(device, hands, SHARES, PER_DECADE)
    asked = WorldsMet(worlds, problem.stability.safety_factor)
    shares = met_in_shares(where.loop, device, gains, coupling, where.theta, asked)

    def lacks(log_corner: float) -> float:
        met = replace(asked, worlds=replace(worlds, corner=float(np.exp(log_corner))))
        rooms = rooms_at_walls(shares, device.sample_time, where.theta, met)
        return -min(float(np.nanmin(room)) for room in rooms.values())

    tried = np.log(most) + np.linspace(log(LOWEST), 0.0, CORNERS)
    for again in range(FINER + 1):
        best = int(np.argmin([lacks(at) for at in tried]))
        if again < FINER:
            tried = np.linspace(tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)], 9)
    return in_decimals(float(np.exp(tried[best])))


def in_decimals(corner: float) -> float:
    """Return a corner, rad/s, rounded so that its frequency in hertz has six digits."""
    return 2 * np.pi * float(f"{corner / (2 * np.pi):.6g}")
