"""Environments of bounded stiffness at low frequencies: the sampled condition tends to the continuous one.

The continuous condition is derived here, not cited. Let Y(s) = Z_c(s) + Z_seen(s) be the impedance that meets the
environment b + k/s + m s, b >= 0, 0 <= k <= k_2, m >= 0. A pole lies at j omega if Re Y = -b <= 0 and -Im Y = m omega -
k/omega for some of them, which is so if -Im Y >= -k_2/omega. Hence the stiffness is bounded by

    k_2 < min omega Im Y(j omega) over the frequencies with Re Y(j omega) <= 0.

Bounded passive impedances thus relax Llewellyn's condition Re Y > 0, as in the bounded-impedance absolute stability of
Haddadi and Hashtrudi-Zaad, whose own condition is for two bounded ports in scattering variables.
"""

from __future__ import annotations

from math import inf, pi

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand, seen_in_hand
from vctune.model.sampled.loop_in_worlds import disjuncts, offered_at, sum_of
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import World, Worlds

MASS, DAMPING, DELAY = 0.4, 2.0, 6e-3
GAINS, COUPLING = Gains(13.2, 818.0), Coupling(70.6, 0.498, 0.22)
OMEGA = np.geomspace(1.0, 300.0, 3000)
HANDS = (Hand(0.0, 0.0, 800.0), Hand(0.3, 1.0, 2500.0), Hand(0.1, 5.0, 3000.0))


def continuous_limit(hand: Hand) -> float:
    """Return the least upper bound of the stiffness in continuous time, N/m."""
    s = 1j * OMEGA
    Z_h, law = (
        hand.mass * s + hand.damping + hand.stiffness / s,
        (GAINS.velocity + GAINS.position / s) * np.exp(-s * DELAY),
    )
    Z_seen = Z_h * law / (MASS * s + DAMPING + Z_h + law)
    Z_c = COUPLING.drag + COUPLING.damping * COUPLING.mass * s / (COUPLING.damping + COUPLING.mass * s)
    Y = Z_c + Z_seen
    return float(np.where(Y.real <= 0, OMEGA * Y.imag, inf).min())


def sampled_limit(hand: Hand, sample_time: float) -> float:
    """Return the greatest stiffness with which a margin of the sampled loop is positive everywhere, N/m."""
    device, theta = Device(MASS, DAMPING, sample_time, DELAY), OMEGA * sample_time
    loop = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS)
    seen, at = seen_in_hand(loop, GAINS), offered_at(COUPLING, sample_time, theta, FLOATS)

    def holds(stiffness: float) -> bool:
        worlds = Worlds(World(0.0, 0.0, 0.0), World(inf, inf, stiffness))
        found = disjuncts(at, worlds, sample_time, seen, 1.0, theta, FLOATS)
        assert found.below is not None and found.above is None
        return bool(((np.asarray(sum_of(found.resistive)) > 0) | (np.asarray(sum_of(found.below)) > 0)).all())

    low, high = 1e-3, 1e9
    assert holds(low) and not holds(high)
    while high / low > 1 + 1e-7:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def test_the_bound_of_stiffness_tends_to_that_of_continuous_time() -> None:
    """In proportion to the sample time: the hold is half a sample late."""
    for hand in HANDS:
        limit = continuous_limit(hand)
        assert 1.0 < limit < 1e4
        off = [abs(sampled_limit(hand, T) / limit - 1) for T in (4e-4, 1e-4, 2.5e-5)]
        assert off[2] < 0.03
        assert off[1] < 0.5 * off[0] and off[2] < 0.5 * off[1]
    assert OMEGA[-1] * 2.5e-5 < pi / 100
