"""Checks as text, JSON, GitHub annotations, JUnit XML and SARIF 2.1.0."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

from vctune.design.check import Checked
from vctune.document.errors import printable
from vctune.exits import ExitCode
from vctune.version import __version__

WORDS = {
    ExitCode.OK: "passed",
    ExitCode.FAILED: "FAILED",
    ExitCode.UNDECIDED: "undecided",
    ExitCode.BAD_INPUT: "bad input",
}


def text(checks: list[Checked]) -> str:
    """Return a line a check, and a summary when there are several."""
    lines = []
    for checked in checks:
        message = checked.message if checked.finding is None else printable(checked.message)
        where = "" if checked.finding is None else f"{printable(str(checked.source))}: "
        lines.append(f"{WORDS[checked.exit_code]:9}  {where}{message}")
        lines += [f"           warning: {warning}" for warning in _warnings(checked)]
    if len(checks) > 1:
        counts = {word: sum(WORDS[c.exit_code] == word for c in checks) for word in WORDS.values()}
        lines.append(", ".join(f"{count} {word}" for word, count in counts.items() if count))
    return "\n".join(lines)


def _warnings(checked: Checked) -> list[str]:
    return checked.finding.warnings if checked.finding else []


def as_json(checks: list[Checked]) -> str:
    """Return the object of DESIGN 2.3, or a list of them for several checks."""
    objects = [checked.finding.record() if checked.finding else _refused(checked) for checked in checks]
    return json.dumps(objects[0] if len(objects) == 1 else objects, indent=2, allow_nan=False)


def _refused(checked: Checked) -> dict[str, Any]:
    return {
        "schema": "vctune/design/1",
        "problem": {"name": printable(checked.name)},
        "status": None,
        "reason": checked.message,
    }


def github(checks: list[Checked]) -> str:
    """Return workflow commands that annotate the lines of the files."""
    lines = []
    for checked in checks:
        if checked.exit_code is ExitCode.OK:
            continue
        level = "warning" if checked.exit_code is ExitCode.UNDECIDED else "error"
        place = (
            f"file={_property(str(checked.source))},line={checked.line},title={_property('vctune: ' + checked.name)}"
        )
        lines.append(f"::{level} {place}::{_data(checked.message)}")
    return "\n".join(lines)


def _data(message: str) -> str:
    return message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(value: str) -> str:
    return _data(value).replace(":", "%3A").replace(",", "%2C")


def junit(checks: list[Checked]) -> str:
    """Return JUnit XML, in the elements and attributes that Jenkins' schema knows: a test case a check."""
    failed = [checked.exit_code in (ExitCode.FAILED, ExitCode.UNDECIDED) for checked in checks]
    broken = [checked.exit_code is ExitCode.BAD_INPUT for checked in checks]
    counts = {"tests": str(len(checks)), "failures": str(sum(failed)), "errors": str(sum(broken))}
    root = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(root, "testsuite", {"name": "vctune check", **counts})
    for checked, fails, breaks in zip(checks, failed, broken, strict=True):
        source = printable(str(checked.source))
        seconds = checked.finding.seconds if checked.finding else 0.0
        case = {"classname": printable(checked.name), "name": source, "time": f"{seconds:.6f}"}
        element = ElementTree.SubElement(suite, "testcase", case)
        if fails or breaks:
            message = "\n".join(printable(line) for line in checked.message.splitlines())
            attributes = {"message": message, "type": WORDS[checked.exit_code]}
            problem = ElementTree.SubElement(element, "failure" if fails else "error", attributes)
            problem.text = f"{source}:{checked.line}: {message}" if fails else message
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="us-ascii", xml_declaration=True).decode()


RULES = {
    ExitCode.FAILED: (
        "violated",
        "error",
        "The gains violate a demand.",
        "A demand fails at the frequency that the message names: in some passive hand or environment the device can "
        "oscillate, or its loop is less robust than the problem asks.",
        "Change the gain that the message names to the value it names, or solve the problem again.",
    ),
    ExitCode.UNDECIDED: (
        "undecided",
        "warning",
        "The proof is undecided.",
        "A demand is met or missed by so little that ball arithmetic cannot tell.",
        "Move the gains away from the limit, or lower the demand a little.",
    ),
    ExitCode.BAD_INPUT: (
        "bad-input",
        "error",
        "The file cannot be used.",
        "The file cannot be read, or what it says is no problem and no gains that can be checked.",
        "Correct the key on the line that the message names.",
    ),
}
"""Of a check that does not pass: rule id, level, short description, full description, help."""


def sarif(checks: list[Checked]) -> str:
    """Return a SARIF 2.1.0 log with what GitHub code scanning requires: a result for each check that did not pass."""
    results = [_result(checked) for checked in checks if checked.exit_code in RULES]
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
            for rule, level, short, full, remedy in RULES.values()
        ],
    }
    log = {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "columnKind": "utf16CodeUnits", "results": results}],
    }
    return json.dumps(log, indent=2, allow_nan=False)


def _result(checked: Checked) -> dict[str, Any]:
    rule, level, *_ = RULES[checked.exit_code]
    place = {"artifactLocation": {"uri": _uri(checked.source)}, "region": {"startLine": checked.line}}
    return {
        "ruleId": rule,
        "ruleIndex": list(RULES).index(checked.exit_code),
        "level": level,
        "message": {"text": checked.message},
        "locations": [{"physicalLocation": place}],
    }


def _uri(path: Path) -> str:
    """Return a URI reference (RFC 3986): relative for a file below the working folder, absolute for any other."""
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
