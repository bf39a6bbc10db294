"""Check existing gains: the verdict, one line of text, and the full record. The optimiser is imported only to find
repairs. See cli/README.md, section 2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil, exp, floor, log, log10
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vctune.analysis.extrema import last_to_hold
from vctune.analysis.in_hands import least_ratios
from vctune.analysis.multiples import suspects
from vctune.design.advice.parameter_changes import ParameterChange
from vctune.design.advice.repair import Found, Progress, edits, repairs_of_design
from vctune.design.judging.judge import Judgement, Status, judge_all
from vctune.design.judging.said import said_of
from vctune.design.prepared import pose
from vctune.design.records.design import record_of
from vctune.design.records.shake import in_few_words, shaken_in_time
from vctune.design.records.shake import notes as shake_notes
from vctune.design.records.warned import warnings
from vctune.design.result import Repair, Solved
from vctune.design.search.theorems import impossible
from vctune.design.variables import keys_for, ranges
from vctune.document.doubts import file_doubts
from vctune.document.reading import GainsFile, ProblemFile, problem_of_gains
from vctune.document.ros import TUNED
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake, Note, code_of
from vctune.model.design import Design
from vctune.model.numbers.units import SYMBOLS
from vctune.model.problem import Problem
from vctune.model.worlds import Worlds
from vctune.proof.claims.claim import Question
from vctune.proof.claims.worlds import WORLDS
from vctune.proof.outcome import Verdict
from vctune.running import OutOfTimeError, out_of_time

OUT_OF_TIME = Note("time-limit", "the time limit cut the check short; what is stated was known by then")
OTHER_VERSION = Note("other-version", "the gains were made for another version of the problem (sha256 differs)")


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
    found: Found
    warnings: list[str]

    @property
    def repairs(self) -> list[Repair] | None:
        """The changes of one value after which the design passes; None if none were looked for."""
        return self.found.repairs

    def record(self) -> dict[str, Any]:
        """Return the object of design.json."""
        repairs, tried = self.found.repairs, list(self.found.tried)
        both = list(self.found.together)
        solved = Solved(
            problem=self.file.problem, judgement=self.judgement, repairs=repairs, tried=tried, together=both
        )
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
    allowed: tuple[str, ...] = ()  # codes of warnings that do not fail it
    remedy: str = ""  # the first change after which the design passes, in words

    @property
    def warnings(self) -> list[str]:
        """The warnings in addition to the verdict."""
        return self.finding.warnings if self.finding else []

    @property
    def failed_by_warnings(self) -> bool:
        """Whether the check fails only because of its warnings."""
        counted = [each for each in self.warnings if code_of(each) not in self.allowed]
        return self.strict and bool(counted) and self.verdict in (CheckVerdict.PASSED, CheckVerdict.UNDECIDED)

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
        file = problem_of_gains(file, design)
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
    theorem = impossible(file.problem) if file.problem.device.kind.inverse else None
    if theorem is not None:  # that excludes any gains
        raise InputError.of(file.source, "contradiction", theorem.reason, key="device.damping")
    progress(f"proving {Path(design.source).name}")
    (judgement,) = judge_all(file.problem, [(design.gains, design.coupling)], [design.corner])
    edited = edits(file.problem, judgement, design.solved) if design.sha256 == file.sha256 else []
    repairs, together, remedies = Found(), list[ParameterChange](), list[str]()
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
        remedies += remedy(repairs, {change.key: change.limit for change in edited})
    known = rendered_in_words(file.problem, judgement)
    shakes = in_few_words(*shaken_in_time(file.problem, judgement)) if judgement.status is Status.CERTIFIED else []
    message = "; ".join([said_of(judgement), *remedies, *([known] if known else []), *shakes])
    line = _line_to_change(design.text, finding.repairs, together)
    first = remedies[0] if together else first_remedy(repairs)
    said = VERDICTS[judgement.status]
    return Checked(Path(design.source), file.problem.name, said, message, line, finding, remedy=first)


def finding_of(file: ProblemFile, judgement: Judgement, repairs: Found, notes: Sequence[Note]) -> DesignFinding:
    """Return the details of the check of judged gains, with all warnings."""
    cut = judgement.cut or (judgement.status is Status.VIOLATED and out_of_time())
    found = [*([OUT_OF_TIME] if cut else []), *file_doubts(file), *warnings(file.problem, judgement), *notes]
    found += shake_notes(*shaken_in_time(file.problem, judgement), file.problem)
    return DesignFinding(file, judgement, repairs, [note.line for note in found])


def remedy(found: Found, solved: Mapping[str, float], place: str = "") -> list[str]:
    """Return in words the changes after which a design passes, those of its law first, then those of the device, then
    those of what is assumed; or what was tried in vain. A place is said of the keys of a problem beside a parameter
    file."""
    own, assumed = (
        [f"{place * (repair.key not in TUNED)}{repair}" for repair in found.repairs or [] if repair.assumes == kind]
        for kind in (False, True)
    )
    said = list[str]()
    if found.together:  # of the law, where no change of one of its numbers passes
        both = " and ".join(f"{place * (repair.key not in TUNED)}{repair}" for repair in found.together)
        said.append(f"{both} together would pass")
    if own:
        first, *others = own
        key = next(repair.key for repair in found.repairs or [] if not repair.assumes)
        of_problem = f" (the design of this problem has {solved[key]:.12g})" if key in solved else ""
        so = f"; so would {', or '.join(others)}" if others else ""
        said.append(f"{first}{of_problem} would pass{so}")
    if assumed:
        said.append(f"with {', or '.join(assumed)}, if that is so, it passes")
    if found.tried and not found.together:
        said.append(f"none of these, each changed alone, passes: {', '.join(found.tried)}")
    return said


def first_remedy(found: Found, place: str = "") -> str:
    """Return in words the first change, or the two together, after which the design passes; "" without one."""
    for repair in [] if found.together else sorted(found.repairs or [], key=lambda repair: bool(repair.assumes)):
        stated = f"{place * (repair.key not in TUNED)}{repair}"
        return f"with {stated}, if that is so, it passes" if repair.assumes else f"{stated} would pass"
    return next(iter(remedy(found._replace(tried=()), {}, place)), "")


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
    good = exp(last_to_hold(lambda x: _holds(problem, judgement, name, exp(x)), log(good), log(bad), HALVINGS))
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
    return WORLDS.prove(Question(design, posed.demands, posed.box, suspects), {}).verdict is Verdict.PROVED


def _rounded(value: float, *, up: bool) -> float:
    """Return a number of three digits that is not beyond the given one."""
    unit = 10.0 ** (floor(log10(value)) - 2)
    return float(f"{(ceil if up else floor)(value / unit) * unit:.3g}")
