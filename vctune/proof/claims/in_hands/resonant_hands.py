"""Hands near a resonance with the device, in coordinates along the resonance (proof/README.md, section 10)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from vctune.model.hands import HAND, MASS, STIFFNESS, Hand, Hands
from vctune.model.numbers.arithmetic import Number
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.array_intervals import Floats, decimal
from vctune.proof.engine.box_tests import Margins
from vctune.proof.engine.boxes import Boxes, Values
from vctune.proof.engine.branching import Decided, Test

RATIO = "stiffness of the hand over the resonant one"
ROWS = tuple(RATIO if key == STIFFNESS else key for key in HAND)  # The parameters of a hand in these coordinates
SHARP = 0.03  # Damping ratio of hand and device below which the resonance gets separate boxes
DAMPED = 0.1  # Damping ratio at the first angle of the resonant boxes
AROUND = (0.5, 2.0)  # Multiples of the resonant stiffness that the resonant boxes cover
SLOWEST = 1e-5  # Least angle of the resonant boxes, rad
WITHIN = 1e-9  # Relative allowance for rounding
DEVICE_MASS = "device.mass"


@dataclass(frozen=True, slots=True)
class Resonance:
    """A sharp resonance between hands and the device."""

    mass: float  # m, kg, unless m is a row; and T, s
    sample_time: float
    least: float  # least and greatest stiffness of the hands, N/m
    greatest: float
    first: float  # least angle of the resonance, rad, > 0

    def margins(self, margins: Margins) -> Margins:
        """Return margins in the coordinates `ROWS` from margins in the parameters of `HAND`."""

        def of_ratio(theta: Number, v: Values) -> tuple[Number, ...]:
            per_sample = theta / decimal(self.sample_time)
            mass = v[MASS] + v.get(DEVICE_MASS, decimal(self.mass))
            return margins(theta, {**v, STIFFNESS: v[RATIO] * (mass * (per_sample * per_sample))})

        return of_ratio

    def left_to_it(self, test: Test, names: tuple[str, ...]) -> Test:
        """Return a test that leaves boxes of `HAND` near the resonance to the boxes of `ROWS`."""
        mass, stiffness = (1 + names.index(name) for name in (MASS, STIFFNESS))

        def tested(boxes: Boxes) -> Decided:
            decided = test(boxes)
            least, most = self._resonant(names, boxes.low), self._resonant(names, boxes.high)
            low, high = boxes.low[stiffness], boxes.high[stiffness]
            inside = (low >= AROUND[0] * most * (1 + WITHIN)) & (high <= AROUND[1] * least * (1 - WITHIN))
            beyond = boxes.low[0] >= self.first
            # boxes that the prover halves until they lie inside
            across = (boxes.low[0] > 0) & ~inside & (low <= most) & (high >= least)
            cost = decided.cost.copy()
            cost[:, across] = 0.0
            # the resonant stiffness is (m + M) (theta/T)^2, so the logarithm of the angle counts twice
            cost[0, across] = 2 * np.log(boxes.high[0] / boxes.low[0])[across]
            cost[mass, across] = np.log((self.mass + boxes.high[mass]) / (self.mass + boxes.low[mass]))[across]
            cost[stiffness, across] = np.log(high / low)[across]
            return replace(decided, proved=decided.proved | (inside & beyond), cost=cost)

        return tested

    def in_range(self, test: Test, names: tuple[str, ...]) -> Test:
        """Return a test that omits boxes of `ROWS` whose stiffness no hand has."""
        ratio = 1 + names.index(RATIO)
        tied = np.array([0, *(1 + k for k, name in enumerate(names) if name in (MASS, DEVICE_MASS, RATIO))])

        def stiffness(numbers: Floats) -> Floats:
            return np.asarray(numbers[ratio] * self._resonant(names, numbers))

        def tested(boxes: Boxes) -> Decided:
            decided = test(boxes)
            low, high, at = stiffness(boxes.low), stiffness(boxes.high), stiffness(decided.point)
            outside = (low > self.greatest * (1 + WITHIN)) | (high < self.least * (1 - WITHIN))
            whole = (low >= self.least) & (high <= self.greatest)
            side = decided.side.copy()
            side[np.ix_(tied, ~whole)] = 0.0  # an end outside the range is not a valid point
            had = (at >= self.least) & (at <= self.greatest)
            return replace(decided, proved=decided.proved | outside, fails=decided.fails & had, side=side)

        return tested

    def hand(self, theta: float, numbers: dict[str, float]) -> Hand:
        """Return the hand at a point of `ROWS`, with its stiffness limited to the hands' range."""
        at = np.array([[theta], *([value] for value in numbers.values())])
        stiffness = float(numbers[RATIO] * self._resonant(tuple(numbers), at)[0])
        return Hand.of({**numbers, STIFFNESS: min(max(stiffness, self.least), self.greatest)})

    def _resonant(self, names: tuple[str, ...], numbers: Floats) -> Floats:
        """Return (m + M) (theta/T)^2 from the frequency and the other rows."""
        mass = numbers[1 + names.index(DEVICE_MASS)] if DEVICE_MASS in names else self.mass
        return np.asarray((mass + numbers[1 + names.index(MASS)]) * (numbers[0] / self.sample_time) ** 2)


def resonance(design: Design, hands: Hands, box: DeviceBox | None = None) -> Resonance | None:
    """Return the sharp resonance of hands with a design without K_p."""
    gains = design.gains
    device, heavy = (design.device, design.device) if box is None else (box.low, box.high)
    if gains.position > 0 or hands.high.stiffness == 0:
        return None
    damping, mass = device.damping + hands.low.damping + gains.velocity, heavy.mass + hands.high.mass
    if damping >= 2 * SHARP * sqrt(hands.high.stiffness * mass):
        return None
    # damping ratio b/(2 m omega) of a resonance at omega = theta/T, solved for the theta at which it is `DAMPED`
    first = damping * device.sample_time / (2 * DAMPED * mass)
    return Resonance(
        design.device.mass, device.sample_time, hands.low.stiffness, hands.high.stiffness, max(first, SLOWEST)
    )
