"""Find the best proved design: optimise from each promising start (`polish`), round the optima, and prove them. See
design/README.md, section 8."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import floor, inf
from time import perf_counter

import numpy as np

from vctune.analysis.demands import transparency_error
from vctune.analysis.hardest_hands import tightest_at_wall
from vctune.analysis.in_hands import RatioInHand, least_ratios_near
from vctune.design.judging.judge import IDLE_TRACKING, Judgement, Status, judge_posed
from vctune.design.nlp.solution import Polished
from vctune.design.nlp.working_set import ConstraintPoint, Start, WorkingSet
from vctune.design.prepared import Prepared, prepare, with_corner
from vctune.design.search.along_limit import best_along_limit, follows_limit
from vctune.design.search.exchange import TIGHTENING, polish
from vctune.design.search.scan import ScanResult, scan, start_at
from vctune.design.search.theorems import impossible
from vctune.design.search.wall import stiffest_wall
from vctune.design.variables import CORNER, DIGITS, design_of, rounded
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem, Range
from vctune.model.transparency import Terms
from vctune.model.worlds import WorldsMet
from vctune.proof.claims.delays import NEXT_TO
from vctune.proof.claims.registry import CLAIMS, IN_HANDS
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import OutOfTimeError, boxes_at_most, check_time, most_boxes, out_of_time, seconds_left, time_limit

# The search polishes a start if its estimated error, divided by the error of the best optimum, is at most this ratio
WORTH_POLISHING = 1.05
# Number of times that the search tightens the constraints and polishes a refuted optimum again, and number of digits
# that it then adds to the decimals
PROOF_ROUNDS, MORE_DIGITS = 4, 2
# Number of starts that the search polishes if none is feasible, because a feasible design may lie between the points of
# the grid
LONG_SHOTS = 2
NEARLY = 0.1  # Greatest violation of a start, as a share, for `within_reach` to polish it
# Greatest error of a start near the best design that is polished too, and of the result for another one, as a share
NEARBY = 0.9995
OTHER_DESIGN = 1.001  # Least ratio of the errors of two optima that are not taken for the same design
# Number of boxes of undecided proofs after which the search ends and the design stays undecided, and greatest number of
# one claim: a design with a little more reserve is proved sooner than a claim with many more boxes
PROOF_BOXES, ONE_PROOF = 150_000, 50_000
# Greatest number of boxes of a claim about an idle design while a start is left that uses its velocity loop, and whose
# error is at most this ratio of that of the idle design
IDLE_BOXES, WORTH_INSTEAD = 20_000, 1.5
# Number of delays on each side of the worst one that `worst_near` tries in each round, and number of rounds
DELAYS_TRIED, DELAY_ROUNDS = 4, 6
# Number of times that the search adds a hand that only the proof has found, and polishes the optimum again
NEW_HANDS = 12
# Factor by which the search increases the tightening if a proof refutes a design, and least tightening if a proof is
# undecided
SHARPENING, DECIDABLE = 10.0, 1e-3

SEARCH, PROOF = "the search", "the proof"  # Names of stages that a time limit may cut short
SEARCHING = 0.6  # Share of the time limit for polishing starts; the rest is for the proof, which takes about as long

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Optimum:
    """The result of the optimiser."""

    judgement: Judgement | None  # judgement of the best proved design, or else of the best undecided one
    polished: Polished | None  # the local optimum before rounding
    optima: int  # number of local optima
    seconds: dict[str, float]  # time of polishing and of proving, s
    cut: tuple[str, ...] = ()  # names of the stages that the time limit cut short


def optimum(prepared: Prepared, scanned: ScanResult, progress: Progress = lambda stage: None) -> Optimum:
    """Return the best design that the search reaches from the starts."""
    began = perf_counter()
    optima, searched = local_optima(prepared, scanned, progress, WORTH_POLISHING)
    polished = perf_counter()
    progress(f"proving{_best_known(optima, prepared.units.error)}")
    tried = [optimum.start for optimum in optima]
    starts = [start for start in scanned.starts if start not in tried]
    most = WORTH_INSTEAD * optima[0].error if optima else 0.0
    useful = [s for s in starts if s.workable and s.error <= most and not _idle(prepared, s.gains, s.coupling)]
    best, judgement = _best_proved(prepared, scanned, optima, IDLE_BOXES if useful else inf)
    undecided = judgement is not None and judgement.status is Status.UNDECIDED
    if optima and (judgement is None or undecided) and not out_of_time():  # try the starts that the search skipped
        idle = undecided and best is not None and _idle(prepared, *design_of(best.values))
        least = WORTH_POLISHING * optima[0].error if undecided and not idle else 0.0
        left = replace(scanned, starts=[start for start in (useful if idle else starts) if start.error > least])
        more, _ = local_optima(prepared, left, progress, inf)
        more = [each for each in more if not undecided or each.error > OTHER_DESIGN * optima[0].error]
        another, proved = _best_proved(prepared, scanned, more)
        if not undecided or (proved is not None and proved.status is Status.CERTIFIED):
            optima, best, judgement = more, another, proved
        elif idle and useful:
            best, judgement = _best_proved(prepared, scanned, optima)
    if judgement is not None and prepared.problem.transparency.weights.coupling == 0:
        with suppress(OutOfTimeError):
            judgement = _with_least_coupling(prepared, judgement)
    seconds = {"polish": polished - began, "prove": perf_counter() - polished}
    unproved = judgement.cut if judgement is not None else out_of_time()
    cut = (SEARCH,) * (not searched) + (PROOF,) * unproved
    return Optimum(judgement, best, len(optima), seconds, cut)


def _best_known(optima: Sequence[Polished], unit: float) -> str:
    """Return the end of a progress message: the error of the best optimum so far, in SI units."""
    return f", best error {min(each.error for each in optima) * unit:.4g}" if optima else ""


@np.errstate(all="ignore")
def within_reach(problem: Problem) -> tuple[Gains, AnyCoupling] | None:
    """Return a design of a problem that the optimiser considers feasible, SI units; None if it finds none."""
    if impossible(problem) is not None:
        return None
    prepared = prepare(problem)
    if problem.rigid or follows_limit(problem):
        proved = stiffest_wall(prepared.given) if problem.rigid else best_along_limit(prepared)
        found = None if proved is None else proved.judgement
        return (found.gains, found.coupling) if found is not None and found.status is Status.CERTIFIED else None
    scanned = scan(prepared.scaled)
    for start in [start for start in scanned.starts[:LONG_SHOTS] if start.admissible] or scanned.starts[:1]:
        hopeful = start.workable and start.violation < NEARLY
        optimum = polish(prepared.scaled, start, scanned) if hopeful else None
        if optimum is not None:
            return design_of(prepared.units.to_si(optimum.values))
    return None


@np.errstate(all="ignore")
def improved(prepared: Prepared, gains: Gains, incumbent: float) -> Judgement | None:
    """Return a certified design that is better than the incumbent, found from given gains; None if none is found."""
    scaled, units = prepared.scaled, prepared.units
    start = start_at(scaled, units.gains(gains))
    target = incumbent / units.error
    if start is None or start.error >= target:
        return None
    scanned = scan(scaled)
    optimum = polish(scaled, start, scanned, incumbent=target)
    judgement = _best_proved(prepared, scanned, [optimum])[1] if optimum is not None else None
    if judgement is None or judgement.status is not Status.CERTIFIED or judgement.error >= incumbent:
        return None
    return judgement


def local_optima(
    prepared: Prepared, scanned: ScanResult, progress: Progress, worth: float
) -> tuple[list[Polished], bool]:
    """Polish the starts that may lead to the best design; return the local optima, the best first."""
    optima: list[Polished] = []
    complete = False
    with suppress(OutOfTimeError):
        _polish_starts(prepared, scanned, progress, worth, optima)
        complete = not out_of_time()
    return sorted(optima, key=lambda optimum: optimum.error), complete


def _polish_starts(
    prepared: Prepared, scanned: ScanResult, progress: Progress, worth: float, optima: list[Polished]
) -> None:
    """Polish starts, and add the local optima to `optima`."""
    scaled, available = prepared.scaled, seconds_left()
    for_proof, known_idle = (1 - SEARCHING) * available if available < inf else 0.0, False
    for number, start in enumerate(scanned.starts, 1):
        least = min((optimum.error for optimum in optima), default=inf)
        hopeless = not start.workable or (not start.admissible and number > LONG_SHOTS)
        # idle designs lie in one flat basin, whose best start was the first
        idle = worth < inf and _idle(prepared, start.gains, start.coupling)
        if start.error > worth * least or hopeless or (idle and known_idle):
            continue
        progress(f"polishing start {number} of {len(scanned.starts)}{_best_known(optima, prepared.units.error)}")
        with time_limit(seconds_left() - for_proof if optima else inf):
            check_time()
            polished = polish(scaled, start, scanned, incumbent=least if worth < inf else inf)
        if polished is not None:
            optima.append(polished)
            known_idle |= idle
    # the scan ranks couplings by the gains of its grid; near the gains of an optimum another one may be better
    while optima:
        best = min(optima, key=lambda optimum: optimum.error)
        with time_limit(seconds_left() - for_proof):
            near = start_at(scaled, design_of(best.values)[0])
            if near is None or near.error >= NEARBY * best.error:
                return
            progress(f"polishing near the best design{_best_known(optima, prepared.units.error)}")
            better = polish(scaled, near, scanned, incumbent=best.error)
        if better is None or better.error >= NEARBY * best.error:
            return
        optima.append(better)


def _idle(prepared: Prepared, gains: Gains, coupling: AnyCoupling) -> bool:
    """Return whether a dimensionless design hardly uses its velocity loop."""
    found = transparency_error(prepared.scaled.problem, gains, coupling)
    return prepared.problem.device.kind.own_loop and found.tracking > IDLE_TRACKING


def _best_proved(
    prepared: Prepared, scanned: ScanResult, optima: list[Polished], of_idle: float = inf
) -> tuple[Polished | None, Judgement | None]:
    """Return the best proved design, or else the best undecided one; `of_idle` boxes are spent on an idle one."""
    doubtful: tuple[Polished, Judgement] | None = None
    spent = 0
    with suppress(OutOfTimeError):
        for optimum in optima:
            most = of_idle if _idle(prepared, *design_of(optimum.values)) else inf
            if most < inf and doubtful is not None:
                continue
            for polished, judgement in _attempts(prepared, scanned, optimum, most):
                if judgement.status is Status.CERTIFIED:
                    return polished, judgement
                if judgement.status is Status.UNDECIDED and doubtful is None:
                    doubtful = polished, judgement
                spent += judgement.certificate.boxes
                if most < inf and judgement.status is Status.UNDECIDED:
                    break
                if doubtful is not None and (spent > min(PROOF_BOXES, most_boxes()) or judgement.certificate.cut):
                    return doubtful
    return doubtful if doubtful is not None else (None, None)


def _attempts(
    prepared: Prepared, scanned: ScanResult, optimum: Polished, most: float
) -> Iterator[tuple[Polished, Judgement]]:
    """Judge the rounded optimum; while it is not proved, polish it again with its witnesses, and judge the result."""
    polished: Polished | None = optimum
    tightening, witnesses, sharpened, judged = TIGHTENING, WorkingSet(), 0, list[Judgement]()
    for _ in range(PROOF_ROUNDS + NEW_HANDS):
        if polished is None or sharpened == PROOF_ROUNDS:
            return
        digits = DIGITS + MORE_DIGITS * sharpened
        values = rounded(prepared.problem, prepared.units.to_si(polished.values), digits)
        law = design_of(values)
        found = sum(_new_hand(prepared, law, judgement, witnesses, tightening) for judgement in judged)
        if not found:  # else the hands near the witnesses of earlier judgements already refute this design
            given = with_corner(prepared.given, values[CORNER]) if len(values) > CORNER else prepared.given
            with boxes_at_most(min(most, ONE_PROOF)):
                judgement = judge_posed(given, *law)
            yield polished, judgement
            judged += [judgement] if judgement.certificate.demands.walls_met is None else []
            for claim, outcome in judgement.certificate.outcomes.items():
                points = witnesses.points(CLAIMS[claim].quantity)
                if points is not None:
                    _collect(points, outcome, prepared, judgement if claim == "walls" else None)
            known = _new_hand(prepared, law, judgement, witnesses, tightening)
            if not known:
                sharpened += 1
                tightening *= SHARPENING
            if _undecided(judgement):
                tightening = max(tightening, DECIDABLE)
        again = partial(polish, prepared.scaled, scanned=scanned, tightening=tightening, witnesses=witnesses)
        polished = again(_start_at(polished), demands=polished.working_set) or again(optimum.start)


def _start_at(polished: Polished) -> Start:
    """Return an optimum as the start of an exchange with slightly tighter constraints."""
    corner = polished.values[CORNER] if len(polished.values) > CORNER else None
    return Start(*design_of(polished.values), polished.error, corner=corner)


def _new_hand(
    prepared: Prepared,
    law: tuple[Gains, AnyCoupling],
    judgement: Judgement,
    witnesses: WorkingSet,
    tightening: float,
) -> bool:
    """Add the worst hand near the hand of a witness, if it requires more than the tightening provides; return whether
    it did."""
    problem, outcomes = prepared.problem, judgement.certificate.outcomes
    found = False
    demands = judgement.certificate.demands
    for claim in (claim for claim in IN_HANDS if claim in outcomes):
        outcome, met = outcomes[claim], demands.walls_met if claim == "walls" else demands.worlds_met
        if problem.hands_met is None or outcome.hand is None or not outcome.witness:
            continue
        device, worst = worst_near(prepared, law, outcome, met)
        if worst.ratio < problem.stability.safety_factor * (1 - tightening):
            there = replace(outcome, witness=worst.omega, hand=worst.hand, device=outcome.device and device)
            _collect(witnesses.in_hand, there, prepared, judgement if claim == "walls" else None)
            found = True
    return found


def worst_near(
    prepared: Prepared, law: tuple[Gains, AnyCoupling], outcome: Outcome, met: WorldsMet | None
) -> tuple[Device, RatioInHand]:
    """Return the device and the hand near a witness in which the ratio of a design is least."""
    problem, box = prepared.problem, prepared.given.box
    assert problem.hands_met is not None and outcome.hand is not None and outcome.witness is not None
    device, T = outcome.device or problem.device, problem.device.sample_time
    near = partial(least_ratios_near, hands=problem.hands_met, gains=law[0], coupling=law[1], met=met)
    key, delay = device.delay_key, device.number(device.delay_key)
    worst = near([device], omega=outcome.witness, hand=outcome.hand)[0]
    if box is None or key not in box.uncertain or delay is None:
        return device, worst
    whole, low, high = floor(delay / T), box.low.number(key), box.high.number(key)
    low, high = max(low, (whole + NEXT_TO) * T), min(high, (whole + 1 - NEXT_TO) * T)
    for closer in range(DELAY_ROUNDS):
        steps = np.linspace(-1, 1, 2 * DELAYS_TRIED + 1) * (high - low) / DELAYS_TRIED**closer
        tried = np.unique(np.clip(device.number(key) + steps, low, high))
        devices = [device.with_numbers({key: float(delay)}) for delay in tried]
        found = near(devices, omega=worst.omega, hand=worst.hand)
        least = min(range(len(found)), key=lambda k: found[k].ratio)
        if found[least].ratio < worst.ratio:
            device, worst = devices[least], found[least]
    return device, worst


def _undecided(judgement: Judgement) -> bool:
    return any(outcome.verdict is Verdict.UNDECIDED for outcome in judgement.certificate.outcomes.values())


def _collect(
    known: list[ConstraintPoint], outcome: Outcome, prepared: Prepared, of_walls: Judgement | None = None
) -> None:
    """Add the point at which a proof refutes a design."""
    if outcome.verdict is Verdict.REFUTED and outcome.witness:
        wall, device = None, outcome.device or prepared.problem.device
        if of_walls is not None and (met := of_walls.certificate.demands.walls_met) and outcome.hand:
            law = of_walls.gains, of_walls.coupling
            wall = tightest_at_wall(device, *law, outcome.witness, outcome.hand, met)
        hand = outcome.hand and outcome.hand.in_units(prepared.units.impedance, prepared.units.time)
        known.append(ConstraintPoint(outcome.witness * prepared.units.time, prepared.on_device(device), hand, wall))


def _with_least_coupling(prepared: Prepared, judgement: Judgement) -> Judgement:
    """Return the judgement of the same gains with the feasible coupling whose mean square is least."""
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
