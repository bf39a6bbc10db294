"""Seek the worst hand of a box by zooming in on hands and angles, in double precision: it tells the prover where to
look, and how far a coupling is from its limit. What is smooth in the hand is climbed instead (`hardest_hands.py`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats, local_minima
from vctune.analysis.margins import roots
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.hands import Hand, Hands, hands_as_one
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.loop_in_worlds import real_at_nyquist
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.claims.cases import case_at
from vctune.proof.claims.claim import Suspect
from vctune.proof.claims.worlds import margins_in_worlds, sums
from vctune.running import check_time

Complex = NDArray[np.complex128]
ZOOMS = 14  # rounds of hands that are tried, each around the worst of the last and half as far apart
COARSE, BESIDE = 4, np.linspace(0.97, 1.03, 200)  # rounds over all angles; then those beside the last crossing
ANGLES = np.geomspace(1e-5, pi, 800)  # rad
FIRST_SHARES, WORST = (0.0, 0.05, 0.3, 1.0), 3  # shares of each range that are tried first, and hands to zoom in on


class Place(NamedTuple):
    """A number that is worst in a hand at an angle, rad."""

    value: float
    theta: float
    hand: Hand


def first_hands(hands: Hands) -> list[Hand]:
    """Return the hands of a box that are tried first."""
    ends = (sorted({low + share * (high - low) for share in FIRST_SHARES}) for low, high in hands.ranges.values())
    return [Hand(*numbers) for numbers in product(*ends)]


def zoomed(
    worst_of: Callable[[list[Hand], Floats, Place], Place],
    hands: Hands,
    start: Place,
    every: Floats = ANGLES,
    zooms: int = ZOOMS,
) -> Place:
    """Zoom in from a place; `worst_of` returns the worst place of some hands and angles, or the one that it had."""
    best, width, angles = start, 0.5, every
    for zoom in range(zooms):
        best = worst_of(_around(hands, best.hand, width), angles, best)
        width /= 2
        if zoom >= COARSE:
            angles = np.minimum(best.theta * BESIDE, pi)
    return best


def _around(hands: Hands, middle: Hand, width: float) -> list[Hand]:
    """Return the hands of a box up to so many of its widths beside one, without duplicates."""
    rows = []
    for key, (low, high) in hands.ranges.items():
        steps = (getattr(middle, key) + sign * width * (high - low) for sign in (-1, 0, 1))
        rows.append(sorted({float(min(max(step, low), high)) for step in steps}))
    return [Hand(*numbers) for numbers in product(*rows)]


def suspects_of_nominal(design: Design, demands: Demands, devices: Sequence[Device]) -> Iterator[Suspect]:
    """Yield hands of the box in which a pole seems to be on the unit circle, or outside it before a wall."""
    assert demands.hands is not None
    if demands.rigid and isinstance(design.coupling, SpringDamper):
        for device in devices:
            worst = worst_before_wall(device, design.coupling, demands.hands)
            if worst.value < demands.factor:
                yield Suspect(device, worst.hand, (worst.theta, worst.theta))
    elif demands.worlds is not None and demands.worlds.corner is None:
        for device in devices:
            yield from _crossings(replace(design, device=device.undisturbed), demands, device)


def _crossings(design: Design, demands: Demands, device: Device) -> Iterator[Suspect]:
    """Yield the hands and the angles between which a motion with some environment seems neither to grow nor to decay.

    Its reactance must be that of an environment, which on a box without width no sample meets. But where the margin
    below is negative at one end of an interval, and the one above at the other, an environment between has it.
    """
    assert demands.hands is not None and demands.worlds is not None
    found = list[Suspect]()

    def worst_of(near: list[Hand], angles: Floats, _best: Place) -> Place:
        lost, places = _lost(design, demands, near, angles)
        for n in np.argsort(lost)[:2]:
            if lost[n] < 0:
                low, high = angles[places[n] : places[n] + 2]
                found.append(Suspect(device, near[n], (float(low), float(high))))
        least = int(np.argmin(lost))
        return Place(float(lost[least]), float(angles[places[least]]), near[least])

    middle = Place(inf, 0.0, demands.hands.middle)
    zoomed(worst_of, demands.hands, middle, zooms=ZOOMS if demands.worlds.exact else 1)
    yield from found


@np.errstate(all="ignore")
def _lost(design: Design, demands: Demands, hands: list[Hand], angles: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the resistance where the reactance of each loop first is an environment's and least, and the number of the
    angle before it."""
    assert demands.worlds is not None
    check_time()
    found = sums(margins_in_worlds(case_at(design, replace(demands, factor=1.0), hands_as_one(hands, (-1, 1))), angles))
    resistive, above, below = (np.broadcast_to(each, (len(hands), angles.size)) for each in found)
    crossed = (above[:, :-1] < 0) & (below[:, 1:] < 0) | (below[:, :-1] < 0) & (above[:, 1:] < 0)
    share = np.clip(above[:, :-1] / (above[:, :-1] - above[:, 1:]), 0.0, 1.0)
    there = np.where(crossed, resistive[:, :-1] + share * (resistive[:, 1:] - resistive[:, :-1]), np.inf)
    if angles[-1] == pi and real_at_nyquist(design.series, design.device.rule, demands.worlds):
        there[:, -1] = np.minimum(there[:, -1], resistive[:, -1])
    places = there.argmin(axis=1)
    return there[np.arange(len(hands)), places], places


def worst_before_wall(device: Device, wall: SpringDamper, hands: Hands) -> Place:
    """Return the least multiple of a wall that puts a pole on the unit circle in a hand of a box, inf if none does."""

    def worst_of(near: list[Hand], angles: Floats, best: Place) -> Place:
        ratios, places = LoopsBeforeWall.of(device, near, angles).limits(wall)
        least = int(np.argmin(ratios))
        found = Place(float(ratios[least]), float(places[least]), near[least])
        return found if found.value < best.value else best

    tried = first_hands(hands)
    ratios, places = LoopsBeforeWall.of(device, tried, ANGLES).limits(wall)
    starts = [Place(float(ratios[n]), float(places[n]), tried[n]) for n in np.argsort(ratios)[:WORST]]
    return min((zoomed(worst_of, hands, start) for start in starts), key=lambda each: each.value)


class LoopOfWall(NamedTuple):
    """The loop that a wall closes in one hand, L = Z_c times the response to the motor's force."""

    peak: float  # greatest |S| = 1/|1 + L|
    omega: float  # where, rad/s
    phase: float  # least phase shift of L, rad, to instability; inf where |L| < 1


@np.errstate(all="ignore")
def loop_of_wall(device: Device, wall: SpringDamper, hand: Hand) -> LoopOfWall:
    """Return the peak of |S| and the phase margin of the loop that a wall closes."""

    def gain(theta: Floats) -> Complex:
        loop = LoopsBeforeWall.of(device, [hand], theta.ravel())
        L = (wall.damping * loop.velocity + wall.stiffness * loop.position) / loop.open
        return np.asarray(L[0]).reshape(theta.shape)

    quiet = local_minima(lambda theta: np.abs(1 + gain(theta)), ANGLES)
    crossing = gain(roots(lambda theta: np.log(np.abs(gain(theta))), ANGLES))
    phase = float(np.abs(np.pi - np.abs(np.angle(crossing))).min(initial=np.inf))
    return LoopOfWall(1 / float(quiet.value[0]), float(quiet.omega[0]) / device.sample_time, phase)


@dataclass(frozen=True, slots=True)
class LoopsBeforeWall:
    """The loop of an impedance display in some hands at some angles: F = open + b_c velocity + k_c position."""

    angles: Floats  # rad, shape (n,)
    open: Complex  # shape (hands, n)
    velocity: Complex
    position: Complex

    @classmethod
    def of(cls, device: Device, hands: list[Hand], angles: Floats) -> LoopsBeforeWall:
        """Return the loop of a device."""
        check_time()
        loop = loop_in_hand(
            plant_in_hand(device, hands_as_one(hands, (-1, 1)), delays_of(device), FLOATS), angles, FLOATS
        )
        assert isinstance(loop, ForceInHand)
        parts = (loop.open, loop.velocity, loop.position)
        values = (np.asarray(part.even + 1j * np.sin(angles / 2) * part.odd) for part in parts)
        return cls(angles, *(np.broadcast_to(value, (len(hands), angles.size)) for value in values))

    @np.errstate(all="ignore")
    def limits(self, wall: SpringDamper) -> tuple[Floats, Floats]:
        """Return the least multiple of a wall that puts a pole on the circle in each hand, and its angle."""
        multiple = -self.open / (wall.damping * self.velocity + wall.stiffness * self.position)
        real, imag = multiple.real, multiple.imag
        share = np.clip(imag[:, :-1] / (imag[:, :-1] - imag[:, 1:]), 0.0, 1.0)
        there = real[:, :-1] + share * (real[:, 1:] - real[:, :-1])
        crossed = ((imag[:, :-1] < 0) != (imag[:, 1:] < 0)) & (there > 0)
        there = np.where(crossed, there, np.inf)
        if self.angles[-1] == pi:  # where F is real
            there[:, -1] = np.where(real[:, -1] > 0, np.minimum(there[:, -1], real[:, -1]), there[:, -1])
        least, at = np.argmin(there, axis=1), np.arange(len(there))
        return there[at, least], self.angles[least] + share[at, least] * (self.angles[least + 1] - self.angles[least])
