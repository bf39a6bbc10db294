"""Checks as text, JSON, GitHub annotations, JUnit XML and SARIF 2.1.0."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any
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
        message = checked.message if checked.record is None else printable(checked.message)
        where = "" if checked.record is None else f"{checked.source}: "
        lines.append(f"{WORDS[checked.exit_code]:9}  {where}{message}")
        lines += [f"           warning: {warning}" for warning in (checked.record or {}).get("warnings", [])]
    if len(checks) > 1:
        counts = {word: sum(WORDS[c.exit_code] == word for c in checks) for word in WORDS.values()}
        lines.append(", ".join(f"{count} {word}" for word, count in counts.items() if count))
    return "\n".join(lines)


def as_json(checks: list[Checked]) -> str:
    """Return the object of DESIGN 2.3, or a list of them for several checks."""
    objects = [checked.record or _refused(checked) for checked in checks]
    return json.dumps(objects[0] if len(objects) == 1 else objects, indent=2, allow_nan=False)


def _refused(checked: Checked) -> dict[str, Any]:
    return {"schema": "vctune/design/1", "problem": {"name": checked.name}, "status": None, "reason": checked.message}


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
    """Return JUnit XML: a test case a check."""
    failed = [checked.exit_code in (ExitCode.FAILED, ExitCode.UNDECIDED) for checked in checks]
    broken = [checked.exit_code is ExitCode.BAD_INPUT for checked in checks]
    counts = {"tests": str(len(checks)), "failures": str(sum(failed)), "errors": str(sum(broken))}
    root = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(root, "testsuite", {"name": "vctune check", **counts})
    for checked, fails, breaks in zip(checks, failed, broken, strict=True):
        seconds = (checked.record or {}).get("seconds", {}).get("total", 0.0)
        case = {"classname": printable(checked.name), "name": str(checked.source), "time": f"{seconds:.6f}"}
        element = ElementTree.SubElement(
            suite, "testcase", {**case, "file": str(checked.source), "line": str(checked.line)}
        )
        if fails or breaks:
            kind = "failure" if fails else "error"
            message = "\n".join(printable(line) for line in checked.message.splitlines())
            problem = ElementTree.SubElement(element, kind, {"message": message, "type": WORDS[checked.exit_code]})
            problem.text = message
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)


def sarif(checks: list[Checked]) -> str:
    """Return a SARIF 2.1.0 log: a result for each check that did not pass."""
    rules = {
        ExitCode.FAILED: ("violated", "error", "The design violates its demands."),
        ExitCode.UNDECIDED: ("undecided", "warning", "The proof is undecided."),
        ExitCode.BAD_INPUT: ("bad-input", "error", "The file cannot be used."),
    }
    results = [
        {
            "ruleId": rules[checked.exit_code][0],
            "level": rules[checked.exit_code][1],
            "message": {"text": checked.message},
            "locations": [
                {
                    "physicalLocation": {
                        "artifactLocation": {"uri": checked.source.as_posix()},
                        "region": {"startLine": checked.line},
                    }
                }
            ],
        }
        for checked in checks
        if checked.exit_code in rules
    ]
    driver = {
        "name": "vctune",
        "version": __version__,
        "rules": [{"id": rule, "shortDescription": {"text": text}} for rule, _, text in rules.values()],
    }
    log = {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "columnKind": "utf16CodeUnits", "results": results}],
    }
    return json.dumps(log, indent=2, allow_nan=False)


FORMATS: dict[str, Callable[[list[Checked]], str]] = {
    "text": text,
    "json": as_json,
    "github": github,
    "junit": junit,
    "sarif": sarif,
}
