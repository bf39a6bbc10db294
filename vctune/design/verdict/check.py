"""Check existing gains: the verdict, one line of text, and the full record. The optimiser is imported only to find
repairs. See cli/README.md, section 2."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, floor, log10, pi
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vctune.analysis.in_hands import least_ratios
from vctune.analysis.in_worlds import growth_near
from vctune.design.prepared import pose
from vctune.design.result import Solved
from vctune.design.variables import keys_for, ranges
from vctune.design.verdict.design_record import record_of, warnings
from vctune.design.verdict.judge import Judgement, Status, judge_all
from vctune.design.verdict.parameter_changes import ParameterChange
from vctune.design.verdict.repair import Progress, edits, repairs_of_design
from vctune.document.doubts import file_doubts
from vctune.document.reading import GainsFile, ProblemFile, require_gains_of
from vctune.document.records.design_json import Repair
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake, Note
from vctune.model.hands import passive_hand
from vctune.model.numbers.units import SYMBOLS, UNITS, hertz, in_full, narrowed
from vctune.model.problem import Problem
from vctune.model.worlds import Worlds
from vctune.proof.certificate import certify
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.registry import BEFORE_WALL, IN_HANDS
from vctune.proof.outcome import Verdict
from vctune.proof.prover import boxes_at_most
from vctune.running import OutOfTimeError, out_of_time

OUT_OF_TIME = Note("time-limit", "the time limit cut the check short; what is stated was known by then")
OTHER_VERSION = Note("other-version", "the gains were made for another version of the problem (sha256 differs)")
MOST_BOXES = 20_000  # Greatest number of boxes of the proof that a design misses only the safety factor


class CheckVerdict(StrEnum):
    """The verdict of a check."""

    PASSED = "passed"
    FAILED = "failed"
    UNDECIDED = "undecided"
    BAD_INPUT = "bad input"


VERDICTS = {
    Status.CERTIFIED: CheckVerdict.PASSED,
    Status.VIOLATED: CheckVerdict.FAILED,
    Status.UNDECIDED: CheckVerdict.UNDECIDED,
    Status.INFEASIBLE: CheckVerdict.FAILED,
}


class Finding(Protocol):
    """The details of a check of usable input: warnings and JSON object."""

    @property
    def warnings(self) -> list[str]: ...
    def record(self) -> dict[str, Any]: ...


@dataclass(frozen=True, slots=True)
class DesignFinding:
    """The details of a check of valid gains."""

    file: ProblemFile
    judgement: Judgement
    repairs: list[Repair] | None
    warnings: list[str]

    def record(self) -> dict[str, Any]:
        """Return the object of design.json."""
        solved = Solved(problem=self.file.problem, judgement=self.judgement, repairs=self.repairs)
        found = record_of(self.file, solved)
        return found.model_copy(update={"warnings": list(dict.fromkeys([*self.warnings, *found.warnings]))}).to_json()


@dataclass(frozen=True, slots=True)
class Checked:
    """The result of a check."""

    source: Path  # path of the file that states the gains
    name: str  # name of the problem
    verdict: CheckVerdict  # verdict on the claims
    message: str
    line: int  # line of the source to which the message refers
    finding: Finding | None  # details of the check; None for bad input
    strict: bool = False  # whether a warning fails the check

    @property
    def warnings(self) -> list[str]:
        """The warnings in addition to the verdict."""
        return self.finding.warnings if self.finding else []

    @property
    def failed_by_warnings(self) -> bool:
        """Whether the check fails only because of its warnings."""
        return self.strict and bool(self.warnings) and self.verdict in (CheckVerdict.PASSED, CheckVerdict.UNDECIDED)

    @property
    def result(self) -> CheckVerdict:
        """The verdict, or "failed" because of a warning."""
        return CheckVerdict.FAILED if self.failed_by_warnings else self.verdict


def check_problem(
    file: ProblemFile, design: GainsFile | None = None, progress: Progress = lambda stage: None
) -> Checked:
    """Check the design that a problem fixes, or another design for the problem."""
    problem = file.problem
    if design is not None:
        require_gains_of(file, design)
    elif problem.bounds.fixed:
        law = problem.fixed_design
        design = GainsFile(problem.device.kind, *law, sha256=None, units=None, text=file.text, source=file.source)
    else:
        free = [key for key, bounds in zip(keys_for(problem), ranges(problem), strict=True) if not bounds.fixed]
        message = "nothing to check: not fixed; name a gains file, or fix the numbers"
        raise InputError(file.source, [Mistake("not-fixed", ", ".join(free), message)])
    with np.errstate(all="ignore"):
        return _judged(file, design, progress)


def _judged(file: ProblemFile, design: GainsFile, progress: Progress) -> Checked:
    progress(f"proving {Path(design.source).name}")
    (judgement,) = judge_all(file.problem, [(design.gains, design.coupling)], [design.corner])
    edited = edits(file.problem, judgement, design.solved) if design.sha256 == file.sha256 else []
    repairs, together, remedies = None, list[ParameterChange](), list[str]()
    if judgement.status is Status.VIOLATED:
        stated = toml.parse(file.text, file.problem.name)
        repairs, undone = repairs_of_design(stated, judgement, edited, progress)
        together = edited if undone else []
    other = [OTHER_VERSION] if design.sha256 and design.sha256 != file.sha256 else []
    finding = finding_of(file, judgement, repairs, other)
    if together:
        numbers = [f"{change.key} = {change.limit:.12g} instead of {change.old:.12g}" for change in together]
        remedies.append(f"the design of this problem, with {' and '.join(numbers)}, passes")
    if finding.repairs is not None:
        remedies.append(_remedy(finding.repairs, edited))
    known = rendered_in_words(file.problem, judgement)
    message = "; ".join([check_message(judgement), *remedies, *([known] if known else [])])
    line = _line_to_change(design.text, finding.repairs, together)
    return Checked(Path(design.source), file.problem.name, VERDICTS[judgement.status], message, line, finding)


def finding_of(
    file: ProblemFile, judgement: Judgement, repairs: list[Repair] | None, notes: Sequence[Note]
) -> DesignFinding:
    """Return the details of the check of judged gains, with all warnings."""
    cut = judgement.cut
    if judgement.status is Status.VIOLATED:
        cut |= out_of_time()
        repairs = repairs or None if cut else repairs  # after the time limit others may exist
    found = [*([OUT_OF_TIME] if cut else []), *file_doubts(file), *warnings(file.problem, judgement), *notes]
    return DesignFinding(file, judgement, repairs, [note.line for note in found])


def check_message(judgement: Judgement) -> str:
    """Return the proved claims of a design, or the claims that fail with the least margin."""
    if judgement.status is Status.CERTIFIED:
        return _proved(judgement)
    at, units = judgement.binding, UNITS[judgement.device.units]
    hand = "" if at.hand is None else f" in the hand of {at.hand.in_words(units)}"
    if _misses_only_the_factor(judgement):
        return judgement.stable_but + hand
    grows = [words] if (words := _growth(judgement)) else []
    if (missed := judgement.reserve_missed) is not None:
        return "; ".join([missed + hand, *judgement.open_claims, *grows])
    worst = f"{judgement.ratio_name} {at.ratio:.6g} at {at.omega / (2 * pi):.6g} Hz{hand}"
    return "; ".join([*judgement.open_claims, worst, *grows])


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
    limits += [f"|S| at most {in_full(demands.max_sensitivity)}"] if judgement.kind.own_loop else []
    return f"proved, {judgement.ratio_name} {judgement.min_ratio:.6g} {' and '.join(where)}, {', '.join(limits)}"


def _misses_only_the_factor(judgement: Judgement) -> bool:
    """Return whether a refuted design is proved without a safety factor, where only hands or environments ask for it.

    `Judgement.reserve_missed` says so of Llewellyn's conditions.
    """
    certificate = judgement.certificate
    failing = {claim for claim, outcome in certificate.outcomes.items() if outcome.verdict is not Verdict.PROVED}
    if certificate.demands.factor <= 1 or not failing or not failing <= {*IN_HANDS, *BEFORE_WALL, "any_hand"}:
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
    behind = "with the least environment of the box"
    if worlds.exact and worlds.high.mass == 0:
        behind = "with its spring alone" if worlds.high.stiffness else "with nothing behind it"
    hand = outcome.hand.in_words(UNITS[judgement.device.units])
    return f"in the hand of {hand} {behind} a motion grows by {found.rate:.4g}/s at {found.hz:.4g} Hz"


def _remedy(repairs: Sequence[Repair], edited: Sequence[ParameterChange]) -> str:
    """Return the best change of one gain after which the design passes, and the changes of the problem after which it
    passes."""
    if not repairs:
        return "no change of one number passes"
    of_gain = [repair for repair in repairs if repair.key in SYMBOLS]
    first, *others = [*of_gain[:1], *(repair for repair in repairs if repair.key not in SYMBOLS)]
    taken_back = (first.key, first.new) in {(change.key, change.limit) for change in edited}
    known = ", as in the design of this problem" if taken_back else ""
    so = f"; so would {', or '.join(map(str, others))}" if others else ""
    return f"{first} would pass{known}{so}"


def _line_to_change(text: str, repairs: Sequence[Repair] | None, together: Sequence[ParameterChange]) -> int:
    """Return the line of the value to change; if the file does not state this value, return the line of the table."""
    lines = toml.Lines(text)
    keys = [change.key for change in together] or [repair.key for repair in repairs or [] if repair.key in SYMBOLS]
    paths = [path for key in keys[:1] for path in (tuple(key.split(".")), (key.split(".")[0],))]
    return next((line for path in [*paths, ("gains",)] if (line := lines.locate(path)) is not None), 1)


STIFFNESSES, MASSES = (1e-4, 1e3), (1e-2, 1e5)  # Searched multiples of Z_0/T and of Z_0 T
HALVINGS = 14  # Number of bisections: the limit is found to .1 %
RESERVES = (5e-3, 0.03, 0.1)  # Distances from the limit in doubles at which a proof is tried


def rendered_in_words(problem: Problem, judgement: Judgement) -> str:
    """Return "proved are springs up to ... and tools from ..."; "" without a box of linear environments."""
    worlds, units = problem.worlds, problem.units
    if problem.hands_met is None or worlds is None or worlds.walls or worlds.exact:
        return ""
    spring = tool = None
    Z_0, T = problem.transparency.reference_impedance, problem.device.sample_time
    try:
        spring = _limit(problem, judgement, "stiffness", *(Z_0 / T * share for share in STIFFNESSES))
        tool = _limit(problem, judgement, "mass", *(Z_0 * T * share for share in MASSES))
    except OutOfTimeError:
        return ""
    found = [f"springs up to {spring:g} {units.stiffness}"] if spring is not None else []
    found += [f"tools from {tool:g} {units.mass}"] if tool is not None else []
    return f"proved are {' and '.join(found)}" if found else ""


def _limit(problem: Problem, judgement: Judgement, name: str, low: float, high: float) -> float | None:
    """Return the greatest stiffness or the least mass that is proved, with the box's other ranges; None if none is."""
    stiff = name == "stiffness"
    good, bad = (low, high) if stiff else (high, low)
    if not _holds(problem, judgement, name, good):
        return None
    for _ in range(HALVINGS):
        middle = (good * bad) ** 0.5
        good, bad = (middle, bad) if _holds(problem, judgement, name, middle) else (good, middle)
    for reserve in RESERVES:
        value = _rounded(good * (1 - reserve), up=False) if stiff else _rounded(good * (1 + reserve), up=True)
        if _holds_up_to(problem, judgement, name, value):
            return value
    return None


def _with_end(worlds: Worlds, name: str, value: float) -> Worlds:
    """Return the box with another greatest stiffness or least mass; the other end moves with it where it must."""
    low, high = getattr(worlds.low, name), getattr(worlds.high, name)
    ends = (min(low, value), value) if name == "stiffness" else (value, max(high, value))
    return replace(worlds, low=replace(worlds.low, **{name: ends[0]}), high=replace(worlds.high, **{name: ends[1]}))


def _holds(problem: Problem, judgement: Judgement, name: str, value: float) -> bool:
    """Return whether the design seems stable with the other box, in doubles."""
    assert problem.worlds is not None
    posed = pose(replace(problem, worlds=_with_end(problem.worlds, name, value)))
    ratios = (least_ratios(case, judgement.gains, judgement.coupling)[0].ratio for case in posed.hand_cases)
    return min(ratios) >= problem.stability.safety_factor


def _holds_up_to(problem: Problem, judgement: Judgement, name: str, value: float) -> bool:
    assert problem.worlds is not None
    posed = pose(replace(problem, worlds=_with_end(problem.worlds, name, value)))
    design = Design(posed.demands.device, judgement.gains, judgement.coupling)
    return prove_hands(design, posed.demands, posed.box).verdict is Verdict.PROVED


def _rounded(value: float, *, up: bool) -> float:
    """Return a number of three digits that is not beyond the given one."""
    unit = 10.0 ** (floor(log10(value)) - 2)
    return float(f"{(ceil if up else floor)(value / unit) * unit:.3g}")
