"""Say what is proved of a design, or what fails, the worst first: the same words for every command and page."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import inf, pi

from vctune.analysis.in_worlds import growth_near
from vctune.design.judging.judge import Judgement, Status, certified
from vctune.model.hands import passive_hand
from vctune.model.numbers.units import UNITS, Units, hertz, in_full, narrowed
from vctune.model.servo import numbers_to_state
from vctune.proof.certificate import RATIOS
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.registry import CLAIMS
from vctune.proof.claims.sensitivity import SENSITIVITY
from vctune.proof.claims.worlds import WORLDS
from vctune.proof.outcome import Outcome, Verdict, enclosed
from vctune.running import OutOfTimeError, boxes_at_most

CUT = " (the time limit cut its proof)"  # Words that follow a claim if the time limit ended its proof
MOST_BOXES = 20_000  # Greatest number of boxes of the proof that a design misses only the safety factor


def said_of(judgement: Judgement) -> str:
    """Return the proved claims of a design, or the claims that fail, the worst first, with the least margin."""
    if judgement.status is Status.CERTIFIED:
        return _proved(judgement)
    if judgement.certificate.verdict is Verdict.PROVED:  # only stability.calm is left
        kicks = judgement.kicked
        moves = (
            "was not simulated in time" if kicks is None else f"{kicks.moving} of {kicks.kicks} kicks keep it moving"
        )
        return f"not calm, as simulated: {moves}; {_proved(judgement)}"
    at, units = judgement.binding, UNITS[judgement.device.units]
    hand = "" if at.hand is None else f" in the hand of {at.hand.in_words(units)}"
    if _misses_only_the_factor(judgement):
        return _stable_but(judgement) + hand + _elsewhere(judgement)
    worst, *others = open_claims(judgement)
    least = f"{_least(judgement)} at {at.omega / (2 * pi):.6g} Hz{hand}"
    if judgement.before_wall is at and at.ratio == 0:
        least = f"unstable at any multiple of the wall{hand}: more damping is needed"
    return "; ".join([worst, least, *others, *([words] if (words := _growth(judgement)) else [])])


def open_claims(judgement: Judgement) -> list[str]:
    """Return the claims that are not proved, the worst first, each with its verdict, its place, and the device on which
    it fails."""
    units, kind, demands = UNITS[judgement.device.units], judgement.kind, judgement.certificate.demands
    hand = passive_hand(judgement.device.counted_on, units)

    def severity(entry: tuple[ClaimId, Outcome]) -> tuple[bool, float]:
        claim, found = entry
        if claim in RATIOS:
            least = judgement.least(claim)
            return found.verdict is not Verdict.REFUTED, inf if least is None else least.ratio / demands.factor
        loud = demands.max_sensitivity / judgement.peak_sensitivity if claim == SENSITIVITY.id else 0.0
        return found.verdict is not Verdict.REFUTED, loud

    open_ = [entry for entry in judgement.certificate.outcomes.items() if entry[1].verdict is not Verdict.PROVED]
    return [
        f"{found.verdict.value}{_place(found, units)}: {CLAIMS[claim].said_of(kind, hand)}{CUT * found.cut}"
        for claim, found in sorted(open_, key=severity)
    ]


def _place(outcome: Outcome, units: Units) -> str:
    place = f" at {outcome.witness / (2 * pi):.6g} Hz" if outcome.witness else ""
    if (hand := outcome.hand) is not None:
        place += f" in the hand of {hand.in_words(units)}"
    if (device := outcome.device) is None:
        return place
    known = [f"{key} {in_full(number)}" for key, number in numbers_to_state(device).items() if key != "sample_time"]
    off = [] if device.unmodelled is None else [str(device.unmodelled)]
    return f"{place} with {', '.join([*known, *off])}"


def _elsewhere(judgement: Judgement) -> str:
    """Return the numbers of the device of the least ratio that are not the problem's, as beside a whole sample."""
    stated = numbers_to_state(judgement.device)
    there = numbers_to_state(judgement.binding.device)
    off = [f"{key} {in_full(number)}" for key, number in there.items() if number != stated.get(key)]
    return f" with {', '.join(off)}" if off else ""


def _stable_but(judgement: Judgement) -> str:
    """Return the phrase on a stable design that misses the safety factor, with its least ratio."""
    demands, ratio = judgement.certificate.demands, judgement.min_ratio
    texts = (f"{ratio:.{digits}g}" for digits in range(6, 18))  # enough digits to differ from the factor
    least = next((text for text in texts if float(text) != demands.factor), f"{ratio:g}")
    misses = "misses" if judgement.status is Status.VIOLATED else "not proved with"
    absolutely = "absolutely " * (demands.passive and not demands.alone)
    place = f"{judgement.ratio_name} {least} at {judgement.worst_hz:.6g} Hz"
    return f"{absolutely}stable; {misses} safety_factor {demands.factor:g}: {place}"


def _proved(judgement: Judgement) -> str:
    demands, units = judgement.certificate.demands, UNITS[judgement.device.units]
    low, high = narrowed(*map(hertz, demands.band))
    hand = passive_hand(judgement.device.counted_on, units)
    behind = f" in {hand}" if demands.alone or judgement.device.counted_on else ""
    behind += " with nothing behind" if demands.alone else ""
    where = [f"from {low} to {high} Hz{behind}"] if demands.passive else []
    where += [f"in {hand} up to Nyquist"] if demands.any_hand else []
    where += ["against a rigid world"] if demands.rigid else []
    if demands.hands is not None:
        worlds = f" with {demands.worlds.in_words(units)}" if demands.worlds else ""
        where += [f"in every hand of {demands.hands.in_words(units)}{worlds} up to Nyquist"]
    limits = [f"safety factor {in_full(demands.factor)}"]
    limits += [f"|S| at most {in_full(demands.max_sensitivity)}"] if judgement.gains.closed else []
    return f"proved, {_least(judgement)} {' and '.join(where)}, {', '.join(limits)}"


def _least(judgement: Judgement) -> str:
    """Return the least ratio in words, with a note if it is an estimate."""
    ratio, proved = judgement.min_ratio, judgement.certificate.proved_ratio
    note = "" if enclosed(ratio, proved) else " (estimated)"
    return f"{judgement.ratio_name} {'no limit' if ratio == inf else f'{ratio:.6g}'}{note}"


def _misses_only_the_factor(judgement: Judgement) -> bool:
    """Return whether every claim of a design is proved without a safety factor."""
    certificate = judgement.certificate
    failing = {claim for claim, outcome in certificate.outcomes.items() if outcome.verdict is not Verdict.PROVED}
    if certificate.demands.factor <= 1 or not failing <= {*RATIOS}:
        return False
    if any(margin.ratio < 1 for margin in judgement.margins):
        return False
    with boxes_at_most(MOST_BOXES), suppress(OutOfTimeError):
        demands = replace(certificate.demands, factor=1.0)
        return certified(certificate.design, demands, certificate.box).verdict is Verdict.PROVED
    return False


def _growth(judgement: Judgement) -> str:
    """Return how a motion grows in the hand of a refuted claim with its least environment; "" if it does not."""
    demands, outcome = judgement.certificate.demands, judgement.certificate.outcomes.get(WORLDS.id)
    if outcome is None or outcome.verdict is not Verdict.REFUTED or outcome.hand is None or not outcome.witness:
        return ""
    assert demands.worlds is not None
    law, device, worlds = (judgement.gains, judgement.coupling), outcome.device or judgement.device, demands.worlds
    found = growth_near(device, *law, outcome.hand, worlds.low, outcome.witness)
    if found is None:
        return ""
    behind = "with the least environment of the box"
    if worlds.exact and worlds.high.mass == 0:
        behind = "with its spring alone" if worlds.high.stiffness else "with nothing behind it"
    hand = outcome.hand.in_words(UNITS[judgement.device.units])
    return f"in the hand of {hand} {behind} a motion grows by {found.rate:.4g}/s at {found.hz:.4g} Hz"
