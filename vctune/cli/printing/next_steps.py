"""Suggest what the user can do next with the design that a command wrote."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from vctune.api.argument_ranges import STDIN
from vctune.api.design_files import REPORT
from vctune.api.folders import DESIGN_FILE, GAINS_FILE

if TYPE_CHECKING:
    from vctune.document.records.design_json import DesignRecord


def after_design(record: DesignRecord, folder: Path, problem: Path) -> list[str]:
    """Return the next steps."""
    report, design = folder / REPORT, quote(str(folder / DESIGN_FILE))
    look = [f"open {report}" if report.exists() else f"vctune report {design}"]
    if record.repairs:
        return [f"write {record.repairs[0].needs} into {_name(problem)} and solve again", *look]
    if record.status != "certified":
        return look
    known = [] if problem == STDIN else [f"in CI vctune check {quote(str(problem))} {quote(str(folder / GAINS_FILE))}"]
    return [*look, f"vctune export {design}", *known]


def after_bound(record: DesignRecord, design: Path, problem: Path) -> list[str]:
    """Return the next steps after a search for a bound: resume an unfinished search, then the steps of
    `after_design`."""
    found = record.optimality
    going_on = found is not None and found.verdict == "open" and record.status == "certified"
    again = ["run it again to resume"] if going_on else []
    return [*again, *after_design(record, design.parent, problem)]


def _name(problem: Path) -> str:
    return "the problem" if problem == STDIN else str(problem)
