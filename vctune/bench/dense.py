"""Pose the design problem on a fixed grid for any solver, with exact derivatives. This module imports casadi."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.nlp.nlp import OPTIONS, Nlp, assembled, stated
from vctune.design.prepared import Prepared
from vctune.design.result import NlpStructure
from vctune.design.search.rounding import rounded
from vctune.design.search.start import Start
from vctune.design.search.working_set import WorkingSet, constraint_points
from vctune.design.variables import Coordinate, Point, coordinates, design_of, point
from vctune.interrupt import interrupt_deferred
from vctune.model.gains import AnyCoupling, Gains

PANELS = 16  # Number of panels of the objective's quadrature
# Number that replaces an objective that is nan or inf and, with a minus sign, a constraint that is nan or -inf
MISSED = 1e3
# Options of IPOPT on a fixed grid: those of vctune's search, with more iterations
SETTINGS: dict[str, Any] = {**OPTIONS, "ipopt.max_iter": 500}


@dataclass(frozen=True, slots=True)
class DenseProblem:
    """A problem on a fixed grid of frequencies, from one start."""

    prepared: Prepared  # the problem, prepared for the search
    free: tuple[Coordinate, ...]  # the design variables of the NLP
    fixed: Point  # the start's values of all design variables, dimensionless; a design keeps those that are not free
    numbers: Nlp  # the NLP with its numbers

    def values(self, z: Floats) -> tuple[Floats, Floats]:
        """Return the logarithm of the error, of shape (1,), and the constraints in use minus their lower bounds."""
        f, g = functions(self.numbers.structure).values(z, self.numbers.parameters)
        beyond = np.nan_to_num(np.array(g).ravel()[self.posed] - self.levels, nan=-MISSED, neginf=-MISSED)
        return np.nan_to_num(np.array(f).ravel(), nan=MISSED, posinf=MISSED), beyond

    def slopes(self, z: Floats) -> tuple[Floats, Floats]:
        """Return the gradient of the objective, and the Jacobian of the constraints in use."""
        df, dg = functions(self.numbers.structure).slopes(z, self.numbers.parameters)
        return np.array(df).ravel(), np.array(dg)[self.posed]

    @property
    def posed(self) -> Any:
        """Mask that marks the constraint slots in use."""
        return self.numbers.least > -np.inf

    @property
    def levels(self) -> Floats:
        """The lower bounds of the constraints in use."""
        return self.numbers.least[self.posed]

    def design(self, z: Floats) -> tuple[Gains, AnyCoupling]:
        """Return the gains and the coupling of a solution in SI units, within their bounds and rounded as in a file."""
        values = list(self.fixed)
        for coordinate, at in zip(self.free, z, strict=True):
            values[coordinate.index] = coordinate.to_x(float(np.clip(at, coordinate.low, coordinate.high)))
        return design_of(rounded(self.prepared.problem, self.prepared.units.to_si(tuple(values))))


@dataclass(frozen=True, slots=True)
class Functions:
    """The compiled objective and constraints, and their first derivatives, as functions of variables and parameters."""

    values: ca.Function
    slopes: ca.Function


@lru_cache(maxsize=16)
def functions(structure: NlpStructure) -> Functions:
    """Return the compiled functions of a structure's NLP."""
    with interrupt_deferred():
        nlp = assembled(structure)
        x, p, f, g = nlp["x"], nlp["p"], nlp["f"], nlp["g"]
        return Functions(
            ca.Function("values", [x, p], [f, g]).expand(),
            ca.Function("slopes", [x, p], [ca.gradient(f, x), ca.jacobian(g, x)]).expand(),
        )


def dense(prepared: Prepared, start: Start, count: int, reserve: float) -> DenseProblem:
    """Impose the constraints of a problem on a fixed grid: `count` frequencies for Llewellyn's conditions, and `count`
    for |S|."""
    integrator = start.gains.position > 0
    posed, scaled = prepared.scaled, prepared.scaled.problem
    free = coordinates(scaled, integrator=integrator)
    low, high = posed.span
    band = scaled.transparency.band
    working_set = WorkingSet(
        ratio=constraint_points(scaled.device, np.geomspace(low, high, count)),
        sensitivity=constraint_points(
            scaled.device, np.geomspace(min(band.min, 1e-3 * scaled.nyquist), scaled.nyquist, count)
        ),
        peak=constraint_points(scaled.device, np.geomspace(band.min, band.max, count))
        if scaled.transparency.norm == "peak"
        else [],
    )
    fixed = point(start.gains, start.coupling)
    box = (np.array([c.low for c in free]), np.array([c.high for c in free]))
    numbers = stated(posed, free, fixed, box, working_set, PANELS, reserve, integrator=integrator)
    return DenseProblem(prepared, free, fixed, numbers)


@dataclass(frozen=True, slots=True)
class Stopped:
    """The final point of a solver, and whether the solver reports convergence."""

    z: Floats
    converged: bool


@lru_cache(maxsize=32)
def compiled(structure: NlpStructure) -> ca.Function:
    """Return IPOPT, compiled for the NLP of a structure."""
    return ca.nlpsol("peer", "ipopt", assembled(structure), SETTINGS)


def ipopt(dense: DenseProblem) -> Stopped:
    """Solve a problem on its grid by IPOPT."""
    given = dense.numbers
    with interrupt_deferred():
        solver = compiled(dense.numbers.structure)
        found = solver(
            x0=given.guess, p=given.parameters, lbx=given.low, ubx=given.high, lbg=given.least, ubg=given.most
        )
        return Stopped(np.array(found["x"]).ravel(), bool(solver.stats()["success"]))
