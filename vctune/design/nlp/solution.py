"""The structure of an NLP, the point at which IPOPT stopped, and the local optimum that an exchange reached."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vctune.analysis.extrema import Floats
from vctune.design.nlp.working_set import Start, WorkingSet
from vctune.design.variables import Point
from vctune.model.display import Display
from vctune.model.transparency import TermName


@dataclass(frozen=True, slots=True)
class NlpStructure:
    """The content of an NLP. Two problems with the same structure share one compiled solver."""

    kind: Display  # kind of the device
    rigid: bool  # whether b_c is infinite
    walls: bool  # whether the environments include walls
    free: tuple[tuple[int, bool], ...]  # (index among a design's variables, whether it may be 0) for each free variable
    integrator: bool  # whether the law has the term K_p/s
    terms: tuple[TermName, ...]  # terms of the error with a positive weight
    tables: tuple[tuple[str, Any, int], ...]  # name, form and number of columns of each table of parameters
    mean_errors: int  # number of devices whose greatest mean error is the objective; 0 for one device
    epigraph: bool  # whether the objective is the greatest of several values
    tracked_peaks: int  # number of peaks of |S| whose frequencies are variables

    @property
    def variables(self) -> int:
        """Number of variables: free variables of the design, frequencies of tracked peaks, epigraph."""
        return len(self.free) + self.tracked_peaks + self.epigraph


@dataclass(frozen=True, slots=True)
class Solution:
    """The point at which IPOPT stopped."""

    z: Floats  # coordinates of the free variables
    error: float  # objective at this point
    converged: bool  # whether IPOPT reports convergence, which proves nothing
    peak_tracked: bool  # whether the tracked peak of |S| stayed within its limits
    iterations: int  # number of IPOPT iterations
    others: Floats  # the other unknowns: log frequencies of tracked peaks, and the epigraph variable if there is one
    multipliers: Floats  # Lagrange multipliers of the constraints that the working set uses, in the order of the NLP


@dataclass(frozen=True, slots=True)
class Polished:
    """A local optimum in dimensionless units, which meets the constraints at every frequency in double precision,
    without proof."""

    start: Start  # the start from which the exchange reached the optimum
    values: Point  # the variables of the design
    error: float  # transparency error
    structure: NlpStructure  # the NLP whose answer this is, its working set, and the point at which IPOPT stopped
    working_set: WorkingSet
    solution: Solution
    tightening: float  # relative tightening of the constraints
    panels: int  # of the error's quadrature
    rounds: list[Solution]  # the answers of the exchange's NLPs
