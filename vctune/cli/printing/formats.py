"""Write checks as text, JSON, GitHub annotations, JUnit XML and SARIF 2.1.0."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

from vctune.api.checking import Checked, CheckVerdict, check_object
from vctune.api.messages import printable
from vctune.version import __version__

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


def junit(checks: list[Checked]) -> str:
    """Return JUnit XML with the elements and attributes of Jenkins' schema, with one test case for each check."""
    failed = [checked.result in (CheckVerdict.FAILED, CheckVerdict.UNDECIDED) for checked in checks]
    broken = [checked.result is CheckVerdict.BAD_INPUT for checked in checks]
    counts = {"tests": str(len(checks)), "failures": str(sum(failed)), "errors": str(sum(broken))}
    root = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(root, "testsuite", {"name": "vctune check", **counts})
    for checked, fails, breaks in zip(checks, failed, broken, strict=True):
        source = printable(str(checked.source))
        seconds = checked.finding.seconds if checked.finding else 0.0
        case = {"classname": printable(checked.name), "name": source, "time": f"{seconds:.6f}"}
        element = ElementTree.SubElement(suite, "testcase", case)
        if fails or breaks:
            lines = _warning_lines(checked) if checked.failed_by_warnings else checked.message.splitlines()
            message = "\n".join(printable(line) for line in lines)
            attributes = {"message": message, "type": WORDS[checked.result]}
            problem = ElementTree.SubElement(element, "failure" if fails else "error", attributes)
            problem.text = f"{source}:{checked.line}: {message}" if fails else message
        if checked.warnings:
            ElementTree.SubElement(element, "system-out").text = "\n".join(_warning_lines(checked))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="us-ascii", xml_declaration=True).decode()


def _warning_lines(checked: Checked) -> list[str]:
    return [f"warning: {printable(warning)}" for warning in checked.warnings]


# Rule for warnings: rule id, level, short description, full description, help
WARNING = (
    "warning",
    "warning",
    "The gains pass, with a warning.",
    "The message tells the designer something besides the verdict, for example that the design hardly uses its "
    "velocity loop, or that the gains were made for another problem.",
    "Read the message. `vctune check --strict` fails if there is a warning.",
)
# Rules for checks that do not pass, in the same form
RULES = {
    CheckVerdict.FAILED: (
        "violated",
        "error",
        "The gains violate a constraint.",
        "The gains violate a constraint at the frequency that the message names: the device can oscillate with "
        "some passive hand or environment, or its loop is less robust than the problem requires.",
        "Change the gain that the message names to the value it names, or solve the problem again.",
    ),
    CheckVerdict.UNDECIDED: (
        "undecided",
        "warning",
        "The proof is undecided.",
        "The gains meet or violate a constraint by so little that ball arithmetic cannot decide, or vctune did "
        "not examine an axis.",
        "Move the gains away from the limit, relax the constraint a little, or check the axis with a problem of "
        "its own.",
    ),
    CheckVerdict.BAD_INPUT: (
        "bad-input",
        "error",
        "vctune cannot use the file.",
        "vctune cannot read the file, or the file states neither a valid problem nor valid gains.",
        "Correct the key on the line that the message names.",
    ),
}


_RULES = [*RULES.values(), WARNING]


def sarif(checks: list[Checked]) -> str:
    """Return a SARIF 2.1.0 log with the fields that GitHub requires."""
    results = []
    for checked in checks:
        if rule := RULES.get(checked.verdict):
            results.append(_result(checked, rule[0], rule[1], checked.message))
        results += [_result(checked, WARNING[0], _warning_level(checked), warning) for warning in checked.warnings]
    driver = {
        "name": "vctune",
        "version": __version__,
        "rules": [
            {
                "id": rule,
                "shortDescription": {"text": short},
                "fullDescription": {"text": full},
                "help": {"text": remedy},
                "defaultConfiguration": {"level": level},
            }
            for rule, level, short, full, remedy in _RULES
        ],
    }
    log = {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "columnKind": "utf16CodeUnits", "results": results}],
    }
    return json.dumps(log, indent=2, allow_nan=False)


def _result(checked: Checked, rule: str, level: str, message: str) -> dict[str, Any]:
    """Return a result of SARIF: a message at the line of a checked file."""
    place = {"artifactLocation": {"uri": _uri(checked.source)}, "region": {"startLine": checked.line}}
    return {
        "ruleId": rule,
        "ruleIndex": [rule_id for rule_id, *_ in _RULES].index(rule),
        "level": level,
        "message": {"text": message},
        "locations": [{"physicalLocation": place}],
    }


def _uri(path: Path) -> str:
    """Return a URI reference (RFC 3986): relative for a file below the working folder, absolute for any other file."""
    here, absolute = Path.cwd(), Path(os.path.abspath(path))
    if absolute.is_relative_to(here):
        return quote(os.fsencode(absolute.relative_to(here).as_posix()))
    return absolute.as_uri()


FORMATS: dict[str, Callable[[list[Checked]], str]] = {
    "text": text,
    "json": as_json,
    "github": github,
    "junit": junit,
    "sarif": sarif,
}
