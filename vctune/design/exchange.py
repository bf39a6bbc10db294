"""IPOPT on a few frequencies; where its answer fails joins the few (an exchange method, DESIGN 1.9).

Everything is local to a start: each NLP is confined to a box in log coordinates around the last point whose loop is
stable, because the demands on single frequencies are also met by unstable loops that lie beyond |S| = inf.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from time import perf_counter

import numpy as np

from vctune.analysis.demands import (
    demand_grid,
    error_terms,
    ratio_minima,
    response,
    sampled_span,
    sensitivity_maxima,
    stability_ratio,
    towards_zero,
    transparency_error,
    weighted_square,
)
from vctune.analysis.extrema import Floats, Minima, local_minima
from vctune.analysis.stability import clearly_stable, stability_cut
from vctune.design.ipopt import NEAR_SIDE, solve
from vctune.design.result import Polished, Round, Solution
from vctune.design.scan import ScanResult
from vctune.design.shape import WorkingSet, shape_of
from vctune.design.variables import Coordinate, Point, coordinates, design_of, point
from vctune.design.zoom import Start
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Device, Gains
from vctune.proof.interval import Verdict
from vctune.proof.poles import prove_model_poles, prove_sampled_poles

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
FOLLOWED = 0.8
PANELS = 4
MAX_PANELS = 256
QUADRATURE_TOLERANCE = 1e-7


@dataclass(slots=True)
class _Demands:
    """Where the demands are not met at a point, and by how much (relative)."""

    ratio: list[float] = field(default_factory=list)
    sensitivity: list[float] = field(default_factory=list)
    peak: list[float] = field(default_factory=list)
    violation: float = 0.0
    near_peak: float | None = None
    positive: bool = True


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
    witnesses : frequencies that a proof has refuted, to begin with
    """
    reference = _pulled_in(problem, start)
    if reference is None:
        return None
    frequencies = _first_frequencies(problem, start, seen)
    if witnesses is not None:
        _join(frequencies, _Demands(witnesses.ratio, witnesses.sensitivity))
    _follow(frequencies, _near_peak(problem, sensitivity_maxima(problem, design_of(reference)[0])))
    search = _Search(start, perf_counter(), tightening, incumbent, frequencies, reference, reference)
    while len(search.rounds) < ROUNDS and search.radius >= LEAST_RADIUS and not search.finished:
        _step(problem, search)
    return search.best


@dataclass(slots=True)
class _Search:
    """Where a polish stands.

    Attributes
    ----------
    reference : the last point with sound loops, centre of the box
    warm : where IPOPT starts
    radius : half the box's width in log coordinates
    """

    start: Start
    began: float
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
    solution = solve(problem, shape, free, search.warm, box, frequencies, search.tightening)
    values = _values(free, solution.z, search.reference)
    gains, stable = design_of(values)[0], _stable(problem, design_of(values)[0])
    settled = solution.converged and solution.followed and not _at_box(free, solution.z, box)
    search.finished = stable and settled and solution.error > search.incumbent
    if search.finished:
        return
    demands = _check(problem, values, search.tightening)
    seconds, size = perf_counter() - search.began, sum(frequencies.sizes())
    search.rounds.append(Round(seconds, demands.violation, solution.error, size, solution))
    if not stable:
        if not _guard(problem, frequencies, design_of(search.reference)[0], gains):
            search.radius /= 2
        search.warm = search.reference
        return
    if demands.positive:
        search.reference = values
    posed = frequencies.copy()
    _follow(frequencies, demands.near_peak)
    search.warm = search.reference
    admissible = demands.positive and demands.violation == 0
    if admissible:
        found = Polished(search.start, values, inf, shape, posed, solution, search.rounds)
        _keep(problem, search, found, settled=settled)
    progress = _join(frequencies, demands) or (admissible and solution.converged)
    search.radius = min(search.radius * GROWTH, RADIUS) if progress else search.radius / 2


def _keep(problem: Problem, search: _Search, found: Polished, *, settled: bool) -> None:
    """Keep an admissible design if it is the best so far; finish if it is a local optimum."""
    error = transparency_error(problem, *design_of(found.values)).error
    if search.best is None or error < search.best.error:
        search.best = replace(found, error=error)
    if settled and _rough(problem, found.solution, error, search.panels):
        search.panels *= 2
    elif settled:
        search.finished = True


def _pulled_in(problem: Problem, start: Start) -> Point | None:
    """Return the start, K_p or both gains reduced until its loops are sound: the scan's estimate may be off.

    That is, proved stable and, if that can be had, with Re(D + Z_h) > 0, for else the NLP has no values there.
    """
    bounds, K_v, K_p = problem.bounds, start.gains.velocity, start.gains.position
    stable: Point | None = None
    for velocity, position in ((v * K_v, share * K_p) for share in PULLED_IN for v in (1.0, share)):
        gains = Gains(max(velocity, bounds.velocity.min), max(position, bounds.position.min))
        if _stable(problem, gains):
            if _least_resistance(problem, gains).value[0] > 0:
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
        first.ratio.extend(coarse)
    if seen.peak_sensitivity > problem.stability.max_sensitivity:
        first.sensitivity.extend(np.geomspace(problem.nyquist * 1e-2, problem.nyquist, FIRST_FREQUENCIES))
    if problem.transparency.norm == "peak":
        band = problem.transparency.band
        first.peak.extend(np.geomspace(band.min, band.max, FIRST_FREQUENCIES))
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


def _check(problem: Problem, values: Point, tightening: float) -> _Demands:
    """Find where the demands fail by more than half the tightening."""
    gains, coupling = design_of(values)
    stability, found = problem.stability, _Demands()
    ratio = _lowest_ratios(problem, gains, coupling)
    short = np.log(stability.safety_factor) + tightening - np.log(np.maximum(ratio.value, 1e-300))
    found.ratio = [
        float(w) for w, v, s in zip(ratio.omega, ratio.value, short, strict=True) if s > tightening / 2 and v > 0
    ]
    if ratio.value[0] <= 0:
        found.positive = False
        found.ratio.append(float(_least_resistance(problem, gains).omega[0]))
    peaks = sensitivity_maxima(problem, gains)
    over = np.log(-peaks.value / stability.max_sensitivity) + tightening
    found.sensitivity = [float(w) for w, o in zip(peaks.omega, over, strict=True) if o > tightening / 2]
    found.near_peak = _near_peak(problem, peaks)
    found.violation = max(float(short[0]), float(over[0]), 0.0) - tightening / 2
    if problem.transparency.norm == "peak":
        _check_peak(problem, gains, coupling, found, tightening)
    found.violation = max(found.violation, 0.0)
    return found


def _lowest_ratios(problem: Problem, gains: Gains, coupling: Coupling) -> Minima:
    """Return the local minima of Re Z_c / R, with its limit at omega = 0 where R has one above 0."""
    minima, low = ratio_minima(problem, gains, coupling), towards_zero(problem)
    if gains.position == 0 or not low.size:
        return minima
    omega = np.append(low, minima.omega)
    value = np.append(stability_ratio(problem.device, gains, coupling, low), minima.value)
    order = np.argsort(value, kind="stable")
    return Minima(omega[order], value[order])


def _near_peak(problem: Problem, peaks: Minima) -> float | None:
    """Return where |S| is greatest if that is near its limit and below the Nyquist frequency."""
    near = -peaks.value[0] > FOLLOWED * problem.stability.max_sensitivity
    return float(peaks.omega[0]) if near and peaks.omega[0] < problem.nyquist * (1 - 1e-6) else None


def _least_resistance(problem: Problem, gains: Gains) -> Minima:
    grid = demand_grid(problem.device, *sampled_span(problem))
    return local_minima(lambda omega: response(problem.device, gains, omega).resistance, grid)


def _check_peak(problem: Problem, gains: Gains, coupling: Coupling, found: _Demands, tightening: float) -> None:
    band, weights = problem.transparency.band, problem.transparency.weights

    def negative_error(omega: Floats) -> Floats:
        return -np.sqrt(weighted_square(weights, error_terms(problem, gains, coupling, omega)))

    found.peak = [float(w) for w in local_minima(negative_error, demand_grid(problem.device, band.min, band.max)).omega]


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


def _follow(frequencies: WorkingSet, near_peak: float | None) -> None:
    """Let the NLP follow the peak of |S| while it is near its limit: a fixed frequency is soon left by the peak."""
    frequencies.moving[:] = [] if near_peak is None else [near_peak]


def _join(frequencies: WorkingSet, demands: _Demands) -> bool:
    """Add failing frequencies to the working set; return whether any was new."""
    added = [
        _extend(frequencies.ratio, demands.ratio),
        _extend(frequencies.sensitivity, demands.sensitivity),
        _extend(frequencies.peak, demands.peak),
    ]
    return any(added)


def _extend(known: list[float], candidates: list[float]) -> bool:
    new = [w for w in candidates if all(abs(w - k) > 1e-7 * k for k in known)]
    known.extend(new)
    return bool(new)
