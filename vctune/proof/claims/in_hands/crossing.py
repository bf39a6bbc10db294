"""Refute stability with a box of environments by one hand and one environment with which the loop has a pole on the
unit circle (model/README.md, section 18)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import pi

import numpy as np
from flint import arb

from vctune.model.device import Device
from vctune.model.hand_arrays import stacked
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.problem import Demands
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.worlds.loop_in_worlds import Disjuncts, sum_of
from vctune.model.worlds import WorldsMet
from vctune.proof.claims.margins_of_claims import Design, margins_in_worlds
from vctune.proof.enclosures.arb_balls import BALLS, ball, design_ball
from vctune.proof.engine.interval import Outcome, Verdict

SHARES = (0.0, 0.5, 1.0)  # hands that are tried, as shares of each range of the box
ANGLES = np.geomspace(1e-5, pi, 800)  # rad
NARROW, HALVINGS = 1e-10, 10  # relative width of a crossing; halvings of it in which the resistance is seen negative


@np.errstate(all="ignore")
def refuted_by_one(design: Design, demands: Demands, devices: Sequence[Device]) -> Outcome | None:
    """Return the refutation by a hand in which a motion with some environment of the box neither grows nor decays.

    Its reactance must be that of an environment, which on a box without width no sample meets. But where the margin
    below is negative at one end of an interval, and the one above at the other, an environment between has it.
    """
    if demands.worlds is None or demands.hands is None or demands.worlds.corner is not None:
        return None
    hands = _tried(demands.hands)
    for device in devices:
        there = Design(device, design.gains, design.coupling)
        plant = plant_in_hand(device, stacked(hands, (-1, 1)), delays_of(device), FLOATS)
        found = margins_in_worlds(plant, there, ANGLES, WorldsMet(demands.worlds, 1.0), FLOATS)
        resistive, above, below = (np.broadcast_to(each, (len(hands), ANGLES.size)) for each in _margins(found))
        first = (above[:, :-1] < 0) & (below[:, 1:] < 0) | (below[:, :-1] < 0) & (above[:, 1:] < 0)
        most = np.where(first, np.maximum(resistive[:, :-1], resistive[:, 1:]), 0.0)
        for place in np.argsort(most.min(axis=1))[:2]:
            k = int(np.argmin(most[place]))
            if most[place, k] < 0 and (theta := _crossing(there, demands, hands[place], *ANGLES[k : k + 2])):
                T = device.sample_time
                return Outcome(Verdict.REFUTED, 0, theta / T, device if len(devices) > 1 else None, hands[place])
    return None


def _tried(hands: Hands) -> list[Hand]:
    """Return hands at the vertices and between them, without duplicates."""
    ends = hands.ranges.values()
    rows = ([float(low + share * (high - low)) for share in SHARES] for low, high in ends)
    return [Hand(*numbers) for numbers in product(*(sorted(set(row)) for row in rows))]


def _margins(found: Disjuncts) -> tuple[Number, Number, Number]:
    """Return the sums of the resistive margin, and of those above and below; one that cannot be positive is -1."""
    above, below = (-1.0 if terms is None else sum_of(terms) for terms in (found.above, found.below))
    return sum_of(found.resistive), above, below


def _crossing(design: Design, demands: Demands, hand: Hand, low: float, high: float) -> float | None:
    """Return an angle next to which a pole is proved on the circle, in ball arithmetic; None if it cannot be proved."""
    assert demands.worlds is not None
    exact, delays = design_ball(design), delays_of(design.device)
    plant = plant_in_hand(exact.device, hand.mapped(ball), delays, BALLS)
    met = WorldsMet(demands.worlds.converted(ball), arb(1))

    def at(first: float, last: float) -> tuple[Number, Number, Number]:
        return _margins(margins_in_worlds(plant, exact, arb(first).union(arb(last)), met, BALLS))

    def is_above(theta: float) -> bool:
        return bool(at(theta, theta)[1] < 0)

    def is_below(theta: float) -> bool:
        return bool(at(theta, theta)[2] < 0)

    rising = is_above(low) and is_below(high)
    if not rising and not (is_below(low) and is_above(high)):
        return None
    while high - low > NARROW * high:
        middle = 0.5 * (low + high)
        if is_above(middle) and is_below(middle):  # an environment within the box
            low = high = middle
        elif is_above(middle) if rising else is_below(middle):
            low = middle
        elif is_below(middle) if rising else is_above(middle):
            high = middle
        else:
            break
    parts = [(low, high)]
    for _ in range(HALVINGS):
        parts = [part for part in parts if not at(*part)[0] < 0]
        if not parts:
            return 0.5 * (low + high)
        parts = [half for a, b in parts for half in ((a, 0.5 * (a + b)), (0.5 * (a + b), b))]
    return None
