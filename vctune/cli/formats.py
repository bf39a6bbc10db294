"""Write checks as text and as GitHub annotations."""

from __future__ import annotations

from collections.abc import Sequence

from vctune.api.checking import Checked, CheckVerdict
from vctune.document.text.errors import code_of, printable

WORDS = {
    CheckVerdict.PASSED: "passed",
    CheckVerdict.FAILED: "FAILED",
    CheckVerdict.UNDECIDED: "undecided",
    CheckVerdict.BAD_INPUT: "bad input",
}
LONGEST = 200  # Greatest number of characters of an annotation
REST = " ... (all of it in the log of this job)"
ROOM = LONGEST - len(REST)


def text(checked: Checked, warnings: Sequence[str]) -> str:
    """Return a line for a check, and one for each of some warnings."""
    message = checked.message if checked.finding is None else printable(checked.message)
    where = "" if checked.finding is None else f"{printable(str(checked.source))}: "
    why = "; fails for its warnings" if checked.failed_by_warnings else ""
    lines = [f"{WORDS[checked.result]:9}  {where}{message}{why}"]
    return "\n".join([*lines, *(f"           warning: {warning}" for warning in warnings)])


def summary(checks: list[Checked]) -> str:
    """Return how many checks have each verdict."""
    counts = {word: sum(WORDS[checked.result] == word for checked in checks) for word in WORDS.values()}
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count)


def github(checked: Checked, warnings: Sequence[str]) -> str:
    """Return workflow commands that annotate the line of a check: what to change, then its message, then warnings. A
    text that is longer than an annotation stands as a whole after it, in the log of the job."""
    levels = {CheckVerdict.PASSED: "notice", CheckVerdict.UNDECIDED: "warning"}
    place = f"file={_property(str(checked.source))},line={checked.line},title={_property('vctune: ' + checked.name)}"
    lines = []
    for level, said in (
        (levels.get(checked.verdict, "error"), checked.message),
        *((_level(checked, warning), warning) for warning in warnings),
    ):
        message = said.removeprefix(f"{printable(str(checked.source))}:{checked.line}: ")
        first = message.split("\n")[0]
        if said is checked.message and checked.remedy:
            first = f"{printable(checked.remedy)}; {first}"
        whole = [] if first == message and len(first) <= LONGEST else message.splitlines()
        if whole:
            first = (first if len(first) <= ROOM else first[:ROOM].rpartition(" ")[0]) + REST
        lines += [f"::{level} {place}::{_data(first)}", *(f"vctune: {printable(line)}" for line in whole)]
    return "\n".join(lines)


def _level(checked: Checked, warning: str) -> str:
    return "error" if checked.strict and code_of(warning) not in checked.allowed else "warning"


def _data(message: str) -> str:
    return message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(value: str) -> str:
    return _data(value).replace(":", "%3A").replace(",", "%2C")
