"""Find the stiffest coupling of a given shape with which an impedance display renders walls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np

from vctune.analysis.hardest_hands import needs_in_hands
from vctune.analysis.in_hands import RatioInHand, least_ratios_in_hands
from vctune.analysis.loops_in_hands import angles
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hand_arrays import PlacesInHands, stacked
from vctune.model.hands import Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import AnyLoopInHand, loop_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import WorldsMet

PER_DECADE = 24  # Number of angles per decade in the hands at the corners of their box
# Angles at which the code evaluates a new place, relative to the angle of that place
AROUND = np.exp(np.linspace(-0.1, 0.1, 21))
# Number of scales, number of halvings of the interval below the first scale that suffices, and greatest factor between
# the scales
TRIED, HALVINGS, SOFTEST = 24, 10, 1e4


@dataclass(slots=True)
class KnownPlaces:
    """A device in the hands and at the angles at which the search evaluates couplings."""

    device: Device  # the device, and the box of its hands
    hands: Hands
    theta: np.ndarray = field(init=False)  # angles and loops at the known places, shape (n,)
    loop: AnyLoopInHand = field(init=False)
    _known: PlacesInHands = field(init=False)

    def __post_init__(self) -> None:
        corners, theta = stacked(self.hands.corners), angles(self.device, PER_DECADE)[1:]
        count = corners.mass.size
        self._join(PlacesInHands(np.tile(theta, count), corners.mapped(lambda x: np.repeat(x, theta.size))))

    def _join(self, known: PlacesInHands) -> None:
        plant = plant_in_hand(self.device, known.hands, delays_of(self.device), FLOATS)
        self.theta, self.loop, self._known = known.at, loop_in_hand(plant, known.at, FLOATS), known

    def add(self, places: Sequence[RatioInHand]) -> None:
        """Add places with the angles around them."""
        new = [(min(at.omega * self.device.sample_time * turn, np.pi), at.hand) for at in places for turn in AROUND]
        self._join(self._known.joined(PlacesInHands.of(new)))

    def suffices(self, gains: Gains, coupling: AnyCoupling, met: WorldsMet, reserve: float) -> bool:
        """Return whether a design has a reserve at every known place."""
        need = needs_in_hands(self.loop, self.device, gains, coupling, self.theta, met)
        return bool(np.nanmax(need) * reserve <= 1)

    def lacking(self, gains: Gains, coupling: AnyCoupling, met: WorldsMet, reserve: float) -> list[RatioInHand]:
        """Return the places in all hands of the box at which a design lacks the reserve."""
        found = least_ratios_in_hands(self.device, self.hands, gains, coupling, met)
        return [at for at in found if at.ratio < reserve]


def least_scale(suffices: Callable[[float], bool], low: float, high: float) -> float:
    """Return about the least scale that suffices; inf if none of the evaluated scales does."""
    scales = np.geomspace(low, min(high, SOFTEST * low), TRIED) if high > low else np.array([low])
    first = next((k for k, scale in enumerate(scales) if suffices(float(scale))), None)
    if not first:
        return inf if first is None else float(scales[0])
    below, above = float(scales[first - 1]), float(scales[first])
    for _ in range(HALVINGS):
        middle = float(np.sqrt(below * above))
        below, above = (below, middle) if suffices(middle) else (middle, above)
    return above
