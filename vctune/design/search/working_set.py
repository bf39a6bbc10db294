"""The points at which an exchange imposes the constraints: frequencies, devices and hands."""

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
    """A point at which the NLP imposes a constraint: a frequency, rad/s, a device, and for some constraints a hand.

    For the constraint on walls, `wall` has a share of the coupling and an integration rule; for all other constraints
    it is None.
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
    omega : frequencies, rad per unit of time
    """
    return [ConstraintPoint(float(w), device) for w in omega]


def stacked(points: Sequence[ConstraintPoint]) -> tuple[Device, Floats]:
    """Return the devices of n points as one device with arrays of shape (n,), and the points' frequencies.

    A number that all devices share stays a plain number.
    """
    return stacked_devices([point.device for point in points]), np.array([point.omega for point in points])


TIGHTENING_IN_HANDS = 1e-4
"""Least relative tightening of the constraint in hands. This constraint may be active in many hands and at many
frequencies at once, for example at omega = 0 in hands of any mass. The number of boxes in the proof then grows as the
inverse square root of this tightening. The tightening increases the error by about the same share."""


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """The points at which the NLP imposes the constraints, and half planes of gains that keep the loop stable.

    Attributes
    ----------
    ratio : points for Re Z_c >= safety_factor R
    sensitivity : points for |S| <= max_sensitivity
    stability : tangents of the stability boundary
    peak : points at which the error must not exceed the epigraph variable, for the norm "peak"
    unmodelled : points for |1 - S| r < 1
    in_hand : points for Re Z_c >= safety_factor R in a hand, for Re(1/Z_c) of an impedance display, for the margins
        with a box of environments, and for walls
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
        """Return the points at which the NLP limits the quantity of a claim.

        The result is None for the claims on poles, for which the set has tangents instead, and for the claims on
        storage functions, which the search does not use.
        """
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
        """Return a copy. Points that the exchange adds to this set later do not join the copy."""
        parts = (getattr(self, part.name) for part in fields(self))
        return WorkingSet(*([*part] for part in parts))

    def on_devices(
        self, changed: Callable[[Device], Device], time: float, held: Callable[[Hand], Hand] = lambda hand: hand
    ) -> WorkingSet:
        """Return the set with other devices, in the same or in other hands.

        For constraints on the sampled loop the angle omega T stays the same, so a point at Nyquist stays at Nyquist.
        For the other constraints the frequency stays the same.

        Parameters
        ----------
        changed : function that converts a device, in the units of the set
        time : sample time of the new devices, in the set's unit of time; this time is the new set's unit of time
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
