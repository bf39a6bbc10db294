"""Where a search begins, and the points at which it imposes the constraints: frequencies, devices and hands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.hardest_hands import AtWall
from vctune.model.device import Device, devices_as_one
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.proof.claims.claim import Quantity


class Missed(IntEnum):
    """The most serious constraint that a design violates; a greater value is more serious."""

    NOTHING = 0
    COUPLING = 1
    SENSITIVITY = 2
    RESISTANCE = 3
    STABILITY = 4


@dataclass(frozen=True, slots=True)
class Start:
    """A design from which the exchange starts a local optimisation."""

    gains: Gains  # the design, dimensionless
    coupling: AnyCoupling
    error: float  # its transparency error; inf if it violates a constraint at the scan's frequencies
    missed: Missed = Missed.NOTHING  # the most serious constraint that the design violates at these frequencies
    violation: float = 0.0  # amount of the violation, comparable among designs that violate the same constraint
    corner: float | None = None  # corner frequency of the multiplier for walls; None if it is unknown

    @property
    def admissible(self) -> bool:
        """Whether the design meets every constraint at the scan's frequencies."""
        return self.missed is Missed.NOTHING

    @property
    def workable(self) -> bool:
        """Whether the loop is stable and Re(D + Z_h) > 0, so that the formulas of the NLP are defined."""
        return self.missed < Missed.RESISTANCE

    @property
    def rank(self) -> tuple[Missed, float, float]:
        """Sort key of starts: the violated constraint, the violation, then the error."""
        return self.missed, self.violation, self.error


@dataclass(frozen=True, slots=True)
class ConstraintPoint:
    """A point at which the NLP imposes a constraint: a frequency, rad/s, a device, and for some constraints a hand."""

    omega: float
    device: Device
    hand: Hand | None = None
    wall: AtWall | None = None


def constraint_points(device: Device, omega: Iterable[float]) -> list[ConstraintPoint]:
    """Return points of one device at several frequencies."""
    return [ConstraintPoint(float(w), device) for w in omega]


def points_as_one(points: Sequence[ConstraintPoint]) -> tuple[Device, Floats]:
    """Return the devices of n points as one device with arrays of shape (n,), and the points' frequencies."""
    return devices_as_one([point.device for point in points]), np.array([point.omega for point in points])


# The kinds of constraint, in the order of `WorkingSet.sizes`
CONSTRAINT_KINDS = ("ratio", "sensitivity", "peak", "unmodelled", "in_hand")
TIGHTENING_IN_HANDS = 1e-4  # Least relative tightening of the constraint in hands


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """The points at which the NLP imposes the constraints."""

    ratio: list[ConstraintPoint] = field(default_factory=list)  # points for Re Z_c >= safety_factor R
    sensitivity: list[ConstraintPoint] = field(default_factory=list)  # points for |S| <= max_sensitivity
    peak: list[ConstraintPoint] = field(default_factory=list)
    tracked_peaks: list[ConstraintPoint] = field(default_factory=list)  # points where |S| peaks near its limit
    unmodelled: list[ConstraintPoint] = field(default_factory=list)  # points for |1 - S| r < 1
    in_hand: list[ConstraintPoint] = field(default_factory=list)

    def points(self, quantity: Quantity) -> list[ConstraintPoint] | None:
        """Return the points at which the NLP limits the quantity of a claim."""
        known = {
            "ratio": self.ratio,
            "in_hand": self.in_hand,
            "sensitivity": self.sensitivity,
            "unmodelled": self.unmodelled,
        }
        return known.get(quantity)

    def sizes(self) -> tuple[int, ...]:
        """Return the number of constraints of each kind, in the order of `CONSTRAINT_KINDS`."""
        points = self.ratio, self.sensitivity, self.peak, self.unmodelled, self.in_hand
        return tuple(len(each) for each in points)

    def copy(self) -> WorkingSet:
        """Return a copy. Points that the exchange adds to this set later do not join the copy."""
        parts = (getattr(self, part.name) for part in fields(self))
        return WorkingSet(*([*part] for part in parts))

    def on_devices(
        self, changed: Callable[[Device], Device], time: float, held: Callable[[Hand], Hand] = lambda hand: hand
    ) -> WorkingSet:
        """Return the set with other devices, in the same or in other hands."""

        def moved(points: list[ConstraintPoint], stretch: float = 1.0) -> list[ConstraintPoint]:
            return [
                ConstraintPoint(
                    point.omega * stretch,
                    changed(point.device).in_units(1.0, time),
                    point.hand and held(point.hand).in_units(1.0, time),
                    point.wall,
                )
                for point in points
            ]

        return WorkingSet(
            ratio=moved(self.ratio, time),
            sensitivity=moved(self.sensitivity),
            peak=moved(self.peak, time),
            tracked_peaks=moved(self.tracked_peaks),
            unmodelled=moved(self.unmodelled),
            in_hand=moved(self.in_hand),
        )
