"""The result of a check: the verdict in one line, and the full record of the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

from vctune.design.result import Repair, Solved
from vctune.design.verdict.design_record import record_of, warnings
from vctune.design.verdict.judge import Judgement, Status
from vctune.design.verdict.repair import CUT_SHORT, LONGEST
from vctune.document.file_doubts import file_doubts
from vctune.document.reading import ProblemFile
from vctune.document.text.codes import Note
from vctune.markup import html_facts
from vctune.running import out_of_time

OUT_OF_TIME = Note("time-limit", "the time limit cut the check short; what is stated was known by then")
SOLVE_INSTEAD = Note("warn-solve-instead", "solving the problem finds a design that does use its velocity loop")


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


@dataclass(frozen=True, slots=True)
class Checked:
    """The result of a check.

    Attributes
    ----------
    source : the file that holds the numbers
    name : name of the problem
    verdict : the proved claims
    message : one line: proved, or the failure and its repair, or the fault of the input
    line : line of the source, that the message is about
    finding : None for bad input
    strict : whether a warning fails the check
    """

    source: Path
    name: str
    verdict: CheckVerdict
    message: str
    line: int
    finding: Finding | None
    strict: bool = False

    @property
    def warnings(self) -> list[str]:
        """Warnings beside the verdict."""
        return self.finding.warnings if self.finding else []

    @property
    def failed_by_warnings(self) -> bool:
        """Whether it is for its warnings alone that the check fails."""
        return self.strict and bool(self.warnings) and self.verdict in (CheckVerdict.PASSED, CheckVerdict.UNDECIDED)

    def _repr_html_(self) -> str:
        facts = {"": self.message} | {f"warning {number}": text for number, text in enumerate(self.warnings, 1)}
        return html_facts(f"{self.name}: {self.result}", facts)

    @property
    def result(self) -> CheckVerdict:
        """The verdict, or failed for a warning alone."""
        return CheckVerdict.FAILED if self.failed_by_warnings else self.verdict


class Finding(Protocol):
    """The details of a check of usable input: warnings, the seconds it took, and the JSON object."""

    @property
    def warnings(self) -> list[str]: ...
    @property
    def seconds(self) -> float: ...
    def record(self) -> dict[str, Any]: ...


@dataclass(frozen=True, slots=True)
class DesignFinding:
    """The details of gains that could be judged.

    Attributes
    ----------
    file : the problem
    judgement : judgement of the gains
    repairs : repairs of a violated design, those of its own numbers first, of the least error first
    warnings : warnings for the user
    seconds : it took
    """

    file: ProblemFile
    judgement: Judgement
    repairs: list[Repair] | None
    warnings: list[str]
    seconds: float

    def record(self) -> dict[str, Any]:
        """Return the object of design.json."""
        solved = Solved(problem=self.file.problem, judgement=self.judgement, repairs=self.repairs)
        return record_of(self.file, solved).model_copy(update={"warnings": self.warnings}).to_json()


def finding_of(
    file: ProblemFile,
    judgement: Judgement,
    repairs: list[Repair] | None,
    notes: Sequence[Note],
    repairing: float,
    proving: float,
) -> DesignFinding:
    """Return the details of judged gains, with all warnings.

    Parameters
    ----------
    file : the problem
    judgement : judgement of the gains
    repairs : repairs found so far; None if not sought
    notes : beside those of any judged gains
    repairing, proving : how long it took, s
    """
    cut = judgement.cut
    if judgement.status is Status.VIOLATED or judgement.idle:
        cut |= out_of_time()
        repairs = repairs or None if cut else repairs  # that there is none was not found out
    found = [CUT_SHORT] if repairing > LONGEST else []
    if cut:
        found.append(OUT_OF_TIME)
    found += [*file_doubts(file), *warnings(file.problem, judgement, repairs)]
    if judgement.idle and repairs is None:
        found.append(SOLVE_INSTEAD)
    lines = [note.line for note in [*found, *notes]]
    return DesignFinding(file, judgement, repairs, lines, proving + repairing)
