"""Find the environment that presses a design hardest, how a loop with one grows, and the multiplier that proves walls,
in double precision (model/README.md, sections 18 and 19)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf, log, pi, tan
from typing import NamedTuple

import numpy as np

from vctune.analysis.hardest_hands import met_in_shares, rooms_at_walls
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand, offered_at_spring, seen_in_hand
from vctune.model.sampled.loop_in_worlds import offered_at
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import World, Worlds, WorldsMet

LEAST = 1e-6  # Distance, rad, of an angle from 0 and pi within which no environment has a reactance
STEPS, OFFSET, SETTLED = 60, 1e-7, 1e-10  # of Newton's iteration, relative to the angle
HIGHEST = 1 - 1e-5  # Greatest corner, in units of 2/T
LOWEST = 1e-4  # Least corner that the search evaluates, in units of 2/T
CORNERS = 17  # Number of corners evaluated first, evenly spaced on a log scale: the reserve may have two maxima
FINER = 3  # Number of times that the search then quarters the spacing around the best corner, down to 1 %
# Shares of each range of hands, and number of angles per decade, that the search evaluates
HAND_SHARES, PER_DECADE = (0.0, 0.1, 1.0), 16


class Growth(NamedTuple):
    """A motion that grows as e^(rate t)."""

    hz: float
    rate: float  # 1/s


def reaction(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, factor: float = 1.0
) -> Callable[[complex], complex]:
    """Return Z_c/factor + Z_seen, which an environment meets, as a function of the angle, which may be complex; for an
    impedance display its dual, 1/Z_c/factor + G_y/(1 + K_v F G_y)."""
    plant = plant_in_hand(device.undisturbed, hand, delays_of(device), FLOATS)

    def at(theta: complex) -> complex:
        seen = seen_in_hand(loop_in_hand(plant, theta, FLOATS), gains)
        s, c = complex(np.sin(theta / 2)), complex(np.cos(theta / 2))
        of_loop = -(seen.lost + 1j * seen.swing / s) / seen.size
        if isinstance(coupling, SpringDamper):
            spring = offered_at_spring(coupling, device, theta, FLOATS)
            return complex(s * s * ((spring.above + 1j * spring.spring / s) / spring.below / factor + of_loop))
        Z_c = offered_at(coupling, device.sample_time, device.rule, theta, FLOATS)
        return complex((Z_c.resistance + 1j * Z_c.reactance / c) / factor + of_loop)

    return at


def binding_world(
    device: Device,
    gains: Gains,
    coupling: AnyCoupling,
    hand: Hand,
    omega: float,
    factor: float,
    worlds: Worlds | None = None,
) -> World | None:
    """Return the environment that leaves the least reserve in a hand at a frequency, without additional damping; None
    near angles 0 and pi, where any environment suffices."""
    theta = omega * device.sample_time
    if not LEAST < theta < pi - LEAST:
        return None
    u, met = 2 / device.sample_time * tan(theta / 2), -reaction(device, gains, coupling, hand, factor)(theta).imag
    if device.kind.inverse:  # the reaction is an admittance, as are 1/(mass s) and s/stiffness
        return World(0.0, 0.0, u / met) if met > 0 else World(-1 / (met * u), 0.0, 0.0) if met < 0 else None
    low, high = (worlds.low, worlds.high) if worlds else (World(0.0, 0.0, 0.0), World(inf, inf, inf))
    mass = (met + low.stiffness / u) / u
    if mass >= low.mass:
        return World(min(mass, high.mass), low.damping, low.stiffness)
    return World(low.mass, low.damping, min((low.mass * u - met) * u, high.stiffness))


@np.errstate(all="ignore")
def growth_near(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, world: World, omega: float
) -> Growth | None:
    """Return the growing motion whose frequency is next to a given one, rad/s; None if none is found.

    A pole of the loop is a zero of the whole impedance, continued from the unit circle to z = e^(j theta) of complex
    theta; it grows where Im theta < 0.
    """
    alone, T = reaction(device, gains, coupling, hand), device.sample_time

    def whole(theta: complex) -> complex:
        u = 2 / T * complex(np.tan(theta / 2))
        return alone(theta) + world.damping + 1j * (u * world.mass - world.stiffness / u)

    theta = complex(omega * T)
    for _ in range(STEPS):
        step = OFFSET * abs(theta)
        slope = (whole(theta + step) - whole(theta - step)) / (2 * step)
        moved = whole(theta) / slope if slope else complex("nan")
        theta -= moved * min(1.0, 0.2 * abs(theta) / max(abs(moved), 1e-300))
        if not np.isfinite(theta) or not 0 < theta.real < pi:
            return None
        if abs(moved) < SETTLED * abs(theta):
            return Growth(theta.real / (2 * pi * T), -theta.imag / T) if theta.imag < 0 else None
    return None


def corner_of(problem: Problem, gains: Gains, coupling: AnyCoupling) -> float:
    """Return the corner, rad/s, with which the condition for walls has the greatest reserve."""
    device, worlds, hands = problem.device, problem.worlds, problem.hands_met
    assert worlds is not None
    assert hands is not None
    most = 2 * HIGHEST / device.sample_time
    where = loops_in_hands(device, hands, HAND_SHARES, PER_DECADE)
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
