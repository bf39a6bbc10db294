"""Write checks as text, JSON and GitHub annotations."""

from __future__ import annotations

import json
from collections.abc import Callable

from vctune.api.checking import Checked, CheckVerdict, check_object
from vctune.api.messages import printable

WORDS = {
    CheckVerdict.PASSED: "passed",
    CheckVerdict.FAILED: "FAILED",
    CheckVerdict.UNDECIDED: "undecided",
    CheckVerdict.BAD_INPUT: "bad input",
}


def text(checks: list[Checked]) -> str:
    """Return one line for each check, and a summary if there are several checks."""
    lines = []
    for checked in checks:
        message = checked.message if checked.finding is None else printable(checked.message)
        where = "" if checked.finding is None else f"{printable(str(checked.source))}: "
        why = "; fails for its warnings" if checked.failed_by_warnings else ""
        lines.append(f"{WORDS[checked.result]:9}  {where}{message}{why}")
        lines += [f"           warning: {warning}" for warning in checked.warnings]
    if len(checks) > 1:
        counts = {word: sum(WORDS[c.result] == word for c in checks) for word in WORDS.values()}
        lines.append(", ".join(f"{count} {word}" for word, count in counts.items() if count))
    return "\n".join(lines)


def as_json(checks: list[Checked]) -> str:
    """Return the text of a list with one object for each check: the object of design.json, the verdict on a region, or
    the reason why neither exists."""
    return json.dumps([check_object(checked) for checked in checks], indent=2, allow_nan=False)


def github(checks: list[Checked]) -> str:
    """Return workflow commands that annotate the lines of the files: the message of each check, then its warnings."""
    levels = {CheckVerdict.PASSED: "notice", CheckVerdict.UNDECIDED: "warning"}
    lines = []
    for checked in checks:
        place = (
            f"file={_property(str(checked.source))},line={checked.line},title={_property('vctune: ' + checked.name)}"
        )
        lines.append(f"::{levels.get(checked.verdict, 'error')} {place}::{_data(checked.message)}")
        lines += [f"::{_warning_level(checked)} {place}::{_data(warning)}" for warning in checked.warnings]
    return "\n".join(lines)


def _warning_level(checked: Checked) -> str:
    return "error" if checked.strict else "warning"


def _data(message: str) -> str:
    return message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(value: str) -> str:
    return _data(value).replace(":", "%3A").replace(",", "%2C")


FORMATS: dict[str, Callable[[list[Checked]], str]] = {
    "text": text,
    "json": as_json,
    "github": github,
}
