"""State the design problem on a finite set of points as a CasADi NLP, and solve it by IPOPT (design/README.md, section
7)."""

from __future__ import annotations

import re
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import lru_cache
from io import StringIO
from math import inf, log, pi
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.nlp.demands import MARGINS, Sought, at_frequencies, constants, error2, tracked_peak
from vctune.design.nlp.solution import NlpStructure, Solution
from vctune.design.nlp.symbols import columns_of, form_of, leaves, rebuilt
from vctune.design.nlp.working_set import CONSTRAINT_KINDS, WorkingSet
from vctune.design.prepared import Posed
from vctune.design.variables import CORNER, Coordinate, Point, coupling_from
from vctune.interrupt import interrupt_deferred
from vctune.model.gains import Gains
from vctune.model.transparency import TERMS, Terms, log_quadrature

# Options of IPOPT
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
    "calc_lam_p": False,
    "expand": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.tol": 1e-9,
    "ipopt.nlp_scaling_method": "none",
    "ipopt.max_iter": 100,
    "ipopt.mu_init": 1e-3,
    "ipopt.mumps_pivot_order": 0,
    "ipopt.barrier_tol_factor": 100.0,
    "ipopt.constr_mult_init_max": 0.0,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.min_refinement_steps": 0,
    "ipopt.max_refinement_steps": 1,
}
# Step in which the slots of each kind of constraint grow in number, and that for hands with a box of environments
STEP, IN_WORLDS = 12, 36
NEAR_SIDE = 1e-2  # Distance within which a point counts as lying on a side of the trust box
TRACKING_REACH = 0.5  # Greatest change of the log frequency of a tracked peak of |S| in one NLP


class Common(NamedTuple):
    """The parameters that all constraints share."""

    fixed: tuple[float, ...]  # the variables of a design where they are fixed, and the scales of those that may be 0
    scales: tuple[float, ...]
    weights: Terms
    safety_factor: float


@dataclass(frozen=True, slots=True)
class Nlp:
    """An NLP with its numbers."""

    structure: NlpStructure
    guess: Floats  # start and bounds of the variables
    parameters: Floats  # the columns of the structure's tables
    low: Floats
    high: Floats
    least: Floats  # bounds of the constraints; least is -inf for an unused constraint
    most: Floats


def stated(
    posed: Posed,
    free: tuple[Coordinate, ...],
    start: Point,
    box: tuple[Floats, Floats],
    points: WorkingSet,
    panels: int,
    tightening: float,
    *,
    integrator: bool,
) -> Nlp:
    """Return the NLP of a dimensionless problem on a working set, from a start within a trust box."""
    problem, stability = posed.problem, posed.problem.stability
    weights = problem.weights
    scales = [0.0] * len(start)
    for coordinate in free:
        scales[coordinate.index] = coordinate.scale
    trees: dict[str, Any] = {
        "common": Common(tuple(map(float, start)), tuple(scales), weights, stability.safety_factor)
    }
    columns = {"common": columns_of([trees["common"]])}
    if problem.transparency.norm == "rms":
        omega, weight = log_quadrature(problem.transparency.band.min, problem.transparency.band.max, panels)
        nodes = [(at_frequencies(case.device, omega), weight) for case in posed.objective]
        trees["node"], columns["node"] = nodes[0], columns_of(nodes)
    found = constants(posed, points, tightening, position=integrator)
    sizes = dict(zip(CONSTRAINT_KINDS, points.sizes(), strict=True))
    steps = dict.fromkeys(CONSTRAINT_KINDS, STEP) | ({} if problem.worlds is None else {"in_hand": IN_WORLDS})
    slots = {kind: -(-sizes[kind] // step) * step for kind, step in steps.items()}
    for kind, tree in found.items():
        known = columns_of([tree])
        trees[kind] = tree
        columns[kind] = known[:, np.minimum(np.arange(slots.get(kind, 1)), known.shape[1] - 1)]
    y = [log(point.omega) for point in points.tracked_peaks]
    structure = NlpStructure(
        kind=problem.device.kind,
        rigid=problem.bounds.damping.min == inf,
        walls=problem.worlds is not None and problem.worlds.walls,
        free=tuple((coordinate.index, coordinate.scale > 0) for coordinate in free),
        integrator=integrator,
        terms=tuple(term for term in TERMS if getattr(weights, term) > 0),
        tables=tuple((name, form_of(tree), columns[name].shape[1]) for name, tree in trees.items()),
        mean_errors=len(posed.objective) if problem.transparency.norm == "rms" and len(posed.objective) > 1 else 0,
        epigraph=problem.transparency.norm == "peak" or len(posed.objective) > 1,
        tracked_peaks=len(y),
    )
    levels = {
        "ratio": log(stability.safety_factor) + tightening,
        "sensitivity": -log(stability.max_sensitivity) + tightening,
        "unmodelled": tightening,
    }
    least = [
        np.where(np.arange(count) < sizes[kind], levels.get(kind, 0.0), -inf)
        for kind, count in ((kind, slots[kind]) for kind in CONSTRAINT_KINDS)
    ]
    peaks, means = np.tile([levels["sensitivity"], 0.0], len(y)), np.zeros(structure.mean_errors)
    most = np.full(sum(slots.values()), inf), np.tile([inf, 0.0], len(y)), np.full(structure.mean_errors, inf)
    low, high = (list(bound) for bound in box)
    guess = [min(max(c.to_z(start[c.index]), lo), hi) for c, lo, hi in zip(free, low, high, strict=True)]
    low, high = [*low, *(at - TRACKING_REACH for at in y)], [*high, *(min(at + TRACKING_REACH, log(pi)) for at in y)]
    guess += y
    if structure.epigraph:
        low, high, guess = [*low, -inf], [*high, inf], [*guess, 0.0]
    return Nlp(
        structure=structure,
        guess=np.array(guess),
        parameters=np.concatenate([each.ravel(order="F") for each in columns.values()]),
        low=np.array(low),
        high=np.array(high),
        least=np.concatenate((*least, peaks, means)),
        most=np.concatenate(most),
    )


@lru_cache(maxsize=16)
def compiled(structure: NlpStructure) -> ca.Function:
    """Return the compiled solver of a structure."""
    return ca.nlpsol("design", "ipopt", assembled(structure), OPTIONS)


def assembled(structure: NlpStructure) -> dict[str, ca.MX]:
    """Return the NLP of a structure: each constraint as a function of one point, mapped over all its points."""
    z, epigraph, y = ca.SX.sym("z", len(structure.free)), ca.SX.sym("t"), ca.SX.sym("y")
    columns = {name: ca.SX.sym(name, len(leaves(form))) for name, form, _ in structure.tables}
    trees = {name: rebuilt(form, iter(ca.vertsplit(columns[name]))) for name, form, _ in structure.tables}
    sought = _design(structure, z, trees["common"], epigraph)
    values = {kind: margin(trees[kind], sought) for kind, margin in MARGINS.items() if kind in trees}
    if "node" in trees:
        at, weight = trees["node"]
        values["node"] = weight * error2(at, sought)
    if "tracked_peaks" in trees:
        values["tracked_peaks"] = tracked_peak(trees["tracked_peaks"], y, sought)
    tables = {name: ca.MX.sym(name, columns[name].rows(), count) for name, _, count in structure.tables}
    Z, Y = ca.MX.sym("z", len(structure.free)), ca.MX.sym("y", structure.tracked_peaks)
    t = ca.MX.sym("t") if structure.epigraph else ca.MX(0)

    def at_each(kind: str, *more: tuple[ca.SX, ca.MX]) -> ca.MX:
        arguments = [z, columns["common"], epigraph, columns[kind], *(symbol for symbol, _ in more)]
        of = ca.Function(kind, arguments, [values[kind]])
        return of.map(tables[kind].columns())(Z, tables["common"], t, tables[kind], *(value for _, value in more))

    demands = [at_each(kind).T for kind in CONSTRAINT_KINDS if kind in trees]
    if structure.tracked_peaks:
        demands.append(ca.vec(at_each("tracked_peaks", (y, Y.T))))
    unknowns, objective = [Z, Y], t
    if "node" in trees:
        squares = at_each("node").T
        if structure.mean_errors:
            squares = ca.reshape(squares, squares.rows() // structure.mean_errors, structure.mean_errors)
        errors = ca.log(ca.sum1(squares)).T / 2
        objective = t if structure.mean_errors else errors
        demands += [t - errors] if structure.mean_errors else []
    unknowns += [t] if structure.epigraph else []
    parameters = ca.vertcat(*(ca.vec(table) for table in tables.values()))
    return {"x": ca.vertcat(*unknowns), "f": objective, "g": ca.vertcat(*demands), "p": parameters}


def _design(structure: NlpStructure, z: ca.SX, common: Common, epigraph: ca.SX) -> Sought:
    """Return the design in symbols."""
    values: list[Any] = list(common.fixed)
    for k, (index, from_zero) in enumerate(structure.free):
        values[index] = common.scales[index] * ca.expm1(z[k]) if from_zero else ca.exp(z[k])
    K_v, K_p, *of_coupling = values[: len(structure.kind.keys)]
    return Sought(
        kind=structure.kind,
        gains=Gains(K_v, K_p if structure.integrator else 0.0),
        coupling=coupling_from([inf, *of_coupling[1:]] if structure.rigid else of_coupling),
        corner=values[CORNER] if structure.walls else None,
        terms=structure.terms,
        weights=common.weights,
        safety_factor=common.safety_factor,
        epigraph=epigraph,
    )


def minimised(given: Nlp) -> Solution:
    """Solve an NLP. Ctrl-C waits for IPOPT's answer."""
    with interrupt_deferred():
        solver = compiled(given.structure)
        result = solver(
            x0=given.guess, p=given.parameters, lbx=given.low, ubx=given.high, lbg=given.least, ubg=given.most
        )
        z, error, multipliers = (np.array(result[name]).ravel() for name in ("x", "f", "lam_g"))
        stats = solver.stats()
    first = len(given.structure.free)
    peaks = slice(first, first + given.structure.tracked_peaks)
    room = np.minimum(z[peaks] - given.low[peaks], given.high[peaks] - z[peaks])
    return Solution(
        z=z[:first],
        error=float(np.exp(error[0])),
        converged=stats["return_status"] in ("Solve_Succeeded", "Solved_To_Acceptable_Level"),
        peak_tracked=bool(np.all(room > NEAR_SIDE)),
        iterations=int(stats["iter_count"]),
        others=z[first:],
        multipliers=multipliers[given.least > -inf],
    )


def lagrangian(given: Nlp, solution: Solution) -> float:
    """Return the Lagrangian of an NLP at its guess, with the multipliers and the other unknowns of a solution."""
    unknowns = np.concatenate((given.guess[: len(given.structure.free)], solution.others))
    multipliers = np.zeros(given.least.shape)
    multipliers[given.least > -inf] = solution.multipliers
    solver = compiled(given.structure)
    objective, margins = (
        np.array(solver.get_function(name)(unknowns, given.parameters)).ravel() for name in ("nlp_f", "nlp_g")
    )
    return float(objective[0] + multipliers @ margins)


@lru_cache(maxsize=1)
def ipopt_version() -> str:
    """Return the version that IPOPT prints in its banner; CasADi shows it nowhere else."""
    banner, x = StringIO(), ca.SX.sym("x")
    quiet: dict[str, Any] = {"print_time": False, "ipopt.sb": "yes", "ipopt.print_level": 5, "ipopt.max_iter": 0}
    with interrupt_deferred(), redirect_stdout(banner):
        ca.nlpsol("banner", "ipopt", {"x": x, "f": x * x}, quiet)(x0=0)
    found = re.search(r"Ipopt version (\d[\d.]*\d)", banner.getvalue())
    return found[1] if found else "unknown"
