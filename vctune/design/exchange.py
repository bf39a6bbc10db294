"""IPOPT on a few frequencies; where its answer fails joins the few (an exchange method, DESIGN 1.9).

Everything is local to a start: each NLP is confined to a box in log coordinates around the last point whose loop is
stable, because the demands on single frequencies are also met by unstable loops that lie beyond |S| = inf.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from vctune.analysis.demands import sampled_span
from vctune.analysis.extrema import Floats
from vctune.analysis.stability import clearly_stable, stability_cut
from vctune.design.cases import cases_of, error_of, with_device
from vctune.design.ipopt import NEAR_SIDE, posed, solve
from vctune.design.result import Polished, Round, Solution
from vctune.design.scan import ScanResult
from vctune.design.shape import Place, WorkingSet, places, shape_of
from vctune.design.start import Start
from vctune.design.variables import Coordinate, Point, coordinates, design_of, point
from vctune.design.violations import Violations, least_resistance, near_peak, violations
from vctune.document.problem import Problem
from vctune.model.quantities import Device, Gains
from vctune.proof.interval import Verdict
from vctune.proof.poles import prove_model_poles
from vctune.proof.sampled_loop import prove_sampled_poles

TIGHTENING = 1e-6
ROUNDS = 40
RADIUS = 2.0
GROWTH = 2.0
LEAST_RADIUS = 1e-3
FIRST_FREQUENCIES = 9
PULLED_IN = (1.0, 0.99, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
STABILITY_MARGIN = 1e-4
"""Least distance from the stability boundary, as a share of the open loop's F, where nothing else stops a design."""
MAX_CUTS = 24
PANELS = 4
MAX_PANELS = 256
QUADRATURE_TOLERANCE = 1e-7


def polish(
    problem: Problem,
    start: Start,
    seen: ScanResult,
    *,
    incumbent: float = inf,
    tightening: float = TIGHTENING,
    witnesses: WorkingSet | None = None,
) -> Polished | None:
    """Improve a start to a local optimum of the semi-infinite problem; None if nothing admissible is found.

    Parameters
    ----------
    problem : dimensionless
    start : from the scan
    seen : what the scan saw, which decides which demands the NLP begins with
    incumbent : give up once the error cannot get below this: more frequencies only raise it
    tightening : relative sharpening of the demands
    witnesses : places that a proof has refuted, to begin with
    """
    witnesses, cases = witnesses or WorkingSet(), list(cases_of(problem))
    refuted = dict.fromkeys(place.device for place in (*witnesses.ratio, *witnesses.sensitivity))
    known = {case.device for case in cases}
    cases += [with_device(problem, device) for device in refuted if device not in known]
    reference = _pulled_in(problem, cases, start)
    if reference is None:
        return None
    frequencies = _first_frequencies(problem, start, seen)
    _join(frequencies, Violations(witnesses.ratio, witnesses.sensitivity))
    _follow(frequencies, near_peak(cases, design_of(reference)[0]))
    search = _Search(start, cases, tightening, incumbent, frequencies, reference, reference)
    while len(search.rounds) < ROUNDS and search.radius >= LEAST_RADIUS and not search.finished:
        _step(problem, search)
    return search.best


@dataclass(slots=True)
class _Search:
    """Where a polish stands.

    Attributes
    ----------
    cases : the devices at which the demands are posed
    reference : the last point with sound loops, centre of the box
    warm : where IPOPT starts
    radius : half the box's width in log coordinates
    """

    start: Start
    cases: list[Problem]
    tightening: float
    incumbent: float
    frequencies: WorkingSet
    reference: Point
    warm: Point
    radius: float = RADIUS
    panels: int = PANELS
    rounds: list[Round] = field(default_factory=list)
    best: Polished | None = None
    finished: bool = False


def _step(problem: Problem, search: _Search) -> None:
    """Solve one NLP, see what its answer is worth, and prepare the next."""
    frequencies, integrator = search.frequencies, search.start.gains.position > 0
    free = coordinates(problem, integrator=integrator)
    shape = shape_of(problem, free, frequencies, search.panels, integrator=integrator)
    box = _box(free, search.reference, search.radius)
    solution = solve(shape, posed(problem, shape, free, search.warm, box, frequencies, search.tightening))
    values = _values(free, solution.z, search.reference)
    gains = design_of(values)[0]
    unstable = next((case for case in search.cases if not _stable(case, gains)), None)
    settled = solution.converged and solution.followed and not _at_box(free, solution.z, box)
    search.finished = unstable is None and settled and solution.error > search.incumbent
    if search.finished:
        return
    demands = violations(problem, search.cases, values, search.tightening)
    search.rounds.append(Round(sum(frequencies.sizes()), solution))
    if unstable is not None:
        if not _guard(unstable, frequencies, design_of(search.reference)[0], gains):
            search.radius /= 2
        search.warm = search.reference
        return
    if demands.positive:
        search.reference = values
    asked = frequencies.copy()
    _follow(frequencies, demands.near_peak)
    search.warm = search.reference
    admissible = demands.positive and demands.greatest == 0
    if admissible:
        found = Polished(search.start, values, inf, shape, asked, solution, search.rounds)
        _keep(problem, search, found, settled=settled)
    progress = _join(frequencies, demands) or (admissible and solution.converged)
    search.radius = min(search.radius * GROWTH, RADIUS) if progress else search.radius / 2


def _keep(problem: Problem, search: _Search, found: Polished, *, settled: bool) -> None:
    """Keep an admissible design if it is the best so far; finish if it is a local optimum."""
    error = error_of(problem, *design_of(found.values))
    if search.best is None or error < search.best.error:
        search.best = replace(found, error=error)
    if settled and _rough(problem, found.solution, error, search.panels):
        search.panels *= 2
    elif settled:
        search.finished = True


def _pulled_in(problem: Problem, cases: list[Problem], start: Start) -> Point | None:
    """Return the start, K_p or both gains reduced until its loops are sound: the scan's estimate may be off.

    That is, proved stable and, if that can be had, with Re(D + Z_h) > 0, for else the NLP has no values there.
    """
    bounds, K_v, K_p = problem.bounds, start.gains.velocity, start.gains.position
    stable: Point | None = None
    for velocity, position in ((v * K_v, share * K_p) for share in PULLED_IN for v in (1.0, share)):
        gains = Gains(max(velocity, bounds.velocity.min), max(position, bounds.position.min))
        if all(_stable(case, gains) for case in cases):
            if all(least_resistance(case, gains).value[0] > 0 for case in cases):
                return point(gains, start.coupling)
            stable = stable or point(gains, start.coupling)
    return stable


def _rough(problem: Problem, solution: Solution, error: float, panels: int) -> bool:
    """Return whether the NLP's quadrature is too coarse for its own answer."""
    coarse = abs(solution.error - error) > QUADRATURE_TOLERANCE * error
    return problem.transparency.norm == "rms" and coarse and panels < MAX_PANELS


def _first_frequencies(problem: Problem, start: Start, seen: ScanResult) -> WorkingSet:
    """Return a coarse set with the local extrema at the start; demands that nothing in the scan came near stay out."""
    low, high = sampled_span(problem)
    coarse = np.geomspace(low, high, FIRST_FREQUENCIES)
    first = WorkingSet()
    if problem.bounds.velocity.max > 0 or start.gains.position > 0:
        first.ratio.extend(places(problem.device, coarse))
    if seen.peak_sensitivity > problem.stability.max_sensitivity:
        upto = np.geomspace(problem.nyquist * 1e-2, problem.nyquist, FIRST_FREQUENCIES)
        first.sensitivity.extend(places(problem.device, upto))
    if problem.transparency.norm == "peak":
        band = problem.transparency.band
        first.peak.extend(places(problem.device, np.geomspace(band.min, band.max, FIRST_FREQUENCIES)))
    return first


def _box(free: tuple[Coordinate, ...], reference: Point, radius: float) -> tuple[Floats, Floats]:
    centre = [c.to_z(reference[c.index]) for c in free]
    low = np.array([max(c.low, z - radius) for c, z in zip(free, centre, strict=True)])
    high = np.array([min(c.high, z + radius) for c, z in zip(free, centre, strict=True)])
    return np.minimum(low, high), high


def _at_box(free: tuple[Coordinate, ...], z: Floats, box: tuple[Floats, Floats]) -> bool:
    """Return whether the point lies on a side of the box that is not a bound of the problem."""
    return any(
        (z[k] - box[0][k] < NEAR_SIDE and box[0][k] > c.low) or (box[1][k] - z[k] < NEAR_SIDE and box[1][k] < c.high)
        for k, c in enumerate(free)
    )


def _values(free: tuple[Coordinate, ...], z: Floats, fixed: Point) -> Point:
    values = list(fixed)
    for coordinate, at in zip(free, z, strict=True):
        values[coordinate.index] = coordinate.to_x(float(at))
    return tuple(values)  # type: ignore[return-value]


def _stable(problem: Problem, gains: Gains) -> bool:
    """Return whether all loops are stable; close to the boundary by proof, where an estimate would not do."""
    return all(_loop_stable(device, gains) for device in problem.device.loops)


def _loop_stable(device: Device, gains: Gains) -> bool:
    estimate = clearly_stable(device, gains)
    if estimate is not None:
        return estimate
    return all(prove(device, gains).verdict is Verdict.PROVED for prove in (prove_sampled_poles, prove_model_poles))


def _guard(problem: Problem, frequencies: WorkingSet, inside: Gains, outside: Gains) -> bool:
    """After a step into instability add the tangent of the boundary that was crossed; return whether it is new."""
    cuts = (stability_cut(device, inside, outside, STABILITY_MARGIN) for device in problem.device.loops)
    new = [cut for cut in cuts if cut is not None and cut not in frequencies.stability]
    if len(frequencies.stability) + len(new) > MAX_CUTS:
        return False
    frequencies.stability.extend(new)
    return bool(new)


def _follow(frequencies: WorkingSet, peak: Place | None) -> None:
    """Let the NLP follow the peak of |S| while it is near its limit: a fixed frequency is soon left by the peak."""
    frequencies.moving[:] = [] if peak is None else [peak]


def _join(frequencies: WorkingSet, demands: Violations) -> bool:
    """Add failing frequencies to the working set; return whether any was new."""
    added = [
        _extend(frequencies.ratio, demands.ratio),
        _extend(frequencies.sensitivity, demands.sensitivity),
        _extend(frequencies.peak, demands.peak),
    ]
    return any(added)


def _extend(known: list[Place], candidates: list[Place]) -> bool:
    new = [place for place in candidates if not any(_same(place, other) for other in known)]
    known.extend(new)
    return bool(new)


def _same(place: Place, other: Place) -> bool:
    return abs(place.omega - other.omega) <= 1e-7 * other.omega and place.device == other.device
