"""Gains that already exist, judged: the gate for continuous integration (DESIGN 2.4). Needs no optimiser."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from vctune.design.judge import EXIT_CODES, Judgement, Status, judge
from vctune.design.record import design_record
from vctune.design.repair import Change, least_change
from vctune.design.result import Solved
from vctune.design.variables import KEYS, ranges
from vctune.document import toml
from vctune.document.errors import InputError, Mistake
from vctune.document.problem import Problem
from vctune.document.reading import GainsFile, ProblemFile, read_gains, read_problem
from vctune.exits import ExitCode
from vctune.proof.interval import Verdict


@dataclass(frozen=True, slots=True)
class Checked:
    """What a check found.

    Attributes
    ----------
    source : the file that holds the numbers
    name : of the problem
    exit_code : of this check alone
    message : one line: proved, or what fails and what would mend it, or what is wrong with the input
    line : of the source, that the message is about
    record : the object of DESIGN 2.3; None for bad input
    """

    source: Path
    name: str
    exit_code: ExitCode
    message: str
    line: int
    record: dict[str, Any] | None


def check(problem: Path, gains: Path | None) -> Checked:
    """Check the gains of a gains file, or a problem's own fixed numbers, against the problem's demands."""
    source = gains or problem
    try:
        file = read_problem(problem)
        given = read_gains(gains) if gains else None
        if given is None and not file.problem.bounds.fixed:
            raise InputError(str(problem), [_free(file.problem)])
    except InputError as error:
        return Checked(source, problem.stem, ExitCode.BAD_INPUT, str(error), error.mistakes[0].line or 1, None)
    return _judged(file, given, source)


def _free(problem: Problem) -> Mistake:
    free = [key for key, bounds in zip(KEYS, ranges(problem.bounds), strict=True) if not bounds.fixed]
    return Mistake(", ".join(free), "nothing to check: not fixed; name a gains file, or fix the numbers")


@np.errstate(all="ignore")
def _judged(file: ProblemFile, given: GainsFile | None, source: Path) -> Checked:
    began = perf_counter()
    problem = file.problem
    gains, coupling = (given.gains, given.coupling) if given else problem.fixed_design
    judgement = judge(problem, gains, coupling)
    change = least_change(problem, gains, coupling) if judgement.status is Status.VIOLATED else None
    seconds = {"prove": perf_counter() - began}
    record = design_record(file, Solved(problem, judgement, None, 0, None, None, seconds))
    made_for = given.sha256 if given else None
    if made_for and made_for != file.sha256:
        record["warnings"].append("the gains were made for another version of the problem (sha256 differs)")
    record["repair"] = {"key": change.key, "old": change.old, "new": change.new} if change else None
    text = given.text if given else file.text
    return Checked(
        source,
        problem.name,
        EXIT_CODES[judgement.status],
        _message(judgement, change),
        _line(text, change),
        record,
    )


def _message(judgement: Judgement, change: Change | None) -> str:
    if judgement.status is Status.CERTIFIED:
        return f"proved, least Re Z_c / R {judgement.min_ratio:.6g}"
    failing = []
    for claim, outcome in judgement.certificate.outcomes.items():
        if outcome.verdict is not Verdict.PROVED:
            place = f" at {outcome.witness / (2 * pi):.6g} Hz" if outcome.witness else ""
            failing.append(f"{outcome.verdict.value}{place}: {claim.value}")
    worst = f"least Re Z_c / R {judgement.min_ratio:.6g} at {judgement.worst / (2 * pi):.6g} Hz"
    if judgement.status is Status.UNDECIDED:
        return "; ".join([*failing, worst])
    mend = (
        f"{change.key} = {change.new:g} instead of {change.old:g} would pass"
        if change
        else "no change of one gain passes"
    )
    return "; ".join([*failing, worst, mend])


def _line(text: str, change: Change | None) -> int:
    """Return the line of the gain to change, or of the table that has the gains."""
    lines = toml.Lines(text)
    paths = [tuple(change.key.split("."))] if change else []
    return next((line for path in [*paths, ("gains",)] if (line := lines.locate(path)) is not None), 1)
