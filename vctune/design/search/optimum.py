"""The best proved design that the optimiser finds: it polishes starts, rounds the optima, and proves them.

See design/README.md, section 8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from time import perf_counter

import numpy as np

from vctune.analysis.hardest_hands import tightest_at_wall
from vctune.analysis.in_hands import least_ratio_near
from vctune.design.prepared import Prepared, prepare, with_corner
from vctune.design.result import Polished
from vctune.design.search.exchange import TIGHTENING, by_scale, polish
from vctune.design.search.rounding import DIGITS, rounded
from vctune.design.search.scan import ScanResult, better_start_near, in_same_basin, scan, start_at
from vctune.design.search.start import Start
from vctune.design.search.theorems import impossible
from vctune.design.search.working_set import ConstraintPoint, WorkingSet
from vctune.design.variables import CORNER, design_of, point
from vctune.design.verdict.judge import Judgement, Status, judge_posed
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem, Range
from vctune.model.transparency import Terms
from vctune.proof.claims.registry import CLAIMS, IN_HANDS
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.running import OutOfTimeError, check_time, out_of_time, seconds_left, time_limit

WORTH_POLISHING = 1.05
"""Factor by which a start's scanned error may exceed the best polished error for the start to be polished. It is about
the accuracy of the refined grid at a local minimum. A smaller factor skips a start that polishing would make the best;
a greater factor polishes starts that do not win."""
PROOF_ROUNDS, MORE_DIGITS = 4, 2
"""Number of times that a refuted optimum is polished again, and number of digits added to it. With 4 rounds the
tightening reaches 1e-3, which makes a design 0.1 % worse. Half as many rounds give up designs that a third round
proves; twice as many try designs that cost more than another start."""
LONG_SHOTS = 2
"""Number of starts to polish if none is feasible, since the nearest misses may be feasible between the points of the
grid. One start would rely on the scan's order. More starts take time, and the search of every box that follows finds
the same designs."""
NEARLY = 0.1
"""Greatest share by which a start may miss a constraint to be polished for an estimate; the grid's refined spacing is
half of that. Half this share misses existing repairs; twice this share polishes in vain."""
PROOF_BOXES = 300_000
"""Number of boxes in undecided proofs after which the design stays undecided and the search tries no sharper design and
no other start: a proof never resolves hands that resonate far above Nyquist. With half as many boxes the search tries
only once; with twice as many it waits for a third failure."""
NEW_HANDS = 12
"""Number of hands known only to the proof with which an optimum is polished: a resonance above Nyquist occurs in a few
hands of the box alone. Half and twice as many give the same designs. With none, a device sampled at 20 Hz has no
design."""
SHARPENING, DECIDABLE = 10.0, 1e-3
"""Factor by which the constraints are tightened again if a proof refutes a design, and least tightening if a proof is
undecided. The number of boxes grows with the inverse of the remaining reserve. Twice these numbers increase the error,
at most in proportion; with half of them some proofs fail."""

SEARCH, PROOF = "the search", "the proof"
"""Names of stages that a time limit may cut short."""
SEARCHING = 0.6
"""Share of a time limit after which no more starts are polished once one has led to an optimum, since a proof takes
about as long as a polish. Half this share finds worse designs; with the whole time no design is proved."""

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Optimum:
    """The result of the optimiser.

    Attributes
    ----------
    judgement : judgement of the best proved design, or else of the best undecided one; None if there is neither
    polished : the local optimum that was rounded to the design
    optima : number of local optima
    seconds : seconds of polishing and of proving
    cut : stages that the time limit cut short
    """

    judgement: Judgement | None
    polished: Polished | None
    optima: int
    seconds: dict[str, float]
    cut: tuple[str, ...] = ()


def optimum(prepared: Prepared, scanned: ScanResult, progress: Progress = lambda stage: None) -> Optimum:
    """Return the best design to which the starts lead.

    Parameters
    ----------
    prepared : prepared problem that leaves a number free
    scanned : result of its scan, dimensionless
    progress : function that receives the current stage
    """
    began = perf_counter()
    optima, searched = local_optima(prepared, scanned, progress, WORTH_POLISHING)
    polished = perf_counter()
    progress(f"proving{_best_known(optima, prepared.units.error)}")
    best, judgement = _best_proved(prepared, scanned, optima)
    if judgement is None and optima:  # what seemed best is not admissible, so try what seemed worse
        tried = [optimum.start for optimum in optima]
        others = replace(scanned, starts=[s for s in scanned.starts if s not in tried])
        optima, _ = local_optima(prepared, others, progress, inf)
        best, judgement = _best_proved(prepared, scanned, optima)
    if judgement is not None and prepared.problem.transparency.weights.coupling == 0:
        with suppress(OutOfTimeError):
            judgement = _with_least_coupling(prepared, judgement)
    seconds = {"polish": polished - began, "prove": perf_counter() - polished}
    unproved = judgement.cut if judgement is not None else out_of_time()
    cut = (SEARCH,) * (not searched) + (PROOF,) * unproved
    return Optimum(judgement, best, len(optima), seconds, cut)


def _best_known(optima: Sequence[Polished], unit: float) -> str:
    """Return words on the best optimum so far, with its error in units of `unit`."""
    return f", best error {min(each.error for each in optima) * unit:.4g}" if optima else ""


@np.errstate(all="ignore")
def estimated(problem: Problem) -> tuple[Gains, AnyCoupling] | None:
    """Return the best design of a problem in SI units. It meets the constraints in double precision, without a proof.

    Parameters
    ----------
    problem : problem that leaves a number free
    """
    if impossible(problem) is not None:
        return None
    prepared = prepare(problem)
    optima, complete = local_optima(prepared, scan(prepared.scaled), lambda stage: None, WORTH_POLISHING)
    if not complete:
        raise OutOfTimeError
    return design_of(prepared.units.to_si(optima[0].values)) if optima else None


def nominal_start(prepared: Prepared) -> tuple[Start, float] | None:
    """Return the best design for the nominal device of an uncertain one, as a start, and its error."""
    nominal = prepare(replace(prepared.problem, uncertainty=None))
    law = estimated(nominal.problem)
    if law is None:
        return None
    scaled = design_of(nominal.units.to_dimensionless(point(*law)))
    return Start(*scaled, nominal.scaled.error(*scaled)), nominal.given.error(*law)


@np.errstate(all="ignore")
def within_reach(problem: Problem) -> tuple[Gains, AnyCoupling] | None:
    """Return a design of a problem that the optimiser considers feasible, SI units; None if it finds none.

    The function stops at the first design and proves nothing. If it finds none, it does not search the boxes. It gives
    an estimate in a fraction of the time of `solve`.

    Parameters
    ----------
    problem : problem in SI units that leaves a number free
    """
    if impossible(problem) is not None:
        return None
    prepared = prepare(problem)
    scanned = scan(prepared.scaled)
    for start in [start for start in scanned.starts[:LONG_SHOTS] if start.admissible] or scanned.starts[:1]:
        hopeful = start.workable and start.violation < NEARLY
        optimum = polish(prepared.scaled, start, scanned) if hopeful else None
        if optimum is not None:
            return design_of(prepared.units.to_si(optimum.values))
    return None


@np.errstate(all="ignore")
def improved(prepared: Prepared, gains: Gains, incumbent: float) -> Judgement | None:
    """Return a certified design that is better than the incumbent, found from given gains; None if none is found.

    Parameters
    ----------
    prepared : prepared problem that leaves a number free
    gains : gains to start from, SI units; the function tries any coupling with them
    incumbent : `Judgement.compared` of the incumbent
    """
    scaled, units = prepared.scaled, prepared.units
    start = start_at(scaled, units.gains(gains))
    target = incumbent / units.error
    if start is None or start.error >= target:
        return None
    scanned = scan(scaled)
    optimum = polish(scaled, start, scanned, incumbent=target)
    judgement = _best_proved(prepared, scanned, [optimum])[1] if optimum is not None else None
    if judgement is None or judgement.status is not Status.CERTIFIED or judgement.compared >= incumbent:
        return None
    return judgement


def local_optima(
    prepared: Prepared, scanned: ScanResult, progress: Progress, worth: float
) -> tuple[list[Polished], bool]:
    """Polish the starts that can still win; return the local optima, the best first.

    Parameters
    ----------
    prepared : prepared problem that leaves a number free
    scanned : starts of the problem, dimensionless
    progress : function that receives the current stage
    worth : factor by which a start's error may exceed the least known error

    Returns
    -------
    optima : local optima, dimensionless and not proved, the least error first
    complete : whether the time limit left time for every start
    """
    optima: list[Polished] = []
    complete = False
    with suppress(OutOfTimeError):
        _polish_starts(prepared, scanned, progress, worth, optima)
        complete = not out_of_time()
    return sorted(optima, key=lambda optimum: optimum.error), complete


def _polish_starts(
    prepared: Prepared, scanned: ScanResult, progress: Progress, worth: float, optima: list[Polished]
) -> None:
    """Add the local optima to which starts lead."""
    scaled, done, available = prepared.scaled, list[Start](), seconds_left()
    for_proof = (1 - SEARCHING) * available if available < inf else 0.0
    for number, start in enumerate(scanned.starts, 1):
        least = min((optimum.error for optimum in optima), default=inf)
        hopeless = not start.workable or (not start.admissible and number > LONG_SHOTS)
        if start.error > worth * least or hopeless or start in done:
            continue
        progress(f"polishing start {number} of {len(scanned.starts)}{_best_known(optima, prepared.units.error)}")
        with time_limit(seconds_left() - for_proof if optima else inf):
            check_time()
            polished = polish(scaled, start, scanned, incumbent=least if worth < inf else inf)
        if polished is not None:
            optima.append(polished)
            left = [each for each in scanned.starts[number:] if each.error <= worth * polished.error]
            done += in_same_basin(scaled, left, design_of(polished.values)[0])
    optima.sort(key=lambda optimum: optimum.error)
    if optima:
        with time_limit(seconds_left() - for_proof):
            nearby = better_start_near(scaled, *design_of(optima[0].values))
        if nearby is not None:
            progress(f"polishing once more{_best_known(optima, prepared.units.error)}")
            with time_limit(seconds_left() - for_proof):
                better = polish(scaled, nearby, scanned, incumbent=optima[0].error)
            optima += [better] if better is not None else []


def _best_proved(
    prepared: Prepared, scanned: ScanResult, optima: list[Polished]
) -> tuple[Polished | None, Judgement | None]:
    """Return the best proved design, or else the best undecided one."""
    doubtful: tuple[Polished, Judgement] | None = None
    spent = 0
    with suppress(OutOfTimeError):
        for optimum in optima:
            for polished, judgement in _attempts(prepared, scanned, optimum):
                if judgement.status is Status.CERTIFIED:
                    return polished, judgement
                if judgement.status is Status.UNDECIDED and doubtful is None:
                    doubtful = polished, judgement
                spent += judgement.certificate.boxes
                if doubtful is not None and (spent > PROOF_BOXES or judgement.certificate.cut):
                    return doubtful
    return doubtful if doubtful is not None else (None, None)


def _attempts(prepared: Prepared, scanned: ScanResult, optimum: Polished) -> Iterator[tuple[Polished, Judgement]]:
    """Judge the rounded optimum.

    While it is not proved, polish it again with its witness, tighter and with more digits.

    If a hand requires more than the tightening gives, only the proof has found it. The search must then add the hand,
    not tighten the constraints. A search for the greatest forbidden scale does both: it knows that hand's neighbours.
    """
    polished: Polished | None = optimum
    tightening, witnesses, sharpened = TIGHTENING, WorkingSet(), 0
    for _ in range(PROOF_ROUNDS + NEW_HANDS):
        if polished is None or sharpened == PROOF_ROUNDS:
            return
        digits = DIGITS + MORE_DIGITS * sharpened
        values = rounded(prepared.problem, prepared.units.to_si(polished.values), digits)
        given = with_corner(prepared.given, values[CORNER]) if len(values) > CORNER else prepared.given
        judgement = judge_posed(given, *design_of(values))
        yield polished, judgement
        for claim, outcome in judgement.certificate.outcomes.items():
            points = witnesses.points(CLAIMS[claim].quantity)
            if points is not None:
                _collect(points, outcome, prepared, judgement if claim == "walls" else None)
        known = _new_hand(prepared, judgement, witnesses, tightening)
        if by_scale(prepared.problem) or not known:
            sharpened += 1
            tightening *= SHARPENING
        if _undecided(judgement) or by_scale(prepared.problem):
            tightening = max(tightening, DECIDABLE)
        again = partial(polish, prepared.scaled, scanned=scanned, tightening=tightening, witnesses=witnesses)
        polished = again(_start_at(polished), demands=polished.working_set) or again(optimum.start)


def _start_at(polished: Polished) -> Start:
    """Return an optimum as a start, from which slightly tighter constraints lead to the next optimum of its basin."""
    corner = polished.values[CORNER] if len(polished.values) > CORNER else None
    return Start(*design_of(polished.values), polished.error, corner=corner)


def _new_hand(prepared: Prepared, judgement: Judgement, witnesses: WorkingSet, tightening: float) -> bool:
    """Add the worst hand near a hand that the proof refuted, if it requires more than the tightening gives."""
    problem, outcomes = prepared.problem, judgement.certificate.outcomes
    found = False
    demands = judgement.certificate.demands
    for claim in (claim for claim in IN_HANDS if claim in outcomes):
        outcome, met = outcomes[claim], demands.walls_met if claim == "walls" else demands.worlds_met
        if problem.hands_met is None or outcome.hand is None or not outcome.witness:
            continue
        device = outcome.device or problem.device
        law = judgement.gains, judgement.coupling
        worst = least_ratio_near(device, problem.hands_met, *law, outcome.witness, outcome.hand, met)
        if worst.ratio < problem.stability.safety_factor * (1 - tightening):
            there = replace(outcome, witness=worst.omega, hand=worst.hand)
            _collect(witnesses.in_hand, there, prepared, judgement if claim == "walls" else None)
            found = True
    return found


def _undecided(judgement: Judgement) -> bool:
    return any(outcome.verdict is Verdict.UNDECIDED for outcome in judgement.certificate.outcomes.values())


def _collect(
    known: list[ConstraintPoint], outcome: Outcome, prepared: Prepared, of_walls: Judgement | None = None
) -> None:
    """Add the point at which a design is refuted.

    `of_walls` is the judgement if the condition of walls fails, else None.
    """
    if outcome.verdict is Verdict.REFUTED and outcome.witness:
        wall, device = None, outcome.device or prepared.problem.device
        if of_walls is not None and (met := of_walls.certificate.demands.walls_met) and outcome.hand:
            law = of_walls.gains, of_walls.coupling
            wall = tightest_at_wall(device, *law, outcome.witness, outcome.hand, met)
        hand = outcome.hand and outcome.hand.in_units(prepared.units.impedance, prepared.units.time)
        known.append(ConstraintPoint(outcome.witness * prepared.units.time, prepared.on_device(device), hand, wall))


def _with_least_coupling(prepared: Prepared, judgement: Judgement) -> Judgement:
    """If the coupling costs nothing, return the same gains with the coupling that is least in the mean."""
    problem, gains = prepared.problem, judgement.gains
    bounds = problem.bounds
    loop = {"velocity": Range(gains.velocity, gains.velocity), "position": Range(gains.position, gains.position)}
    narrowed = prepare(
        replace(
            problem,
            bounds=replace(bounds, **loop),
            transparency=replace(problem.transparency, norm="rms", weights=Terms(0.0, 0.0, 1.0)),
        )
    )
    least = optimum(narrowed, scan(narrowed.scaled)).judgement
    if least is None:
        return judgement
    lighter = judge_posed(prepared.given, gains, least.coupling)
    return lighter if lighter.status is Status.CERTIFIED else judgement
