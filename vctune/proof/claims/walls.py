"""The condition of walls over boxes, by tangents that each box chooses for itself (model/README.md, section 19).

Any tangents bound E from below, so that each box may have its own: those that are best in its middle. What one box
proves by its tangents says nothing of a face of it, where others are best; such margins have no slopes to go by.
"""

from __future__ import annotations

from dataclasses import astuple, replace
from typing import Any

import numpy as np
from flint import arb

from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS, ArrayArithmetic, Number
from vctune.model.problem import Demands
from vctune.model.sampled.loop_in_walls import Shares, Strip, Tangent, corner_of, shares_of, tangent_at, width_of
from vctune.model.sampled.loop_in_worlds import sum_of
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import World, Worlds, WorldsMet
from vctune.proof.claims.margins_of_claims import Design, strip_of_walls
from vctune.proof.enclosures.arb_balls import BALLS, ball, design_ball
from vctune.proof.enclosures.array_intervals import Enclosure, Floats
from vctune.proof.enclosures.jets import Jet
from vctune.proof.enclosures.taylor import Taylor

COUPLING_SHARE = "share of the coupling"
"""The share y of the coupling, from 1/safety_factor to 1."""
INWARDS = 1 - 1e-9
"""What keeps the slope of a tangent from being negative by rounding; half and twice as much off 1 are as good."""


def walls_margins(
    strip: Strip, met: WorldsMet, plain: Worlds, sample_time: Number, theta: Number, ops: ArrayArithmetic
) -> tuple[Number, ...]:
    """Return margins of which one must be positive with every wall, over boxes.

    The first has f at its least value and is regular at the Nyquist frequency, the second has the best tangents.

    Parameters
    ----------
    strip : of masses and dampings
    met : the environments, with the corner, in numbers of the arithmetic
    plain : the environments in plain numbers
    sample_time : T, s
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
    """
    T, here = _middle(sample_time), _middle(theta)
    low = None if strip.low is None else tuple(map(_middle, strip.low))
    in_middle = Strip(low, tuple(map(_middle, strip.high)), tuple(map(_middle, strip.excess)), _middle(strip.size))
    with np.errstate(all="ignore"):
        best = Tangent(*(np.nan_to_num(each) for each in tangent_at(in_middle, plain, T, here, FLOATS)))
    sin, cos = (_ends(each) for each in (ops.sin(theta / 2), ops.cos(theta / 2)))
    least = -corner_of(plain) * width_of(plain) * np.maximum(cos[0], 0.0) ** 2 * T**2 / (8 * sin[1] ** 2) * INWARDS
    chosen = Tangent(*map(Enclosure, (best.rising, best.falling, np.maximum(best.excess, least))))
    found = shares_of(strip, chosen, met.worlds, sample_time, theta, ops)
    square = ops.cos(theta / 2) * ops.cos(theta / 2)
    flattest = found.rest - strip.size * (0.25 * width_of(met.worlds)) * square
    return flattest, found.flat + square * found.rest


def limp_walls_margin(strip: Strip, met: WorldsMet, sample_time: Number, theta: Number, ops: ArrayArithmetic) -> Number:
    """Return a margin for K_p = 0 next to theta = 0 and a hand without stiffness, with the tangents at p = r = 0.

    Parameters
    ----------
    strip : over rho^2, with a greatest mass
    met, sample_time, theta, ops : as of `walls_margins`
    """
    found = shares_of(strip, Tangent(1, 0, 0), met.worlds, sample_time, theta, ops)
    return found.flat + ops.cos(theta / 2) * ops.cos(theta / 2) * found.rest


def fails_with_a_wall(design: Design, demands: Demands, hand: Hand, theta: float, share: float) -> bool:
    """Return whether E is negative, in balls, with the mass and the damping of the box with which it is about least.

    Parameters
    ----------
    design : plain numbers
    demands : with the environments and their corner
    hand : held with
    theta : omega T, rad, inside of (0, pi)
    share : of the coupling
    """
    plain, met = demands.worlds, demands.walls_met
    assert plain is not None
    assert met is not None
    exact, at = design_ball(design), arb(theta)
    plant = plant_in_hand(exact.device, Hand(*map(ball, astuple(hand))), delays_of(design.device), BALLS)

    def shares(worlds: Worlds) -> Shares:
        """Return E of a single mass and damping: tangents at p and r themselves."""
        one = WorldsMet(worlds.converted(ball), ball(demands.factor))
        strip = strip_of_walls(plant, exact, at, ball(share), one, BALLS)
        width, square = width_of(one.worlds), (at / 2).cos() ** 2
        slope = square + 2 / width * (sum_of(strip.high) / strip.size)
        tangent = Tangent(ball(0.0), slope, sum_of(strip.excess) / strip.size)
        return shares_of(strip, tangent, one.worlds, exact.device.sample_time, at, BALLS)

    T, low, high = design.device.sample_time, plain.low, plain.high
    u2 = (2 / T * np.tan(theta / 2)) ** 2
    strip = strip_of_walls(plant, exact, at, ball(share), WorldsMet(plain.converted(ball), ball(demands.factor)), BALLS)
    p, r = (float(x / strip.size) for x in (sum_of(strip.high) / (at / 2).cos() ** 2, sum_of(strip.excess)))
    width = width_of(plain)
    mass = float(np.clip(low.mass + (p + width / 2) / u2, low.mass, high.mass))
    damping = low.damping + max(-corner_of(plain) * width / (2 * u2) - r, 0.0)
    ends = World(mass, damping, low.stiffness), World(mass, damping, high.stiffness)
    found = shares(replace(plain, low=ends[0], high=ends[1]))
    return bool(found.flat + (at / 2).cos() ** 2 * found.rest < 0)


def _middle(x: Number) -> Any:
    """Return about the middle of each box."""
    if isinstance(x, Taylor):
        return x.poly[0]
    return x.value.mid if isinstance(x, Jet) else x.mid if isinstance(x, Enclosure) else x


def _ends(x: Number) -> tuple[Floats, Floats]:
    """Return the least and the greatest value over each box, about."""
    over = x.enclosed() if isinstance(x, Taylor) else x.value if isinstance(x, Jet) else x
    return np.asarray(over.mid - over.rad), np.asarray(over.mid + over.rad)
