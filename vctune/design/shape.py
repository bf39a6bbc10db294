"""What the NLP of a problem contains, and at which frequencies: plain data, known without CasADi."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.stability import Cut
from vctune.design.prepared import Posed
from vctune.design.variables import Coordinate
from vctune.model.problem import Norm
from vctune.model.quantities import Device
from vctune.proof.devices import UNCERTAIN

TERMS = ("admittance", "tracking", "coupling")
DEMANDS = ("ratio", "sensitivity", "stability", "peak")
"""Kinds of constraint, in the order of `Shape.slots`."""
SLOTS = (12, 12, 4, 12)
"""Slots of each kind come in multiples of this, so that few solvers are compiled; open bounds switch off the rest."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a demand is posed: a frequency, rad/s, and a device."""

    omega: float
    device: Device


def places(device: Device, omega: Iterable[float]) -> list[Place]:
    """Return places of one device."""
    return [Place(float(w), device) for w in omega]


def stacked(at: Sequence[Place]) -> tuple[Device, Floats]:
    """Return the devices of some places as one whose numbers are arrays, and their frequencies."""
    omega = np.array([place.omega for place in at])
    mass, damping, delay = (np.array([getattr(place.device, name) for place in at]) for name in UNCERTAIN)
    return replace(at[0].device, mass=mass, damping=damping, delay=delay), omega


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """Places at which the demands are posed, and half planes that keep the gains stable.

    Attributes
    ----------
    ratio, sensitivity, peak : places of Re Z_c >= R, |S| <= max_sensitivity, e <= epigraph
    stability : tangents of the stability boundary
    moving : where |S| peaks near its limit: the NLP follows the peak, whose frequency is a variable of its own
    """

    ratio: list[Place] = field(default_factory=list)
    sensitivity: list[Place] = field(default_factory=list)
    stability: list[Cut] = field(default_factory=list)
    peak: list[Place] = field(default_factory=list)
    moving: list[Place] = field(default_factory=list)

    def sizes(self) -> tuple[int, int, int, int]:
        """Return the number of demands of each kind."""
        return len(self.ratio), len(self.sensitivity), len(self.stability), len(self.peak)

    def copy(self) -> WorkingSet:
        """Return a set that does not grow with this one."""
        parts = (self.ratio, self.sensitivity, self.stability, self.peak, self.moving)
        return WorkingSet(*([*part] for part in parts))


@dataclass(frozen=True, slots=True)
class Shape:
    """What an NLP contains; two problems of one shape share one compiled solver.

    Attributes
    ----------
    free : (index in `NAMES`, whether it may be 0) for each variable
    integrator : whether the law has its K_p/s term
    terms : terms of the error with a positive weight
    norm : "rms" or "peak" (an epigraph variable is added)
    panels : panels of the quadrature, 0 for "peak"
    slots : numbers of ratio, sensitivity, stability and peak constraints
    moving : number of peaks of |S| that are followed
    held : whether the damping of an operator eases the conditions
    uncertain : whether the demands are posed at several devices, whose numbers then come with each frequency
    counted : number of devices the greatest of whose errors is the objective, for "rms"
    """

    free: tuple[tuple[int, bool], ...]
    integrator: bool
    terms: tuple[str, ...]
    norm: Norm
    panels: int
    slots: tuple[int, int, int, int]
    moving: int
    held: bool
    uncertain: bool
    counted: int

    @property
    def epigraph(self) -> bool:
        """Whether the objective is the greatest of several values."""
        return self.norm == "peak" or self.errors > 0

    @property
    def errors(self) -> int:
        """Number of constraints that keep a device's error in the mean below the epigraph."""
        return self.counted if self.counted > 1 else 0


def shape_of(
    posed: Posed, free: tuple[Coordinate, ...], frequencies: WorkingSet, panels: int, *, integrator: bool
) -> Shape:
    """Return the shape of the NLP for a problem and a set of frequencies; what cannot act is not in it."""
    problem, weights = posed.problem, posed.problem.transparency.weights
    slots = [-(-used // step) * step for used, step in zip(frequencies.sizes(), SLOTS, strict=True)]
    if slots[1] > 0:  # where |S| can bind the stability boundary is near
        slots[2] = max(slots[2], SLOTS[2])
    return Shape(
        free=tuple((coordinate.index, coordinate.scale > 0) for coordinate in free),
        integrator=integrator,
        terms=tuple(term for term in TERMS if getattr(weights, term) > 0),
        norm=problem.transparency.norm,
        panels=panels if problem.transparency.norm == "rms" else 0,
        slots=(slots[0], slots[1], slots[2], slots[3]),
        moving=len(frequencies.moving),
        held=problem.device.held.damping > problem.device.damping,
        uncertain=problem.uncertainty is not None,
        counted=len(posed.objective) if problem.transparency.norm == "rms" else 1,
    )


def size(shape: Shape) -> int:
    """Return the number of variables of an NLP: free gains, followed peaks, epigraph."""
    return len(shape.free) + shape.moving + shape.epigraph
