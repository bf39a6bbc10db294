"""`vctune compare`, as a function."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vctune.api.files import known_record
from vctune.api.solving import solve
from vctune.design.optimum import Progress
from vctune.design.record import record_of
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.comparison import ComparisonRecord, comparison
from vctune.document.record import DesignRecord


def compare(
    a: ProblemSource | DesignRecord, b: ProblemSource | DesignRecord, *, progress: Progress = lambda stage: None
) -> ComparisonRecord:
    """Set two designs side by side. A problem is solved for its design; nothing is written.

    Parameters
    ----------
    a, b : path of a design.json or of a problem file, the tables of a problem, a problem, or the record of a design
    progress : told the stage of the work

    Returns
    -------
    ComparisonRecord
        `problem`, the keys that differ, every default written out; `design`, the numbers and verdicts of both.

    Raises
    ------
    InputError
        If one of them is none.
    """
    records = [_designed(source, progress) for source in (a, b)]
    return comparison(records[0], records[1], (_called(a, records[0]), _called(b, records[1])))


def _designed(source: Any, progress: Progress) -> DesignRecord:
    known = known_record(source)
    if known is not None:
        return known
    file = problem_of(source)
    return record_of(file, solve(file, progress=progress))


def _called(source: Any, record: DesignRecord) -> str:
    return str(source) if isinstance(source, str | Path) else record.problem.name
