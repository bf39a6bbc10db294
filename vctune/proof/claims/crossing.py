"""Find a hand, with an environment or a multiple of a wall, with which the loop has a pole on the unit circle
(model/README.md, sections 15 and 18)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.hands import Hand, Hands, stacked
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.problem import Demands
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.loop_in_worlds import Disjuncts, real_at_nyquist, sum_of
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.claims.cases import case_at, exact_case
from vctune.proof.claims.margins_of_claims import margins_in_worlds
from vctune.proof.enclosures.intervals import ENCLOSURES, Floats, between, surely_negative
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import check_time

Complex = NDArray[np.complex128]
ZOOMS = 14  # rounds of hands that are tried, each around the worst of the last and half as far apart
COARSE, BESIDE = 4, np.linspace(0.97, 1.03, 200)  # rounds over all angles; then those beside the last crossing
ANGLES = np.geomspace(1e-5, pi, 800)  # rad
SHARES, WORST = (0.0, 0.05, 0.3, 1.0), 3  # hands before a wall that are tried first, and number of them to zoom in on
NARROW, HALVINGS = 1e-10, 10  # relative width of a crossing; halvings of it in which the resistance is seen negative


def refuted_by_one(design: Design, demands: Demands, devices: Sequence[Device]) -> Outcome | None:
    """Return the refutation by a hand in which a motion with some environment of the box neither grows nor decays.

    Its reactance must be that of an environment, which on a box without width no sample meets. But where the margin
    below is negative at one end of an interval, and the one above at the other, an environment between has it.
    """
    if demands.worlds is None or demands.hands is None or demands.worlds.corner is not None:
        return None
    for device in devices:
        there, width, angles = Design(device, design.gains, design.coupling), 0.5, ANGLES
        hands = hands_around(demands.hands, demands.hands.middle, width)
        for zoom in range(ZOOMS if demands.worlds.exact else 1):
            lost, places = _lost(there, demands, hands, angles)
            for n in np.argsort(lost)[:2]:
                k = places[n]
                if lost[n] < 0 and (theta := _crossing(there, demands, hands[n], *angles[k : k + 2])):
                    T = device.sample_time
                    return Outcome(Verdict.REFUTED, 0, float(theta) / T, device if len(devices) > 1 else None, hands[n])
            least, width = int(np.argmin(lost)), width / 2
            hands = hands_around(demands.hands, hands[least], width)
            if zoom >= COARSE:
                angles = np.minimum(angles[places[least]] * BESIDE, pi)
    return None


class BeforeWall(NamedTuple):
    """The least multiple of a wall that puts a pole on the unit circle, its frequency, rad/s, and hand."""

    ratio: float  # inf if none does
    omega: float
    hand: Hand


def worst_before_wall(device: Device, wall: SpringDamper, hands: Hands) -> BeforeWall:
    """Return the hand of a box that permits the least multiple of a wall, by an estimate in double precision."""
    ends = (sorted({low + share * (high - low) for share in SHARES}) for low, high in hands.ranges.values())
    tried, found = [Hand(*numbers) for numbers in product(*ends)], list[BeforeWall]()
    first, there = LoopsBeforeWall.of(device, tried, ANGLES).limits(wall)
    for n in np.argsort(first)[:WORST]:
        best, width, angles = BeforeWall(float(first[n]), float(there[n]) / device.sample_time, tried[n]), 0.5, ANGLES
        for zoom in range(ZOOMS):
            near, width = hands_around(hands, best.hand, width), width / 2
            ratios, places = LoopsBeforeWall.of(device, near, angles).limits(wall)
            least = int(np.argmin(ratios))
            if ratios[least] < best.ratio:
                best = BeforeWall(float(ratios[least]), float(places[least]) / device.sample_time, near[least])
            if zoom >= COARSE:
                angles = np.minimum(best.omega * device.sample_time * BESIDE, pi)
        found.append(best)
    return min(found, key=lambda each: each.ratio)


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
        loop = loop_in_hand(plant_in_hand(device, stacked(hands, (-1, 1)), delays_of(device), FLOATS), angles, FLOATS)
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


@np.errstate(all="ignore")
def _lost(design: Design, demands: Demands, hands: list[Hand], angles: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the resistance where the reactance of each loop first is an environment's and least, in double precision,
    and the number of the angle before it."""
    assert demands.worlds is not None
    check_time()
    found = margins_in_worlds(case_at(design, replace(demands, factor=1.0), stacked(hands, (-1, 1))), angles)
    resistive, above, below = (np.broadcast_to(each, (len(hands), angles.size)) for each in _margins(found))
    crossed = (above[:, :-1] < 0) & (below[:, 1:] < 0) | (below[:, :-1] < 0) & (above[:, 1:] < 0)
    share = np.clip(above[:, :-1] / (above[:, :-1] - above[:, 1:]), 0.0, 1.0)
    there = np.where(crossed, resistive[:, :-1] + share * (resistive[:, 1:] - resistive[:, :-1]), np.inf)
    if angles[-1] == pi and real_at_nyquist(design.series, demands.worlds):
        there[:, -1] = np.minimum(there[:, -1], resistive[:, -1])
    places = there.argmin(axis=1)
    return there[np.arange(len(hands)), places], places


def hands_around(hands: Hands, middle: Hand, width: float) -> list[Hand]:
    """Return the hands of a box up to so many of its widths beside one, without duplicates."""
    rows = []
    for key, (low, high) in hands.ranges.items():
        steps = (getattr(middle, key) + sign * width * (high - low) for sign in (-1, 0, 1))
        rows.append(sorted({float(min(max(step, low), high)) for step in steps}))
    return [Hand(*numbers) for numbers in product(*rows)]


def _margins(found: Disjuncts) -> tuple[Number, Number, Number]:
    """Return the sums of the resistive margin, and of those above and below; one that cannot be positive is -1."""
    above, below = (-1.0 if terms is None else sum_of(terms) for terms in (found.above, found.below))
    return sum_of(found.resistive), above, below


def _crossing(design: Design, demands: Demands, hand: Hand, low: float, high: float) -> float | None:
    """Return an angle next to which a pole is proved on the circle; None if it cannot be proved."""
    assert demands.worlds is not None
    there = exact_case(design, replace(demands, factor=1.0), hand)

    def at(first: float, last: float) -> tuple[Number, Number, Number]:
        return _margins(margins_in_worlds(there, between(first, last)))

    def is_above(theta: float) -> bool:
        return surely_negative(at(theta, theta)[1])

    def is_below(theta: float) -> bool:
        return surely_negative(at(theta, theta)[2])

    if high == pi and real_at_nyquist(design.series, demands.worlds):
        last = margins_in_worlds(there, ENCLOSURES.pi)
        if surely_negative(sum_of(last.resistive)):
            return pi
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
        parts = [part for part in parts if not surely_negative(at(*part)[0])]
        if not parts:
            return 0.5 * (low + high)
        parts = [half for a, b in parts for half in ((a, 0.5 * (a + b)), (0.5 * (a + b), b))]
    return None
