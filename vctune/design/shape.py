"""What the NLP of a problem contains, and at which frequencies: plain data, known without CasADi."""

from __future__ import annotations

from dataclasses import dataclass, field

from vctune.analysis.stability import Cut
from vctune.design.variables import Coordinate
from vctune.document.problem import Norm, Problem
from vctune.model.quantities import Hold

TERMS = ("admittance", "tracking", "coupling")
DEMANDS = ("ratio", "sensitivity", "stability", "peak")
"""Kinds of constraint, in the order of `Shape.slots`."""
SLOTS = (12, 12, 4, 12)
"""Slots of each kind come in multiples of this, so that few solvers are compiled; open bounds switch off the rest."""


@dataclass(frozen=True, slots=True)
class WorkingSet:
    """Frequencies at which the demands are posed, rad/s, and half planes that keep the gains stable.

    Attributes
    ----------
    ratio, sensitivity, peak : frequencies of Re Z_c >= R, |S| <= max_sensitivity, e <= epigraph
    stability : tangents of the stability boundary
    moving : where |S| peaks near its limit: the NLP follows the peak, whose frequency is a variable of its own
    """

    ratio: list[float] = field(default_factory=list)
    sensitivity: list[float] = field(default_factory=list)
    stability: list[Cut] = field(default_factory=list)
    peak: list[float] = field(default_factory=list)
    moving: list[float] = field(default_factory=list)

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
    hold, delayed : what the response at a variable frequency is made of; only looked at when a peak is followed
    held : whether the damping of an operator eases the conditions
    """

    free: tuple[tuple[int, bool], ...]
    integrator: bool
    terms: tuple[str, ...]
    norm: Norm
    panels: int
    slots: tuple[int, int, int, int]
    moving: int
    hold: Hold
    delayed: bool
    held: bool


def shape_of(
    problem: Problem, free: tuple[Coordinate, ...], frequencies: WorkingSet, panels: int, *, integrator: bool
) -> Shape:
    """Return the shape of the NLP for a problem and a set of frequencies; what cannot act is not in it."""
    weights = problem.transparency.weights
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
        hold=problem.device.hold if frequencies.moving else "zoh",
        delayed=problem.device.delay > 0 if frequencies.moving else False,
        held=problem.device.held.damping > problem.device.damping,
    )


def size(shape: Shape) -> int:
    """Return the number of variables of an NLP: free gains, followed peaks, epigraph."""
    return len(shape.free) + shape.moving + (shape.norm == "peak")
