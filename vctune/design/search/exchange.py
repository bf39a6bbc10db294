"""The exchange method: solve an NLP with few frequencies, add the frequencies at which its answer violates a
constraint, and repeat."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp, inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.in_hands import least_ratios
from vctune.analysis.in_worlds import corner_of
from vctune.analysis.stability import clearly_stable
from vctune.design.nlp.nlp import NEAR_SIDE, minimised, stated
from vctune.design.nlp.solution import Polished, Solution
from vctune.design.nlp.working_set import ConstraintPoint, Start, WorkingSet, constraint_points
from vctune.design.prepared import Posed, with_device
from vctune.design.search.scan import ScanResult
from vctune.design.search.shapes import scaled_coupling
from vctune.design.search.violations import (
    Violations,
    least_resistance,
    near_peak,
    of_own_loops,
    tightest_at_walls,
    violations,
)
from vctune.design.variables import CORNER, Coordinate, Point, coordinates, design_of, point, ranges
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.problem import Problem
from vctune.proof.claims.poles import stable_loop
from vctune.running import OutOfTimeError, check_time

# Factors of K_p, or of both gains, that the search tries until the loops of a start are stable (`stable`)
GAIN_REDUCTIONS = (1.0, 0.99, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2)


def stabilised(problem: Problem, cases: list[Problem], start: Start) -> Point | None:
    """Return the start with K_p, or both gains, reduced until its loops are stable, as `stable` decides."""
    bounds, K_v, K_p = problem.bounds, start.gains.velocity, start.gains.position
    fallback: Point | None = None
    reduced = ((v * K_v, share * K_p) for share in GAIN_REDUCTIONS for v in (1.0, share))
    within = (Gains(max(v, bounds.velocity.min), max(p, bounds.position.min)) for v, p in reduced)
    for gains in dict.fromkeys(within):
        if all(stable(case, gains) for case in of_own_loops(cases)):
            if all(least_resistance(case, gains).value[0] > 0 for case in cases if case.passive):
                return point(gains, start.coupling)
            fallback = fallback or point(gains, start.coupling)
    return fallback


def stable(problem: Problem, gains: Gains) -> bool:
    """Return whether all loops are stable. Near the stability boundary, where estimates are unreliable, a proof
    decides."""
    return all(_loop_stable(device, gains) for device in problem.device.loops)


def _loop_stable(device: Device, gains: Gains) -> bool:
    estimate = clearly_stable(device, gains)
    if estimate is not None:
        return estimate
    return stable_loop(device, gains, model=True) is True


TIGHTENING = 1e-6  # Relative tightening of the constraints
ROUNDS = 40  # Greatest number of NLPs in an exchange; one to three are usual
STALLED = 8  # Number of rounds within which the greatest violation must halve; otherwise the exchange ends
RADIUS = 2.0  # Half-width of the first trust box, and the greatest half-width, in log coordinates
GROWTH = 2.0  # Factor by which the exchange widens the trust box after a useful answer
NEARER = 0.8  # Ratio of successive violations below which an infeasible answer counts as useful
# Half-width of the trust box at which the exchange ends: 0.1 %, the accuracy to which the search distinguishes basins
LEAST_RADIUS = 1e-3
FIRST_FREQUENCIES = 9  # Number of log-spaced frequencies at which the first NLP imposes each constraint without a hand
PANELS = 4
MAX_PANELS = 256  # First and greatest number of panels of the error's quadrature, with eight nodes each
# Permitted relative difference between the NLP's objective and the error of its answer, for each norm
OBJECTIVE_TOLERANCE = {"rms": 1e-7, "peak": 1e-4}
# Share by which the error of an answer must exceed that of a known design for the exchange to reject the answer
UPHILL = 1e-4


def polish(
    posed: Posed,
    start: Start,
    scanned: ScanResult,
    *,
    incumbent: float = inf,
    tightening: float = TIGHTENING,
    witnesses: WorkingSet | None = None,
    demands: WorkingSet | None = None,
) -> Polished | None:
    """Improve a start to a local optimum of the semi-infinite problem; return None if the exchange finds no feasible
    design."""
    witnesses, cases = witnesses or WorkingSet(), list(posed.cases)
    seen = (*witnesses.ratio, *witnesses.sensitivity, *witnesses.unmodelled, *witnesses.in_hand)
    refuted = dict.fromkeys(point.device for point in seen)
    known = {case.device for case in cases}
    cases += [with_device(posed.problem, device) for device in refuted if device not in known]
    reference = stabilised(posed.problem, cases, start)
    if reference is None:
        return None
    worlds = posed.problem.worlds
    if worlds is not None and worlds.walls:
        corner = worlds.corner or start.corner or corner_of(posed.problem, *design_of(reference))
        reference = (*reference, corner)
    working_set = demands.copy() if demands is not None else _first_working_set(posed, start, scanned)
    if demands is None:
        working_set.in_hand.extend(tightest_at_walls(posed.problem, reference))
    _add_violated(
        working_set,
        Violations(witnesses.ratio, witnesses.sensitivity, unmodelled=witnesses.unmodelled, in_hand=witnesses.in_hand),
    )
    _track_peak(working_set, near_peak(cases, design_of(reference)[0]))
    held = witnesses.in_hand
    search = _Search(
        start, cases, held, tightening, incumbent, working_set, reference, reference, reference, RADIUS, PANELS
    )
    while len(search.rounds) < ROUNDS and search.radius >= LEAST_RADIUS and not search.finished:
        try:
            check_time()
            _step(posed, search)
        except OutOfTimeError:
            if search.best is None:
                raise
            break
    return search.best


@dataclass(slots=True)
class _Search:
    """The state of an exchange."""

    start: Start
    cases: list[Problem]  # problems of the devices at which the relaxation imposes the constraints
    witnesses: list[ConstraintPoint]  # points in hands at which a proof refuted an earlier design
    tightening: float
    incumbent: float
    working_set: WorkingSet
    reference: Point
    warm_start: Point  # design from which IPOPT starts
    known: Point  # the best known feasible design, an answer or the start, and its error
    radius: float  # half-width of the trust box in log coordinates
    panels: int
    rounds: list[Solution] = field(default_factory=list)
    best: Polished | None = None
    known_error: float = inf
    missed: float = 0.0  # greatest violation of the last answer
    trail: list[float] = field(default_factory=list)  # greatest violation of each answer with stable loops
    start_examined: bool = False  # whether the exchange has evaluated the start as a known design
    finished: bool = False


def _step(posed: Posed, search: _Search) -> None:
    """Solve one NLP, evaluate its answer, and prepare the next."""
    problem, working_set, integrator = posed.problem, search.working_set, search.start.gains.position > 0
    tolerance = OBJECTIVE_TOLERANCE[problem.transparency.norm]
    free = coordinates(problem, integrator=integrator)
    box = _box(free, search.reference, search.radius)
    given = stated(
        posed, free, search.warm_start, box, working_set, search.panels, search.tightening, integrator=integrator
    )
    solution = minimised(given)
    values = _values(free, solution.z, search.reference)
    gains = design_of(values)[0]
    sound = all(stable(case, gains) for case in of_own_loops(search.cases))
    settled = solution.converged and solution.peak_tracked and not _at_box(free, solution.z, box)
    search.finished = sound and settled and solution.error > (1 - tolerance) * search.incumbent
    if search.finished:
        return
    demands = violations(posed, search.cases, values, search.tightening, search.witnesses)
    search.rounds.append(solution)
    if not sound:
        search.radius, search.warm_start = search.radius / 2, search.reference
        return
    asked = working_set.copy()
    _track_peak(working_set, demands.near_peak)
    joined, admissible = _add_violated(working_set, demands), demands.positive and demands.greatest == 0
    uphill = False
    if admissible:
        error = posed.error(*design_of(values))
        _examine_start(posed, search, error)
        uphill = error > (1 + UPHILL) * search.known_error
        _remember(search, values, error)
        nlp = given.structure, asked, solution, search.tightening, search.panels
        design = Polished(search.start, values, error, *nlp, search.rounds)
        search.best = min(search.best or design, design, key=lambda each: each.error)
        search.finished = settled and not uphill and not _sharper_objective(problem, search, design, joined=joined)
    if uphill:
        search.reference = search.known
    elif demands.positive:
        search.reference = values
    search.warm_start = search.reference
    nearer, search.missed = demands.positive and demands.greatest < NEARER * search.missed, demands.greatest
    progress = not uphill and (joined or nearer or (admissible and solution.converged))
    search.radius = min(search.radius * GROWTH, RADIUS) if progress else search.radius / 2
    search.trail.append(search.missed)
    known = search.best is not None or (problem.worlds is not None and search.incumbent < inf)
    if known and not admissible and len(search.trail) > STALLED:
        search.finished |= search.missed > search.trail[-1 - STALLED] / 2


def _examine_start(posed: Posed, search: _Search, error: float) -> None:
    """Scale the coupling of the start up until it is feasible, and remember this design if it may be better than an
    answer."""
    if search.start_examined or not (1 + UPHILL) * search.start.error < error:
        return
    search.start_examined = True
    gains, coupling = search.start.gains, search.start.coupling
    corner = search.reference[CORNER:]
    at_start = (*point(gains, coupling), *corner)
    demands = violations(posed, search.cases, at_start, search.tightening, search.witnesses)
    more = exp(demands.greatest + search.tightening) if demands.greatest > 0 else 1.0
    raised = scaled_coupling(coupling, more)
    at_raised = (*point(gains, raised), *corner)
    bounded = all(each.min <= x <= each.max for each, x in zip(ranges(posed.problem), at_raised, strict=False))
    sound = all(stable(case, gains) for case in of_own_loops(search.cases))
    if posed.problem.worlds is not None:  # with environments, a greater coupling may be worse
        sound &= violations(posed, search.cases, at_raised, search.tightening, search.witnesses).greatest == 0
    if sound and demands.positive and not demands.sensitivity and bounded:
        _remember(search, at_raised, posed.error(gains, raised))


def _remember(search: _Search, values: Point, error: float) -> None:
    if error < search.known_error:
        search.known, search.known_error = values, error


def _sharper_objective(problem: Problem, search: _Search, design: Polished, *, joined: bool) -> bool:
    """Refine the objective of the next NLP if it differs from the error of the last answer; return whether it
    changed."""
    norm = problem.transparency.norm
    error = min(design.error, search.best.error) if norm == "peak" and search.best else design.error
    if abs(design.solution.error - error) <= OBJECTIVE_TOLERANCE[norm] * error:
        return False
    if norm == "peak":
        return joined
    search.panels *= 2
    return search.panels <= MAX_PANELS


def _first_working_set(posed: Posed, start: Start, scanned: ScanResult) -> WorkingSet:
    """Return a coarse grid of points and the worst hands at the start."""
    problem, coarse = posed.problem, np.geomspace(*posed.span, FIRST_FREQUENCIES)
    first = WorkingSet()
    if problem.passive and (problem.bounds.velocity.max > 0 or start.gains.position > 0):
        first.ratio.extend(constraint_points(problem.device, coarse))
    if scanned.peak_sensitivity > problem.stability.max_sensitivity:
        upto = np.geomspace(problem.nyquist * 1e-2, problem.nyquist, FIRST_FREQUENCIES)
        first.sensitivity.extend(constraint_points(problem.device, upto))
    if problem.uncertainty is not None and problem.uncertainty.unmodelled:
        upto = np.geomspace(problem.nyquist * 1e-2, problem.nyquist, FIRST_FREQUENCIES)
        first.unmodelled.extend(constraint_points(problem.device, upto))
    worst = least_ratios(problem, start.gains, start.coupling)
    first.in_hand.extend(ConstraintPoint(at.omega, problem.device, at.hand) for at in worst)
    if problem.transparency.norm == "peak":
        band = problem.transparency.band
        first.peak.extend(constraint_points(problem.device, np.geomspace(band.min, band.max, FIRST_FREQUENCIES)))
    return first


def _box(free: tuple[Coordinate, ...], reference: Point, radius: float) -> tuple[Floats, Floats]:
    centre = [c.to_z(reference[c.index]) for c in free]
    low = np.array([max(c.low, z - radius) for c, z in zip(free, centre, strict=True)])
    high = np.array([min(c.high, z + radius) for c, z in zip(free, centre, strict=True)])
    return np.minimum(low, high), high


def _at_box(free: tuple[Coordinate, ...], z: Floats, box: tuple[Floats, Floats]) -> bool:
    """Return whether a point lies on a side of the trust box that is not a bound of the problem."""
    return any(
        (z[k] - box[0][k] < NEAR_SIDE and box[0][k] > c.low) or (box[1][k] - z[k] < NEAR_SIDE and box[1][k] < c.high)
        for k, c in enumerate(free)
    )


def _values(free: tuple[Coordinate, ...], z: Floats, fixed: Point) -> Point:
    values = list(fixed)
    for coordinate, at in zip(free, z, strict=True):
        values[coordinate.index] = coordinate.to_x(float(at))
    return tuple(values)


def _track_peak(working_set: WorkingSet, peak: ConstraintPoint | None) -> None:
    """Make the frequency of the peak of |S| a variable of the NLP, if the peak is near its limit; otherwise track no
    peak."""
    working_set.tracked_peaks[:] = [] if peak is None else [peak]


def _add_violated(working_set: WorkingSet, demands: Violations) -> bool:
    """Add violated points to the working set; return whether any of them was new."""
    added = [
        _add(working_set.ratio, demands.ratio),
        _add(working_set.sensitivity, demands.sensitivity),
        _add(working_set.peak, demands.peak),
        _add(working_set.unmodelled, demands.unmodelled),
        _add(working_set.in_hand, demands.in_hand),
    ]
    return any(added)


def _add(known: list[ConstraintPoint], candidates: list[ConstraintPoint]) -> bool:
    new = [point for point in candidates if not any(_same(point, other) for other in known)]
    known.extend(new)
    return bool(new)


def _same(point: ConstraintPoint, other: ConstraintPoint) -> bool:
    near = abs(point.omega - other.omega) <= 1e-7 * other.omega
    return near and (point.device, point.hand, point.wall) == (other.device, other.hand, other.wall)
