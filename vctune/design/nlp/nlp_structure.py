"""The structure of a problem's NLP as plain data that does not need CasADi."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from vctune.design.prepared import Posed
from vctune.design.search.working_set import WorkingSet
from vctune.design.variables import Coordinate
from vctune.model.device import Device
from vctune.model.display import Display
from vctune.model.loop.device_response import device_response
from vctune.model.loop.drive import drive_states
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import VelocityEstimate
from vctune.model.problem import Norm
from vctune.model.transparency import TERMS, TermName

# Names of the kinds of constraint, in the order of `NlpStructure.capacities`
DEMANDS = ("ratio", "sensitivity", "stability", "peak", "unmodelled", "in_hand")
# Steps in which the number of slots for each kind of constraint grows, in the order of `DEMANDS`
CAPACITY_STEPS = (12, 12, 4, 12, 12, 12)
IN_WORLDS = 36  # Step for the loops in hands with a box of environments


@dataclass(frozen=True, slots=True)
class NlpStructure:
    """The content of an NLP. Two problems with the same structure share one compiled solver."""

    kind: Display  # kind of the device
    rigid: bool  # whether b_c is infinite
    worlds: bool  # whether the environments form a box
    walls: bool  # whether the environments include walls
    free: tuple[tuple[int, bool], ...]  # (index among a design's variables, whether it may be 0) for each free variable
    integrator: bool  # whether the law has the term K_p/s
    terms: tuple[TermName, ...]  # terms of the error with a positive weight
    norm: Norm  # "rms", or "peak", which adds an epigraph variable
    panels: int  # number of panels of the quadrature; 0 for "peak"
    capacities: tuple[int, ...]  # number of slots for each kind of constraint in `DEMANDS`
    tracked_peaks: int  # number of peaks of |S| whose frequencies are variables
    operator_damping: bool  # whether the damping of a least operator relaxes the constraints
    parts: tuple[str, ...]  # fields of `DeviceResponse` that the device has and an ideal device lacks
    order: int  # order of the sampled device; 1 for an ideal device
    differenced: bool
    low_passes: int
    uncertain: bool  # whether the device is uncertain
    objective_devices: int  # number of devices whose greatest error is the objective, for "rms"

    @property
    def epigraph(self) -> bool:
        """Whether the objective is the greatest of several values."""
        return self.norm == "peak" or self.mean_errors > 0

    @property
    def mean_errors(self) -> int:
        """Number of constraints that keep the mean error on a device below the epigraph variable."""
        return self.objective_devices if self.objective_devices > 1 else 0

    @property
    def variables(self) -> int:
        """Number of variables: free variables of the design, frequencies of tracked peaks, epigraph."""
        return len(self.free) + self.tracked_peaks + self.epigraph


def nlp_structure(
    posed: Posed, free: tuple[Coordinate, ...], working_set: WorkingSet, panels: int, *, integrator: bool
) -> NlpStructure:
    """Return the structure of the NLP of a problem on a working set. The NLP omits constraints and terms that have no
    effect."""
    problem, weights = posed.problem, posed.problem.transparency.weights
    estimate = problem.device.velocity or VelocityEstimate()
    steps = CAPACITY_STEPS if problem.worlds is None else (*CAPACITY_STEPS[:-1], IN_WORLDS)
    ratio, sensitivity, stability, *others = (
        -(-used // step) * step for used, step in zip(working_set.sizes(), steps, strict=True)
    )
    if sensitivity > 0:  # if |S| is near its limit, so is the stability boundary
        stability = max(stability, CAPACITY_STEPS[DEMANDS.index("stability")])
    return NlpStructure(
        kind=problem.device.kind,
        rigid=problem.bounds.damping.min == inf,
        worlds=problem.worlds is not None,
        walls=problem.worlds is not None and problem.worlds.walls,
        free=tuple((coordinate.index, coordinate.scale > 0) for coordinate in free),
        integrator=integrator,
        terms=tuple(term for term in TERMS if getattr(weights, term) > 0),
        norm=problem.transparency.norm,
        panels=panels if problem.transparency.norm == "rms" else 0,
        capacities=(ratio, sensitivity, stability, *others),
        tracked_peaks=len(working_set.tracked_peaks),
        operator_damping=problem.device.operator is not None and problem.device.operator.damping > 0,
        parts=_parts(problem.device),
        order=1 + len(drive_states(problem.device)) + (2 if problem.device.structure is not None else 0),
        differenced=estimate.source == "difference",
        low_passes=estimate.filter_order if estimate.filter_hz is not None else 0,
        uncertain=problem.uncertainty is not None,
        objective_devices=len(posed.objective) if problem.transparency.norm == "rms" else 1,
    )


def _parts(device: Device) -> tuple[str, ...]:
    """Return the fields of `DeviceResponse` that a device has and an ideal device lacks."""
    at = device_response(device, 1.0, FLOATS)
    return tuple(name for name in ("estimate", "sensor", "spring", "factor") if getattr(at, name) is not None)
