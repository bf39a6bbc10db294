"""The environment that runs late or by Euler's rules with which a refuted loop grows in a hand (model/README.md,
section 20).

At the witness a member of the box holds a pole on the unit circle. The pole is followed on the way from that member to
each corner of the box, and the member with which it grows most is the witness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple
from functools import partial
from itertools import combinations, product
from math import pi

import numpy as np

from vctune.analysis.destabilising import GrowingEnvironment, impedance_met, zero_near
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.sampled.worlds.loop_in_late_worlds import LEADING
from vctune.model.worlds import Worlds

LEAST = 1e-6
"""Angle next to an end at which no pole is followed; half and twice it find the same growth."""
STEPS = 6
"""Steps from a member to a corner. Half may lose the pole, twice follow the same poles."""
FARTHEST = 0.3
"""Greatest move of a pole in one step, relative to its angle. Half loses some; twice may lead to another."""
GROWTH = 1e-9
"""Growth in a radian from which on a motion counts as growing; it is above Newton's rounding."""
OUTSIDE = 1e-9
"""Share of a range by which rounding may put a member outside of it."""

Member = tuple[float, float, float]


@np.errstate(all="ignore")
def growing_in_time(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, omega: float, worlds: Worlds
) -> GrowingEnvironment | None:
    """Return the environment of a finite box that a loop in a hand grows with, for a frequency where one holds a pole.

    Parameters
    ----------
    device, gains, coupling : a design, plain numbers
    hand : hand in which the constraint is violated
    omega : frequency where it does not hold, rad/s, from 0 to pi/T
    worlds : the box

    Returns
    -------
    GrowingEnvironment or None
        None if no member is found to grow.
    """
    T = device.sample_time
    theta, alone = min(max(omega * T, LEAST), pi - LEAST), impedance_met(device, gains, coupling, hand)

    def unbalance(theta: complex, *, member: Member) -> complex:
        return alone(theta) + complex(np.array(member) @ _factors(theta, T, worlds))

    start = _holding(-alone(theta), _factors(theta, T, worlds), worlds)
    if start is None:
        return None
    corners = product(*zip(astuple(worlds.low), astuple(worlds.high), strict=True))
    found = [each for corner in corners for each in _followed(unbalance, theta, start, corner)]
    growing = [(pole, member) for pole, member in found if pole.imag < -GROWTH * abs(pole)]
    if not growing:
        return None
    pole, (mass, damping, stiffness) = min(growing, key=lambda each: each[0].imag)
    growth, turn = -pole.imag / T, abs((pole.real + pi) % (2 * pi) - pi) / T
    if mass > 0:
        return GrowingEnvironment("mass", mass, damping, growth, turn, stiffness, worlds.rule, worlds.late)
    return GrowingEnvironment("spring", stiffness, damping, growth, turn, 0.0, worlds.rule, worlds.late)


def _factors(theta: complex, sample_time: float, worlds: Worlds) -> np.ndarray:
    """Return what multiplies mass, damping and stiffness."""
    z, q = np.exp(1j * theta), LEADING[worlds.rule]
    mass = {0: 2 * (z - 1) / (z + 1), 1: z - 1, -1: 1 - 1 / z}[q] / sample_time
    spring = 1 / mass if q == 0 else sample_time / {1: z - 1, -1: 1 - 1 / z}[q]
    return np.asarray(z**-worlds.late * np.array([mass, 1.0, spring]))


def _holding(wanted: complex, factors: np.ndarray, worlds: Worlds) -> Member | None:
    """Return a member whose impedance is a wanted one: two of its numbers solve for it, the third is at an end."""
    low, high = (np.array(astuple(end), float) for end in (worlds.low, worlds.high))
    for free in combinations(range(3), 2):
        (fixed,) = {0, 1, 2} - set(free)
        rows = np.array([factors[list(free)].real, factors[list(free)].imag])
        if abs(np.linalg.det(rows)) < 1e-12 * np.abs(rows).max() ** 2:
            continue
        for end in (low, high):
            member = end.copy()
            rest = wanted - factors[fixed] * end[fixed]
            member[list(free)] = np.linalg.solve(rows, [rest.real, rest.imag])
            slack = OUTSIDE * (high - low) + OUTSIDE * np.abs(high)
            if np.all(member >= low - slack) and np.all(member <= high + slack):
                mass, damping, stiffness = np.clip(member, low, high).tolist()
                return mass, damping, stiffness
    return None


def _followed(
    unbalance: Callable[..., complex], theta: float, start: Member, corner: Member
) -> Iterator[tuple[complex, Member]]:
    """Yield a pole and the member that holds it on the way to a corner, as far as it can be followed."""
    pole: complex = complex(theta)
    for share in np.arange(1, STEPS + 1) / STEPS:
        mass, damping, stiffness = ((1 - share) * a + share * b for a, b in zip(start, corner, strict=True))
        member = float(mass), float(damping), float(stiffness)
        found = zero_near(partial(unbalance, member=member), pole)
        if found is None or abs(found - pole) > FARTHEST * abs(pole):
            return
        pole = found
        yield pole, member
