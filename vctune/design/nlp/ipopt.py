"""Run IPOPT on a compiled NLP: set its parameters and bounds, and return its answer as plain data."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from functools import lru_cache
from io import StringIO
from math import exp, inf, log, pi
from typing import Any

import casadi as ca
import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.hardest_hands import AtWall
from vctune.analysis.sampled_loop import plant_of, pulse_transfer
from vctune.design.nlp.nlp import compiled
from vctune.design.nlp.nlp_parameters import (
    STABILITY_CUT,
    Layout,
    device_numbers,
    frequency_layout,
    packed,
    plant_numbers,
    tables,
)
from vctune.design.nlp.nlp_structure import NlpStructure
from vctune.design.prepared import Posed
from vctune.design.result import Solution
from vctune.design.search.working_set import TIGHTENING_IN_HANDS, ConstraintPoint, WorkingSet, stacked
from vctune.design.variables import Coordinate, Point
from vctune.interrupt import interrupt_deferred
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hand_arrays import stacked as stacked_hands
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Problem
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import AnyLoopInHand, LoopInHand, loop_in_hand, required_in_hand, seen_in_hand
from vctune.model.sampled.impedance_display import Required, firmware_filter
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.several_devices import alike, as_one
from vctune.model.sampled.worlds.loop_in_worlds import Disjuncts
from vctune.model.sampled.worlds.loop_in_worlds import posed as posed_in
from vctune.model.transparency import TERMS, log_quadrature
from vctune.model.worlds import WorldsMet


@lru_cache(maxsize=1)
def ipopt_version() -> str:
    """Return the version that IPOPT prints in its banner; CasADi shows it nowhere else."""
    banner = StringIO()
    x = ca.SX.sym("x")
    quiet: dict[str, Any] = {"print_time": False, "ipopt.sb": "yes", "ipopt.print_level": 5, "ipopt.max_iter": 0}
    with interrupt_deferred(), redirect_stdout(banner):
        ca.nlpsol("banner", "ipopt", {"x": x, "f": x * x}, quiet)(x0=0)
    found = re.search(r"Ipopt version (\d[\d.]*\d)", banner.getvalue())
    return found[1] if found else "unknown"


NEAR_SIDE = 1e-2  # Distance within which a point counts as lying on a side of the trust box
TRACKING_REACH = 0.5  # Greatest change of the log frequency of a tracked peak of |S| in one NLP


@dataclass(frozen=True, slots=True)
class NlpNumbers:
    """The numbers of an NLP."""

    guess: Floats  # start and bounds of the variables
    parameters: Floats  # parameters of the NLP, in the order of `nlp_parameters.tables`
    low: Floats
    high: Floats
    least: Floats  # bounds of the constraints; least is -inf for an unused constraint
    most: Floats


def numbers_of(
    posed: Posed,
    structure: NlpStructure,
    free: tuple[Coordinate, ...],
    start: Point,
    box: tuple[Floats, Floats],
    working_set: WorkingSet,
    tightening: float,
) -> NlpNumbers:
    """Return the numbers of the NLP of a dimensionless problem on a working set."""
    low, high = (list(bound) for bound in box)
    guess = [min(max(c.to_z(start[c.index]), lo), hi) for c, lo, hi in zip(free, low, high, strict=True)]
    y = [log(point.omega) for point in working_set.tracked_peaks]
    low += [at - TRACKING_REACH for at in y]
    high += [min(at + TRACKING_REACH, log(pi)) for at in y]
    guess += y
    if structure.epigraph:
        low, high, guess = [*low, -inf], [*high, inf], [*guess, 0.0]
    least, most = _demands(posed.problem, structure, working_set, tightening)
    parameters = _parameters(posed, structure, free, start, working_set, tightening)
    return NlpNumbers(np.array(guess), parameters, np.array(low), np.array(high), least, most)


def solve(structure: NlpStructure, given: NlpNumbers) -> Solution:
    """Solve the NLP of a structure with the given numbers. Ctrl-C waits for IPOPT's answer."""
    with interrupt_deferred():
        solver = compiled(structure)
        result = solver(
            x0=given.guess, p=given.parameters, lbx=given.low, ubx=given.high, lbg=given.least, ubg=given.most
        )
        z, error, multipliers = (np.array(result[name]).ravel() for name in ("x", "f", "lam_g"))
        stats = solver.stats()
    first = len(structure.free)
    peaks = slice(first, first + structure.tracked_peaks)
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


def lagrangian(structure: NlpStructure, given: NlpNumbers, solution: Solution) -> float:
    """Return the Lagrangian of an NLP at a guess, with the multipliers and the other unknowns of a solution."""
    unknowns = np.concatenate((given.guess[: len(structure.free)], solution.others))
    multipliers = np.zeros(given.least.shape)
    multipliers[given.least > -inf] = solution.multipliers
    solver = compiled(structure)
    objective, constraints = (
        np.array(solver.get_function(name)(unknowns, given.parameters)).ravel() for name in ("nlp_f", "nlp_g")
    )
    return float(objective[0] + multipliers @ constraints)


def _parameters(
    posed: Posed,
    structure: NlpStructure,
    free: tuple[Coordinate, ...],
    start: Point,
    working_set: WorkingSet,
    tightening: float,
) -> Floats:
    band, position = posed.problem.transparency.band, structure.integrator
    numbers = {"common": _common(posed.problem, structure, free, start)}
    if structure.norm == "rms":
        omega, weight = log_quadrature(band.min, band.max, structure.panels)
        devices = [_at_frequencies(structure, case.device, omega) | {"weight": weight} for case in posed.objective]
        numbers["node"] = {name: np.hstack([device[name] for device in devices]) for name in devices[0]}
    if working_set.ratio:
        numbers["ratio"] = _at_frequencies(structure, *stacked(working_set.ratio))
    if working_set.sensitivity:
        numbers["sensitivity"] = _pulse_transfer(working_set.sensitivity, position=position)
    if working_set.stability:
        numbers["stability"] = _by_name(STABILITY_CUT, working_set.stability)
    if working_set.peak:
        numbers["peak"] = _at_frequencies(structure, *stacked(working_set.peak))
    if working_set.unmodelled:
        radius = [unmodelled_radius(posed, point) for point in working_set.unmodelled]
        found = _pulse_transfer(working_set.unmodelled, position=position)
        numbers["unmodelled"] = found | {"log_radius": np.log(radius)}
    if working_set.in_hand:
        spare, points = max(tightening, TIGHTENING_IN_HANDS), working_set.in_hand
        factor = posed.problem.stability.safety_factor * exp(spare)
        numbers["in_hand"] = _in_hands(points) | {"factor": np.full(len(points), factor)}
        if (met := posed.problem.worlds_met) is not None:
            numbers["in_hand"] |= _in_worlds(len(points), met, spare)
        if structure.walls:
            numbers["in_hand"] |= _in_walls(points)
    if working_set.tracked_peaks:
        plants = [plant_numbers(plant_of(point.device)) for point in working_set.tracked_peaks]
        numbers["tracked_peaks"] = {name: np.array([plant[name] for plant in plants]).T for name in plants[0]}
    return packed(tables(structure), numbers)


def unmodelled_radius(posed: Posed, point: ConstraintPoint) -> float:
    """Return the radius of the unmodelled dynamics at a dimensionless point."""
    assert posed.problem.uncertainty is not None
    return float(FLOATS.interpolated(point.omega / (2 * pi), posed.problem.uncertainty.unmodelled))


def _common(problem: Problem, structure: NlpStructure, free: tuple[Coordinate, ...], start: Point) -> dict[str, Any]:
    device, weights, scales = problem.device, problem.transparency.weights, np.zeros(len(start))
    for coordinate in free:
        scales[coordinate.index] = coordinate.scale
    common = {
        "mass": device.motor_mass,
        "damping": device.damping,
        "scales": scales,
        "fixed": start,
        "weights": [getattr(weights, term) for term in TERMS],
    }
    if structure.operator_damping and device.operator is not None:
        common |= {"operator_damping": device.operator.damping, "safety_factor": problem.stability.safety_factor}
    return common


def _at_frequencies(structure: NlpStructure, device: Device, omega: Floats) -> dict[str, Any]:
    numbers = device_numbers(device_response(device, omega, FLOATS))
    if structure.kind.inverse:
        numbers |= _firmware_filter(device, omega)
    return {name: np.broadcast_to(numbers[name], omega.shape) for name in frequency_layout(structure)}


def _pulse_transfer(points: Sequence[ConstraintPoint], *, position: bool) -> dict[str, Any]:
    G_v, G_x = pulse_transfer(*stacked(points), position=position)
    return {"re_G_v": G_v.real, "im_G_v": G_v.imag, "re_G_x": G_x.real, "im_G_x": G_x.imag}


def _firmware_filter(device: Device, omega: Any) -> dict[str, Any]:
    """Return the response F of the low-passes, keyed by the names of `FIRMWARE_FILTER`. With T = 1, omega equals
    theta."""
    low_pass = firmware_filter(device, omega, FLOATS) or Pair(1.0, 0.0)
    return {"low_pass_re": low_pass.re, "low_pass_im": low_pass.im}


def _in_hands(points: Sequence[ConstraintPoint]) -> dict[str, Any]:
    """Return the loops in hands at some points, keyed by the names of `in_hand_layout`. With T = 1, omega equals
    theta."""
    kind = points[0].device.kind
    if kind.name == "admittance":
        return _loops_in_hands(points)
    columns = [(_command_in_hand if kind.name == "servo" else _force_in_hand)(at) for at in points]
    return {name: np.array([column[name] for column in columns]).T for name in columns[0]}


def _loops_in_hands(points: Sequence[ConstraintPoint]) -> dict[str, Any]:
    """Return both sides of each part of the loops in hands, evaluated together for devices of the same form."""
    theta, found = np.array([min(at.omega, pi) for at in points]), dict[str, Floats]()
    for group in alike([at.device for at in points]):
        device, delays = as_one([points[k].device for k in group], (-1,))
        hand = stacked_hands([at.hand for at in (points[k] for k in group) if at.hand is not None])
        loop = loop_in_hand(plant_in_hand(device, hand, delays, FLOATS), theta[group], FLOATS)
        assert isinstance(loop, LoopInHand)
        for name, part in zip(loop._fields, loop, strict=True):
            for side in ("even", "odd"):
                found.setdefault(f"{name}_{side}", np.zeros(len(points)))[group] = getattr(part, side)
    return {"theta": theta, **found}


def _force_in_hand(at: ConstraintPoint) -> dict[str, Any]:
    """Return the polynomials in K_v of R's numerator and denominator, from the values at K_v = 0, 1 and -1."""
    theta = min(at.omega, pi)
    without, plus, minus = (_required(at, Gains(K_v, 0.0), theta) for K_v in (0.0, 1.0, -1.0))
    lost = without.lost, (plus.lost - minus.lost) / 2
    size = without.size, (plus.size - minus.size) / 2, (plus.size + minus.size) / 2 - without.size
    return {"theta": theta, **_firmware_filter(at.device, theta), "lost": lost, "size": size}


def _command_in_hand(at: ConstraintPoint) -> dict[str, Any]:
    theta = min(at.omega, pi)
    required = _required(at, Gains(0.0, 0.0), theta)
    seen = seen_in_hand(_loop_at(at, theta), Gains(0.0, 0.0))
    return {"theta": theta, "required": required.lost / required.size, "swing": seen.swing / seen.size}


def _in_worlds(count: int, met: WorldsMet, spare: float) -> dict[str, Any]:
    """Return the environments for `count` points, keyed by the names of `WORLDS_IN_HAND`. Infinite limits become 0."""
    ends, names = {"low": met.worlds.low, "high": met.worlds.high}, posed_in(met.worlds, met.factor)
    numbers = {f"environment_{end}_{name}": x for end, world in ends.items() for name, x in asdict(world).items()}
    numbers = {name: x if x < inf else 0.0 for name, x in numbers.items()} | {"reserve": met.factor, "spare": spare}
    numbers |= {f"by_{name}": 1.0 * (name in names) for name in Disjuncts._fields}
    return {name: np.full(count, x) for name, x in numbers.items()}


def _in_walls(points: Sequence[ConstraintPoint]) -> dict[str, Any]:
    """Return the rows of `WALLS_IN_HAND` for some points, keyed by their names."""
    walls = [at.wall or AtWall(1.0, 0.0) for at in points]
    walled = np.array([1.0 * (at.wall is not None) for at in points])
    return {"walled": walled, **{name: np.array([getattr(each, name) for each in walls]) for name in AtWall._fields}}


def _loop_at(at: ConstraintPoint, theta: Any) -> AnyLoopInHand:
    assert at.hand is not None
    return loop_in_hand(plant_in_hand(at.device, at.hand, delays_of(at.device), FLOATS), theta, FLOATS)


def _required(at: ConstraintPoint, gains: Gains, theta: float) -> Required:
    delays = delays_of(at.device)
    if at.hand is None:
        return any_hand(at.device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional).required(gains)
    return required_in_hand(loop_in_hand(plant_in_hand(at.device, at.hand, delays, FLOATS), theta, FLOATS), gains)


def _by_name(layout: Layout, objects: Sequence[Any]) -> dict[str, Any]:
    """Return the fields of objects by name, with one column for each object."""
    return {name: np.array([getattr(each, name) for each in objects]).T for name in layout}


def _demands(
    problem: Problem, structure: NlpStructure, working_set: WorkingSet, tightening: float
) -> tuple[Floats, Floats]:
    stability = problem.stability
    levels = (
        log(stability.safety_factor) + tightening,
        -log(stability.max_sensitivity) + tightening,
        0.0,
        0.0,
        tightening,
        0.0,
    )
    lower = [
        np.where(np.arange(count) < used, level, -inf)
        for count, used, level in zip(structure.capacities, working_set.sizes(), levels, strict=True)
    ]
    tracked = np.tile([levels[1], 0.0], structure.tracked_peaks)
    mean_errors, peaks = structure.mean_errors, structure.tracked_peaks
    upper = np.full(sum(structure.capacities), inf), np.tile([inf, 0.0], peaks), np.full(mean_errors, inf)
    return np.concatenate((*lower, tracked, np.zeros(mean_errors))), np.concatenate(upper)
