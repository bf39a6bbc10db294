"""The points at which an exchange imposes the constraints: frequencies and devices."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.hardest_hands import AtWall
from vctune.analysis.stability import Cut
from vctune.model.device import Device
from vctune.model.device import stacked as stacked_devices
from vctune.model.hands import Hand
from vctune.proof.claims.registry import Quantity


@dataclass(frozen=True, slots=True)
class ConstraintPoint:
    """A point at which a constraint is imposed: a frequency, rad/s, a device, and for some constraints a hand.

    For walls it has a share of the coupling and a stepping rule; for linear environments `wall` is None.
    """

    omega: float
    device: Device
    hand: Hand | None = None
    wall: AtWall | None = None


def constraint_points(device: Device, omega: Iterable[float]) -> list[ConstraintPoint]:
    """Return points of one device at several frequencies.

    Parameters
    ----------
    device : device in the units of the frequencies
    omega : rad per unit of time
    """
    return [ConstraintPoint(float(w), device) for w in omega]


def stacked(points: Sequence[ConstraintPoint]) -> tuple[Device, Floats]:
    """Return the devices of n points as one device with arrays, and the points' frequencies, all of shape (n,)."""
    return stacked_devices([point.device for point in points]), np.array([point.omega for point in points])


TIGHTENING_IN_HANDS = 1e-4
"""Least relative tightening of the constraint in hands. A design may reach its limit in many hands and at many
frequencies at once, for example at omega = 0 in hands of any mass. The number of boxes in the proof then grows with one
over the square root of this tightening. The error grows by about as much as the tightening."""


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """Points at which the constraints are imposed, and half planes that keep the gains stable.

    Attributes
    ----------
    ratio, sensitivity, peak : points at which Re Z_c >= R, |S| <= max_sensitivity, and e <= epigraph are imposed
    stability : tangents of the stability boundary
    unmodelled : points at which |1 - S| r < 1 is imposed
    in_hand : points at which Re Z_c >= R in a hand is imposed
    tracked_peaks : points where |S| peaks near its limit; the frequency of the peak is a variable of the NLP
    """

    ratio: list[ConstraintPoint] = field(default_factory=list)
    sensitivity: list[ConstraintPoint] = field(default_factory=list)
    stability: list[Cut] = field(default_factory=list)
    peak: list[ConstraintPoint] = field(default_factory=list)
    tracked_peaks: list[ConstraintPoint] = field(default_factory=list)
    unmodelled: list[ConstraintPoint] = field(default_factory=list)
    in_hand: list[ConstraintPoint] = field(default_factory=list)

    def points(self, quantity: Quantity) -> list[ConstraintPoint] | None:
        """Return the points at which a claim's quantity is limited; None for poles, which have tangents instead."""
        known = {
            "ratio": self.ratio,
            "in_hand": self.in_hand,
            "sensitivity": self.sensitivity,
            "unmodelled": self.unmodelled,
        }
        return known.get(quantity)

    def sizes(self) -> tuple[int, ...]:
        """Return the number of constraints of each kind, in the order of `nlp_structure.DEMANDS`."""
        points = self.ratio, self.sensitivity, self.stability, self.peak, self.unmodelled, self.in_hand
        return tuple(len(each) for each in points)

    def copy(self) -> WorkingSet:
        """Return a copy that does not grow with this set."""
        parts = (getattr(self, part.name) for part in fields(self))
        return WorkingSet(*([*part] for part in parts))

    def on_devices(
        self, changed: Callable[[Device], Device], time: float, held: Callable[[Hand], Hand] = lambda hand: hand
    ) -> WorkingSet:
        """Return the same frequencies on other devices, in the same or in other hands.

        If the loop is sampled, the angle omega T stays fixed, so that constraints at Nyquist stay there.

        Parameters
        ----------
        changed : function that converts a device, in the units of the set
        time : sample time of the devices, the unit of time of the new set
        held : function that converts a hand, in the units of the set
        """

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
            stability=self.stability,
            peak=moved(self.peak, time),
            tracked_peaks=moved(self.tracked_peaks),
            unmodelled=moved(self.unmodelled),
            in_hand=moved(self.in_hand),
        )
