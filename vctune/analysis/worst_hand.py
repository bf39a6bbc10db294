"""Seek the worst hand of a box by zooming in on hands and angles, in double precision: it tells the prover where to
look, and how far a coupling is from its limit. What is smooth in the hand is climbed instead (`hardest_hands.py`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from math import inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.hands import Hand, Hands, hands_as_one
from vctune.model.sampled.loop_in_worlds import real_at_nyquist
from vctune.proof.claims.cases import case_at
from vctune.proof.claims.claim import Suspect
from vctune.proof.claims.worlds import margins_in_worlds, sums
from vctune.running import check_time

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
    """Yield hands of the box in which a pole seems to be on the unit circle."""
    assert demands.hands is not None
    if demands.worlds is not None and demands.worlds.corner is None:
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
