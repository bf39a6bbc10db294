"""Write the result of a check in one line of text, and find the line of the file to which it refers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from math import pi

from vctune.analysis.growth import growth_near
from vctune.design.result import Repair
from vctune.design.verdict.judge import Judgement, Status
from vctune.design.verdict.parameter_changes import ParameterChange
from vctune.document.text import toml
from vctune.model.numbers.keys import SYMBOLS
from vctune.model.numbers.units import UNITS
from vctune.proof.certificate import certify
from vctune.proof.outcome import Verdict
from vctune.proof.prover import boxes_at_most
from vctune.running import OutOfTimeError

MOST_BOXES = 20_000  # Greatest number of boxes of the proof that a design misses only the safety factor


def check_message(
    judgement: Judgement,
    repairs: Sequence[Repair] | None,
    changed: Sequence[ParameterChange],
    together: Sequence[ParameterChange],
) -> str:
    """Return the proved claims of a design, or the claims that fail and the changes after which it passes."""
    if judgement.status is Status.CERTIFIED:
        return _proved(judgement)
    hand = ""
    for held in (judgement.in_hand, judgement.in_walls):
        if held is not None and held.ratio == judgement.min_ratio:
            hand = f" in the hand of {held.hand.in_words(UNITS[judgement.tightest.units])}"
            break
    remedies = [_whole(together)] if together else []
    remedies += [_remedy(repairs, changed)] if repairs is not None else []
    if _misses_only_the_factor(judgement):
        return "; ".join([judgement.stable_but + hand, *remedies])
    grows = [words] if (words := _growth(judgement)) else []
    if (missed := judgement.reserve_missed) is not None:
        return "; ".join([missed + hand, *judgement.open_claims, *grows, *remedies])
    worst = f"{judgement.ratio_name} {judgement.min_ratio:.6g} at {judgement.worst / (2 * pi):.6g} Hz{hand}"
    return "; ".join([*judgement.open_claims, worst, *grows, *remedies])


def _misses_only_the_factor(judgement: Judgement) -> bool:
    """Return whether a refuted design is proved without a safety factor, where only hands or environments ask for it.

    `Judgement.reserve_missed` says so of Llewellyn's conditions.
    """
    certificate = judgement.certificate
    failing = {claim for claim, outcome in certificate.outcomes.items() if outcome.verdict is not Verdict.PROVED}
    if certificate.demands.factor <= 1 or not failing or not failing <= {"hands", "worlds", "any_hand"}:
        return False
    with boxes_at_most(MOST_BOXES), suppress(OutOfTimeError):
        demands = replace(certificate.demands, factor=1.0)
        return certify(certificate.design, demands, certificate.box).verdict is Verdict.PROVED
    return False


def _growth(judgement: Judgement) -> str:
    """Return how a motion grows in the hand of a refuted claim with its least environment; "" if it does not."""
    demands, outcome = judgement.certificate.demands, judgement.certificate.outcomes.get("worlds")
    if outcome is None or outcome.verdict is not Verdict.REFUTED or outcome.hand is None or not outcome.witness:
        return ""
    assert demands.worlds is not None
    law, device, worlds = (judgement.gains, judgement.coupling), outcome.device or judgement.device, demands.worlds
    found = growth_near(device, *law, outcome.hand, worlds.low, outcome.witness)
    if found is None:
        return ""
    units = UNITS[judgement.tightest.units]
    behind = "with the least environment of the box"
    if worlds.exact and worlds.high.mass == 0:
        behind = "with its spring alone" if worlds.high.stiffness else "with nothing behind it"
    hand = outcome.hand.in_words(units)
    return f"in the hand of {hand} {behind} a motion grows by {found.rate:.4g}/s at {found.hz:.4g} Hz"


def taken_back(repairs: Sequence[Repair], changed: Sequence[ParameterChange]) -> list[Repair]:
    """Return the repairs that restore an edited gain."""
    solved = {(change.key, change.limit) for change in changed}
    return [repair for repair in repairs if (repair.key, repair.new) in solved]


def line_to_change(text: str, repairs: Sequence[Repair] | None, together: Sequence[ParameterChange]) -> int:
    """Return the line of the value to change; if the file does not state this value, return the line of the table."""
    lines = toml.Lines(text)
    of_gains = [repair.key for repair in repairs or [] if repair.key in SYMBOLS]
    first = [change.key for change in together[:1]] or of_gains[:1]
    paths = [path for key in first for path in (tuple(key.split(".")), (key.split(".")[0],))]
    return next((line for path in [*paths, ("gains",)] if (line := lines.locate(path)) is not None), 1)


def _proved(judgement: Judgement) -> str:
    demands, units = judgement.certificate.demands, UNITS[judgement.tightest.units]
    low, high = (edge / (2 * pi) for edge in demands.band)
    where = [f"from {low:.6g} to {high:.6g} Hz"] if demands.passive else []
    where += ["in any passive hand up to Nyquist"] if demands.any_hand else []
    if demands.hands is not None:
        worlds = f" with {demands.worlds.in_words(units)}" if demands.worlds else ""
        where += [f"in every hand of {demands.hands.in_words(units)}{worlds} up to Nyquist"]
    limits = [f"safety factor {demands.factor:g}"]
    limits += [f"|S| at most {demands.max_sensitivity:g}"] if judgement.kind.own_loop else []
    return f"proved, {judgement.ratio_name} {judgement.min_ratio:.6g} {' and '.join(where)}, {', '.join(limits)}"


def _whole(together: Sequence[ParameterChange]) -> str:
    numbers = [f"{change.key} = {change.limit:.12g} instead of {change.old:.12g}" for change in together]
    return f"the design of this problem, with {' and '.join(numbers)}, passes"


def _remedy(repairs: Sequence[Repair], changed: Sequence[ParameterChange]) -> str:
    """Return the best change of one gain after which the design passes, and the changes of the problem after which it
    passes."""
    if not repairs:
        return "no change of one number passes"
    of_gain = [repair for repair in repairs if repair.key in SYMBOLS]
    first, *others = [*of_gain[:1], *(repair for repair in repairs if repair.key not in SYMBOLS)]
    known = ", as in the design of this problem" if taken_back([first], changed) else ""
    so = f"; so would {', or '.join(map(str, others))}" if others else ""
    return f"{first} would pass{known}{so}"
