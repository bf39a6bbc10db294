"""Define the result of a check: the verdict, one line of text, and the full record of the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

from vctune.design.result import Repair, Solved
from vctune.design.verdict.design_record import record_of, warnings
from vctune.design.verdict.judge import Judgement, Status
from vctune.document.doubts import file_doubts
from vctune.document.reading import ProblemFile
from vctune.document.text.codes import Note
from vctune.running import out_of_time

OUT_OF_TIME = Note("time-limit", "the time limit cut the check short; what is stated was known by then")


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


class Finding(Protocol):
    """The details of a check of usable input: warnings and JSON object."""

    @property
    def warnings(self) -> list[str]: ...
    def record(self) -> dict[str, Any]: ...


@dataclass(frozen=True, slots=True)
class DesignFinding:
    """The details of a check of valid gains."""

    file: ProblemFile  # the problem
    judgement: Judgement  # judgement of the gains
    repairs: list[Repair] | None
    warnings: list[str]  # warnings for the user

    def record(self) -> dict[str, Any]:
        """Return the object of design.json."""
        solved = Solved(problem=self.file.problem, judgement=self.judgement, repairs=self.repairs)
        return record_of(self.file, solved).model_copy(update={"warnings": self.warnings}).to_json()


def finding_of(
    file: ProblemFile,
    judgement: Judgement,
    repairs: list[Repair] | None,
    notes: Sequence[Note],
) -> DesignFinding:
    """Return the details of the check of judged gains, with all warnings."""
    cut = judgement.cut
    if judgement.status is Status.VIOLATED:
        cut |= out_of_time()
        repairs = repairs or None if cut else repairs  # after the time limit others may exist
    found = [OUT_OF_TIME] if cut else []
    found += [*file_doubts(file), *warnings(file.problem, judgement)]
    lines = [note.line for note in [*found, *notes]]
    return DesignFinding(file, judgement, repairs, lines)
