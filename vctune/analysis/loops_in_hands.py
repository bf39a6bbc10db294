"""Evaluate loops in some hands of a box at some angles, in double precision."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats, with_resonance
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.any_hand import AnyHand, any_hand
from vctune.model.sampled.hand_loop import AnyLoopInHand, loop_in_hand, required_in_hand, seen_in_hand
from vctune.model.sampled.loop_in_worlds import ZSeen
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand

GRID_SHARES = (0.0, 0.01, 0.1, 0.4, 1.0)  # Shares of each range of hands that the search evaluates first
LOWEST, PER_DECADE = 1e-4, 24  # Least angle omega T above 0, and number of angles per decade
SOFT = np.geomspace(1e-12, 1.0, 97)  # Shares of the range of stiffness that the search evaluates at angle 0


@dataclass(frozen=True, slots=True)
class LoopsInHands:
    """A loop in hands on the unit circle."""

    theta: Floats  # omega T, rad, from 0 to pi, shape (n,)
    hands: Hand  # hands with numbers of shape (h,)
    loop: AnyLoopInHand  # loop, with numbers of shape (h, n)

    def required(self, gains: Gains) -> Floats:
        """Return R with the shape of the loop."""
        found = required_in_hand(self.loop, gains)
        with np.errstate(divide="ignore", invalid="ignore"):
            R = np.asarray(found.lost / found.size)
        return np.broadcast_to(R, np.broadcast_shapes(R.shape, np.shape(gains.velocity)))  # no gain affects a servo's R

    def seen(self, gains: Gains) -> ZSeen:
        """Return Z_seen with the shape of `required`."""
        found = seen_in_hand(self.loop, gains)
        shape = np.broadcast_shapes(np.shape(found.lost), np.shape(gains.velocity))
        return ZSeen(*(np.broadcast_to(part, shape) for part in found))


@dataclass(frozen=True, slots=True)
class LoopsInAnyHand:
    """The loop of an impedance display in any passive hand on the unit circle."""

    theta: Floats  # omega T, rad, from 0 to pi, shape (n,)
    answers: AnyHand  # response of the device, with numbers of shape (1, n)

    def required(self, gains: Gains) -> Floats:
        """Return R/s^2 with shape (1, n); inf where some hand makes the loop with only K_v unstable."""
        found = self.answers.required(gains)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(found.size > 0, found.lost / found.size, inf))


@lru_cache(maxsize=64)
def loops_in_any_hand(device: Device, per_decade: int = PER_DECADE) -> LoopsInAnyHand:
    """Return the loop of an impedance display in any passive hand at some angles."""
    theta = angles(device, per_decade)
    return LoopsInAnyHand(theta, answers(device, theta[None]))


def answers(device: Device, theta: Floats) -> AnyHand:
    """Return the response of an impedance display in any passive hand."""
    delays = delays_of(device)
    return any_hand(device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional)


@lru_cache(maxsize=128)
def loops_in_hands(
    device: Device, hands: Hands, shares: tuple[float, ...] = GRID_SHARES, per_decade: int = PER_DECADE
) -> LoopsInHands:
    """Return the loop of a device in some hands of a box at some angles."""
    theta = angles(device, per_decade)
    return _loops(device, _every(hands.low.mapped(lambda low, high: _places(low, high, shares), hands.high)), theta)


def _loops(device: Device, hands: Hand, theta: Floats) -> LoopsInHands:
    plant = plant_in_hand(device, hands.mapped(lambda number: number[:, None]), delays_of(device), FLOATS)
    return LoopsInHands(theta, hands, loop_in_hand(plant, theta, FLOATS))


def _every(numbers: Hand) -> Hand:
    """Return the hands of all combinations of given parameters; the last parameter varies fastest."""
    each = np.meshgrid(*numbers.numbers.values(), indexing="ij")
    return Hand(*(number.ravel() for number in each))


def angles(device: Device, per_decade: int) -> Floats:
    """Return angles from 0 to pi, with more of them near a resonance of the device."""
    theta = np.geomspace(LOWEST, np.pi, int(per_decade * np.log10(np.pi / LOWEST)))
    if device.structure is not None:
        theta = np.minimum(with_resonance(device, theta / device.sample_time) * device.sample_time, np.pi)
    return np.append(0.0, theta)


@lru_cache(maxsize=64)
def loops_at_rest(device: Device, hands: Hands, spacing: int = 1) -> LoopsInHands:
    """Return the loop of a device at angle 0 in hands with soft springs, or next to 0 in hands with none. The spring
    that requires the most depends on the gains."""
    low, high = hands.low, hands.high
    stiffness = np.unique(low.stiffness + (high.stiffness - low.stiffness) * np.append(0.0, SOFT[::spacing]))
    masses = np.unique((low.mass, high.mass))
    rest = np.array([0.0 if high.stiffness > 0 else LOWEST])
    return _loops(device, _every(replace(low, mass=masses, stiffness=stiffness)), rest)


def _places(low: float, high: float, shares: tuple[float, ...]) -> Floats:
    """Return the values at given shares of a range; a single value if the range has no width."""
    return np.unique(low + (high - low) * np.array(shares))
