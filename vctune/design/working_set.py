"""Where an exchange poses the demands: frequencies and devices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.stability import Cut
from vctune.model.quantities import Device
from vctune.proof.devices import UNCERTAIN


@dataclass(frozen=True, slots=True)
class ConstraintPoint:
    """Where a demand is posed: a frequency, rad/s, and a device."""

    omega: float
    device: Device


def constraint_points(device: Device, omega: Iterable[float]) -> list[ConstraintPoint]:
    """Return points of one device."""
    return [ConstraintPoint(float(w), device) for w in omega]


def stacked(points: Sequence[ConstraintPoint]) -> tuple[Device, Floats]:
    """Return the devices of n points as one whose numbers are arrays, and their frequencies, all of shape (n,)."""
    omega = np.array([point.omega for point in points])
    mass, damping, delay = (np.array([getattr(point.device, name) for point in points]) for name in UNCERTAIN)
    return replace(points[0].device, mass=mass, damping=damping, delay=delay), omega


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """Points at which the demands are posed, and half planes that keep the gains stable.

    Attributes
    ----------
    ratio, sensitivity, peak : points of Re Z_c >= R, |S| <= max_sensitivity, e <= epigraph
    stability : tangents of the stability boundary
    tracked_peaks : where |S| peaks near its limit: the frequency of the peak is a variable of the NLP
    """

    ratio: list[ConstraintPoint] = field(default_factory=list)
    sensitivity: list[ConstraintPoint] = field(default_factory=list)
    stability: list[Cut] = field(default_factory=list)
    peak: list[ConstraintPoint] = field(default_factory=list)
    tracked_peaks: list[ConstraintPoint] = field(default_factory=list)

    def sizes(self) -> tuple[int, int, int, int]:
        """Return the number of demands of each kind, in the order of `nlp_structure.DEMANDS`."""
        return len(self.ratio), len(self.sensitivity), len(self.stability), len(self.peak)

    def copy(self) -> WorkingSet:
        """Return a set that does not grow with this one."""
        parts = (self.ratio, self.sensitivity, self.stability, self.peak, self.tracked_peaks)
        return WorkingSet(*([*part] for part in parts))
