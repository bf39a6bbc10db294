"""The design problem from start to end: scan, polish, round, prove; the best proved design wins (DESIGN 1.9)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from vctune.design.cases import with_device
from vctune.design.exchange import TIGHTENING, polish
from vctune.design.infeasible import nearest_miss
from vctune.design.judge import Judgement, Status, judge
from vctune.design.result import Polished, Solved
from vctune.design.rounding import DIGITS, rounded
from vctune.design.scan import ScanResult, drained, elsewhere, rescan, scan
from vctune.design.shape import Place, WorkingSet
from vctune.design.theorems import impossible
from vctune.design.variables import design_of, physical
from vctune.design.zoom import Start
from vctune.document.problem import Problem, Range
from vctune.model.quantities import Coupling, Gains
from vctune.model.transparency import Terms
from vctune.proof.certificate import Claim
from vctune.proof.interval import Outcome, Verdict

if TYPE_CHECKING:
    from vctune.design.bound import Glance, Optimality
    from vctune.design.leaves import Unfinished

WORTH_POLISHING = 1.05
"""A start is polished if its scanned error is at most this much above the best polished one."""
PROOF_ROUNDS, MORE_DIGITS = 4, 2
LONG_SHOTS = 2
"""How many starts are polished when none is admissible."""
NEARLY = 0.1
"""A start that misses a demand by more than this share is not polished where only an opinion is wanted."""
SHARPENING = 10.0
SEARCH_BOXES, SEARCH_GAP = 300_000, 0.01
"""Effort of the search for a design, or for the proof that there is none, where the optimiser found none; how good a
design it is content with."""
EARLY_BOXES = 20_000
"""Effort of a first proof that there is no design, before the optimiser tries to make one of what is none."""
BOUND_BOXES = 20_000_000
"""Effort of the search for a bound that was asked for."""

Progress = Callable[[str], None]


@np.errstate(all="ignore")
def solve(problem: Problem, progress: Progress = lambda stage: None, *, gap: float | None = None) -> Solved:
    """Find the most transparent admissible design and prove it; judge it when every number is fixed.

    Where the optimiser finds none, a search over all designs (`vctune.design.bound`) finds one, or proves that there is
    none, or gives up. Where the device is uncertain, the nominal device alone is solved for too: its design is a start,
    and its error says what robustness costs.

    Parameters
    ----------
    problem : Problem
    progress : told the stage of the work
    gap : prove that no design has an error lower by more than this share
    """
    began = perf_counter()
    if problem.bounds.fixed:
        fixed = judge(problem, *problem.fixed_design)
        return Solved(problem, fixed, None, 0, None, None, {"prove": perf_counter() - began})
    theorem = impossible(problem)
    if theorem is not None:
        return Solved(problem, None, None, 0, theorem, None, {})
    progress("scanning")
    scaled = dimensionless(problem)
    seen = scan(scaled)
    scanned = perf_counter()
    early = None if any(start.admissible for start in seen.starts) else _early(problem)
    if early is not None and early.proved:
        miss = nearest_miss(problem, scaled, seen, proved=True)
        seconds = {"scan": scanned - began, "bound": perf_counter() - scanned}
        return Solved(problem, None, None, 0, miss, seen, seconds, early)
    nominal = _nominal_starts(problem, progress)
    optima = _optima(scaled, replace(seen, starts=[*nominal, *seen.starts]), progress)
    polished = perf_counter()
    progress("proving")
    best, judgement = _best_proved(problem, scaled, seen, optima)
    if judgement is None and optima:  # what seemed best is not admissible: try what seemed worse
        tried = [optimum.start for optimum in optima]
        optima = _optima(scaled, replace(seen, starts=[s for s in seen.starts if s not in tried]), progress, worth=inf)
        best, judgement = _best_proved(problem, scaled, seen, optima)
    if judgement is not None and problem.transparency.weights.coupling == 0:
        judgement = _with_least_coupling(problem, judgement)
    seconds = {"scan": scanned - began, "polish": polished - scanned, "prove": perf_counter() - polished}
    nominal_error = nominal[0].error if nominal else None
    solved = Solved(problem, judgement, best, len(optima), None, seen, seconds, nominal_error=nominal_error)
    if judgement is None or gap is not None:
        solved = _searched(solved, progress, gap, early.rest if early else None)
    if solved.judgement is None:
        proved = solved.optimality is not None and solved.optimality.proved
        solved = replace(solved, infeasibility=nearest_miss(problem, scaled, seen, proved=proved))
    return solved


def _nominal_starts(problem: Problem, progress: Progress) -> list[Start]:
    """Return the best design for the nominal device of an uncertain one, dimensionless: its basin may be the best."""
    if problem.uncertainty is None:
        return []
    nominal = solve(replace(problem, uncertainty=None), progress).judgement
    if nominal is None:
        return []
    Z, T = problem.transparency.reference_impedance, problem.device.sample_time
    gains, coupling = nominal.gains, nominal.coupling
    law = Gains(gains.velocity / Z, gains.position * T / Z)
    return [Start(law, Coupling(coupling.damping / Z, coupling.mass / (Z * T), coupling.drag / Z), nominal.error)]


@np.errstate(all="ignore")
def attainable(problem: Problem) -> bool:
    """Return whether the optimiser finds a certified design of a problem that leaves something free; proves nothing.

    It stops at the first, and where it finds none no box is searched: an opinion in a fraction of the time of `solve`.
    """
    if impossible(problem) is not None:
        return False
    scaled = dimensionless(problem)
    seen = scan(scaled)
    for start in [start for start in seen.starts[:LONG_SHOTS] if start.admissible] or seen.starts[:1]:
        hopeful = start.workable and start.shortfall < NEARLY
        optimum = polish(scaled, start, seen) if hopeful else None
        judgement = _best_proved(problem, scaled, seen, [optimum])[1] if optimum is not None else None
        if judgement is not None and _meets_demands(problem, judgement):
            return True
    return False


def _early(problem: Problem) -> Optimality:
    """Search the boxes for a short while: where the scan met no admissible point there may be nothing to polish."""
    from vctune.design.bound import bound

    return bound(problem, None, lambda gains, limit: None, gap=SEARCH_GAP, most_boxes=EARLY_BOXES)


def _searched(solved: Solved, progress: Progress, gap: float | None, rest: Unfinished | None) -> Solved:
    """Search the boxes that are left, or all: for a design where there is none, for a bound where it was asked for."""
    from vctune.design.bound import bound

    problem, began = solved.problem, perf_counter()

    def tell(at: Glance) -> None:
        progress(f"searching every box: {at}")

    most, within = (SEARCH_BOXES, SEARCH_GAP) if gap is None else (BOUND_BOXES, gap)
    improve = partial(improved, problem)
    found = bound(problem, solved.judgement, improve, gap=within, most_boxes=most, rest=rest, progress=tell)
    seconds = {**solved.seconds, "bound": perf_counter() - began}
    if found.improved is None:
        return replace(solved, optimality=found, seconds=seconds)
    return replace(solved, judgement=found.improved, polished=None, optimality=found, seconds=seconds)


@np.errstate(all="ignore")
def improved(problem: Problem, gains: Gains, incumbent: float) -> Judgement | None:
    """Return a certified design with an error below the incumbent's, found from given gains; None if there is none."""
    scaled = dimensionless(problem)
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    start = rescan(scaled, Gains(gains.velocity / impedance, gains.position * time / impedance))
    target = incumbent / _unit_of_error(problem)
    if start is None or start.error >= target:
        return None
    seen = scan(scaled)
    optimum = polish(scaled, start, seen, incumbent=target)
    judgement = _best_proved(problem, scaled, seen, [optimum])[1] if optimum is not None else None
    if judgement is None or not _meets_demands(problem, judgement) or judgement.error >= incumbent:
        return None
    return judgement


def _unit_of_error(problem: Problem) -> float:
    """Return the greatest weight, in which the dimensionless problem counts its error."""
    weights = problem.transparency.weights
    return max(weights.admittance, weights.tracking, weights.coupling)


def dimensionless(problem: Problem) -> Problem:
    """Return the problem with Z_0 = T = 1 and the greatest weight 1."""
    scaled = problem.in_units(problem.transparency.reference_impedance, problem.device.sample_time)
    weights, most = scaled.transparency.weights, _unit_of_error(problem)
    relative = Terms(weights.admittance / most, weights.tracking / most, weights.coupling / most)
    return replace(scaled, transparency=replace(scaled.transparency, weights=relative))


def _optima(scaled: Problem, seen: ScanResult, progress: Progress, worth: float = WORTH_POLISHING) -> list[Polished]:
    """Polish the starts that can still win; return the local optima, best first."""
    optima: list[Polished] = []
    done: list[Start] = []
    for number, start in enumerate(seen.starts, 1):
        least = min((optimum.error for optimum in optima), default=inf)
        hopeless = not start.workable or (not start.admissible and number > LONG_SHOTS)
        if start.error > worth * least or hopeless or start in done:
            continue
        progress(f"polishing start {number} of {len(seen.starts)}")
        polished = polish(scaled, start, seen, incumbent=least if worth < inf else inf)
        if polished is not None:
            optima.append(polished)
            left = [each for each in seen.starts[number:] if each.error <= worth * polished.error]
            done += drained(scaled, left, design_of(polished.values)[0])
    optima.sort(key=lambda optimum: optimum.error)
    if optima:
        nearby = elsewhere(scaled, *design_of(optima[0].values))
        if nearby is not None:
            progress("polishing once more")
            better = polish(scaled, nearby, seen, incumbent=optima[0].error)
            optima = [better, *optima] if better is not None else optima
    return sorted(optima, key=lambda optimum: optimum.error)


def _best_proved(
    problem: Problem, scaled: Problem, seen: ScanResult, optima: list[Polished]
) -> tuple[Polished | None, Judgement | None]:
    """Return the best design that is proved; failing that the best one that is merely undecided."""
    doubtful: tuple[Polished, Judgement] | None = None
    for optimum in optima:
        for polished, judgement in _attempts(problem, scaled, seen, optimum):
            if _meets_demands(problem, judgement):
                return polished, judgement
            if judgement.status is Status.UNDECIDED and doubtful is None:
                doubtful = polished, judgement
    return doubtful if doubtful is not None else (None, None)


def _attempts(
    problem: Problem, scaled: Problem, seen: ScanResult, optimum: Polished
) -> Iterator[tuple[Polished, Judgement]]:
    """Judge the rounded optimum; while it is refuted, polish again with its witness, more sharply, to more digits."""
    polished: Polished | None = optimum
    tightening, witnesses = TIGHTENING, WorkingSet()
    for again in range(PROOF_ROUNDS):
        if polished is None:
            return
        digits = DIGITS + MORE_DIGITS * again
        judgement = judge(problem, *design_of(rounded(problem, physical(problem, polished.values), digits)))
        yield polished, judgement
        certificate = judgement.certificate
        _collect(witnesses.ratio, certificate.shortfall or certificate.outcomes[Claim.CONDITIONS], problem)
        _collect(witnesses.sensitivity, certificate.outcomes[Claim.SENSITIVITY], problem)
        tightening *= SHARPENING
        polished = polish(scaled, optimum.start, seen, tightening=tightening, witnesses=witnesses)


def _collect(known: list[Place], outcome: Outcome, problem: Problem) -> None:
    if outcome.verdict is Verdict.REFUTED and outcome.witness:
        refuted = dimensionless(with_device(problem, outcome.device or problem.device))
        known.append(Place(outcome.witness * problem.device.sample_time, refuted.device))


def _with_least_coupling(problem: Problem, judgement: Judgement) -> Judgement:
    """When the coupling costs nothing, return the same gains with the coupling that is least in the mean."""
    gains, bounds = judgement.gains, problem.bounds
    loop = {"velocity": Range(gains.velocity, gains.velocity), "position": Range(gains.position, gains.position)}
    narrowed = replace(
        problem,
        bounds=replace(bounds, **loop),
        transparency=replace(problem.transparency, norm="rms", weights=Terms(0.0, 0.0, 1.0)),
    )
    least = solve(narrowed).judgement
    if least is None:
        return judgement
    lighter = judge(problem, gains, least.coupling)
    return lighter if _meets_demands(problem, lighter) else judgement


def _meets_demands(problem: Problem, judgement: Judgement) -> bool:
    """Return whether the design is certified with the safety factor that the problem asks for."""
    certified = judgement.status is Status.CERTIFIED
    return certified and judgement.certificate.factor >= problem.stability.safety_factor
