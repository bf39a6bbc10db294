"""Pose a problem on a fixed grid of frequencies and hands for other solvers. This module imports casadi."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import exp, inf
from time import process_time
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from vctune.analysis.extrema import Floats
from vctune.analysis.sampled_loop import spectral_radius
from vctune.design.nlp.nlp import OPTIONS, Nlp, assembled, stated
from vctune.design.nlp.solution import NlpStructure
from vctune.design.nlp.working_set import ConstraintPoint, Start, WorkingSet, constraint_points
from vctune.design.prepared import Prepared
from vctune.design.search.optimum import WORTH_POLISHING
from vctune.design.variables import Coordinate, coordinates, design_of, point, ranges, rounded
from vctune.interrupt import interrupt_deferred
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.problem import Problem

PANELS = 16  # Number of panels of the objective's quadrature
RESERVE = 1e-5  # Relative tightening of the constraints without a hand, about what 2000 frequencies miss between them
BELOW_NYQUIST = 1e-3  # Least frequency in hands, as a share of the Nyquist frequency
MIDDLE = 0.1  # Middle value of a number of a hand, as a share of the greatest, if the box begins at 0
MAX_VIOLATION = 1e-6  # Greatest violation on its own grid with which an answer counts as feasible there
MISSED = 1e3  # Objective, or violation of a constraint, that stands for nan and inf; violation of an unstable loop
PENALTY = 100.0  # Weight of the violation in the objective of differential evolution
PATIENCE = 30.0  # Processor time, s, after which a solver stops
IPOPT: dict[str, Any] = {**OPTIONS, "ipopt.max_iter": 500, "ipopt.max_cpu_time": PATIENCE}


class Compiled(NamedTuple):
    """Objective and constraints, their first derivatives, and IPOPT, as functions of an NLP's numbers."""

    values: ca.Function
    slopes: ca.Function
    ipopt: ca.Function


@lru_cache(maxsize=16)
def compiled(structure: NlpStructure) -> Compiled:
    """Compile the NLP of a structure."""
    with interrupt_deferred():
        nlp = assembled(structure)
        x, p, f, g = (nlp[name] for name in "xpfg")
        slopes = ca.Function("slopes", [x, p], [ca.gradient(f, x), ca.jacobian(g, x)])
        values = ca.Function("values", [x, p], [f, g])
        return Compiled(values.expand(), slopes.expand(), ca.nlpsol("peer", "ipopt", nlp, IPOPT))


@dataclass(frozen=True, slots=True)
class GridProblem:
    """A dimensionless problem on a grid, from one start."""

    prepared: Prepared
    start: Start
    free: tuple[Coordinate, ...]  # the design variables of the NLP
    numbers: Nlp  # the NLP with its numbers, and its functions
    compiled: Compiled

    def values(self, z: Floats) -> tuple[float, Floats]:
        """Return the logarithm of the error, and the constraints, which are at least 0 where they are met."""
        f, g = (np.array(each).ravel() for each in self.compiled.values(z, self.numbers.parameters))
        slack = np.nan_to_num((g - self.numbers.least)[self._used], nan=-MISSED, posinf=MISSED, neginf=-MISSED)
        return float(np.nan_to_num(f, nan=MISSED, posinf=MISSED)[0]), slack

    def slopes(self, z: Floats) -> tuple[Floats, Floats]:
        """Return the gradient of the objective, and the Jacobian of the constraints."""
        df, dg = self.compiled.slopes(z, self.numbers.parameters)
        return np.array(df).ravel(), np.array(dg)[self._used]

    @property
    def _used(self) -> Any:
        return self.numbers.least > -inf

    def design(self, z: Floats) -> tuple[Gains, AnyCoupling]:
        """Return the gains and the coupling of a solution in SI units, within their bounds and rounded as in a file."""
        values = list(point(self.start.gains, self.start.coupling))
        for coordinate, at in zip(self.free, z, strict=True):
            values[coordinate.index] = coordinate.to_x(float(np.clip(at, coordinate.low, coordinate.high)))
        return design_of(rounded(self.prepared.problem, self.prepared.units.to_si(tuple(values))))

    def judged(self, z: Floats) -> tuple[float, float]:
        """Return the logarithm of the error, and the violation on the grid and of the stability of the bare loop."""
        log_error, slack = self.values(z)
        stable = spectral_radius(self.prepared.problem.device, self.design(z)[0]) < 1
        return log_error, max(0.0, -float(slack.min())) if stable else MISSED


def on_grid(prepared: Prepared, start: Start, count: int) -> GridProblem:
    """Pose a problem on `count` frequencies for Llewellyn's conditions and for |S|, and at as many points in hands."""
    posed, scaled = prepared.scaled, prepared.scaled.problem
    device, nyquist, integrator = scaled.device, scaled.nyquist, start.gains.position > 0
    upto = np.geomspace(min(scaled.transparency.band.min, BELOW_NYQUIST * nyquist), nyquist, count)
    ratio = constraint_points(device, np.geomspace(*posed.span, count))
    points = WorkingSet(ratio=ratio, sensitivity=constraint_points(device, upto))
    if scaled.hands_met is not None:
        hands = hands_of(scaled.hands_met)
        shared = np.geomspace(BELOW_NYQUIST * nyquist, nyquist, count // len(hands)).tolist()
        points.in_hand.extend(ConstraintPoint(omega, device, hand) for hand in hands for omega in shared)
    free, fixed = coordinates(scaled, integrator=integrator), point(start.gains, start.coupling)
    box = np.array([each.low for each in free]), np.array([each.high for each in free])
    numbers = stated(posed, free, fixed, box, points, PANELS, RESERVE, integrator=integrator)
    return GridProblem(prepared, start, free, numbers, compiled(numbers.structure))


def random_starts(problem: Problem, count: int, seed: int) -> list[Start]:
    """Return random designs of a dimensionless problem, evenly spread over the logarithms of what is free."""
    rng, starts = np.random.default_rng(seed), list[Start]()
    free = coordinates(problem, integrator=problem.bounds.position.max > 0)
    for _ in range(count):
        values = [bounds.min for bounds in ranges(problem)]
        for each in free:
            values[each.index] = each.to_x(rng.uniform(each.low, each.high))
        starts.append(Start(*design_of(tuple(values)), error=0.0))  # nothing is known of where it leads
    return starts


def hands_of(box: Hands) -> list[Hand]:
    """Return the hands with a low, a middle and a high value of each number of a box."""
    values = []
    for low, high in zip(box.low.numbers.values(), box.high.numbers.values(), strict=True):
        values.append(sorted({low, np.sqrt(low * high) or MIDDLE * high, high}))
    return [Hand(*numbers) for numbers in product(*values)]


Stopped = tuple[Floats, bool]  # Type of a solver's final point, and whether the solver reports success
Solver = Callable[[GridProblem], Stopped]  # Type of a function that solves a problem on its grid from one start


def ipopt(posed: GridProblem) -> Stopped:
    """Solve by IPOPT with exact first and second derivatives."""
    given, solver = posed.numbers, posed.compiled.ipopt
    with interrupt_deferred():
        bounds = {"lbx": given.low, "ubx": given.high, "lbg": given.least, "ubg": given.most}
        found = solver(x0=given.guess, p=given.parameters, **bounds)
        return np.array(found["x"]).ravel(), bool(solver.stats()["success"])


def slsqp(posed: GridProblem) -> Stopped:
    """Solve by SciPy's SLSQP with exact first derivatives."""
    beyond = {"type": "ineq", "fun": lambda z: posed.values(z)[1], "jac": lambda z: posed.slopes(z)[1]}
    with warnings.catch_warnings(action="ignore"):  # SLSQP warns about its own progress
        found = minimize(
            lambda z: posed.values(z)[0],
            posed.numbers.guess,
            method="SLSQP",
            jac=lambda z: posed.slopes(z)[0],
            bounds=Bounds(posed.numbers.low, posed.numbers.high),
            constraints=beyond,
            options={"maxiter": 200, "ftol": 1e-10},
        )
    return np.asarray(found.x), bool(found.success)


def evolution(posed: GridProblem) -> Stopped:
    """Solve by SciPy's differential evolution with a penalty, until its designs agree or its time is over."""
    late, box = process_time() + PATIENCE, Bounds(posed.numbers.low, posed.numbers.high)

    def penalised(z: Floats) -> float:
        log_error, missed = posed.judged(z)
        return log_error + PENALTY * missed

    def stop(*_: Any, **__: Any) -> bool:
        return process_time() > late

    found = differential_evolution(penalised, box, callback=stop, rng=0, tol=1e-6, polish=False)
    return np.asarray(found.x), bool(found.success)


class Answer(NamedTuple):
    """The best answer of a solver over its starts."""

    refuted: bool  # whether the solver's own grid refutes it
    score: float  # its violation if it is refuted, else the logarithm of its error
    design: tuple[Gains, AnyCoupling]
    succeeded: bool  # whether the solver reports success


def best_answer(problems: list[GridProblem], solve: Solver) -> tuple[Answer, bool]:
    """Run a solver from every start that can still win: return its best answer, and whether its time was over."""
    answers: list[Answer] = []
    began = process_time()
    for posed in problems:
        least = min((answer.score for answer in answers if not answer.refuted), default=inf)
        hopeless = posed.start.error > WORTH_POLISHING * exp(least)
        if answers and (process_time() - began > PATIENCE or hopeless):
            continue
        z, succeeded = solve(posed)
        log_error, missed = posed.judged(z)
        refuted = missed > MAX_VIOLATION
        answers.append(Answer(refuted, missed if refuted else log_error, posed.design(z), succeeded))
    return min(answers, key=lambda answer: answer[:2]), process_time() - began > PATIENCE
