"""Provide `vctune check` as a function. This module imports the optimiser only if a check needs it."""

from __future__ import annotations

import json
from math import inf
from pathlib import Path
from typing import Any

from vctune.design.verdict.checked import Checked as Checked
from vctune.design.verdict.checked import CheckVerdict as CheckVerdict
from vctune.design.verdict.gains_check import check_problem
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design as design_of
from vctune.document.building import problem as problem_of
from vctune.document.records.printed_json import NamedRecord, RefusalRecord
from vctune.document.text.errors import printable
from vctune.document.text.output_files import make_folder, write_together
from vctune.model.gains import AnyCoupling
from vctune.running import time_limit as limited

LOST = ("lost.json", "lost.svg")  # Names of the files of a check that lists and draws what a region has lost


def check(
    problem: ProblemSource,
    gains: DesignSource | None = None,
    coupling: AnyCoupling | None = None,
    *,
    time_limit: float = inf,
) -> Checked:
    """Prove the claims about a given design.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    gains : DesignSource, optional
        Gains, SI units, given together with `coupling`; or a gains file or its path; None if the problem fixes
        every variable.
    coupling : AnyCoupling, optional
        Coupling of the design, SI units; a `SpringDamper` for an impedance display.
    time_limit : float
        Seconds after which all unproved claims are undecided.

    Returns
    -------
    Checked
        `result` is the verdict, `message` is one line of text, and `warnings` are the probable mistakes.
        `finding.judgement` contains the verdicts on the claims, `finding.repairs` the repairs of a violated or idle
        design.

    Raises
    ------
    InputError
        If the problem or the design is invalid, if they are for different kinds of device, or if there is no design.
    """
    with limited(time_limit):
        file = problem_of(problem)
        design = None if gains is None else design_of(gains, coupling, file.problem.device.kind)
        return check_problem(file, design)


def check_region(problem: ProblemSource, baseline: str | Path) -> Checked:
    """Prove the cells and gain sets of a region file again for the present problem.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    baseline : str or Path
        Path of a region.json.

    Returns
    -------
    Checked
        `result`, `message` and `warnings`; `finding.again` contains the verdicts on cells and gain sets.

    Raises
    ------
    InputError
        If the problem or the baseline is invalid, or the problem no longer has such a region.
    """
    from vctune.study.region_check import check_region_file

    return check_region_file(problem_of(problem), Path(baseline))


def check_object(checked: Checked) -> dict[str, Any]:
    """Return a check as an object: the object of design.json, the verdict on a region, or the reason why neither
    exists."""
    if checked.finding is not None:
        return checked.finding.record()
    return RefusalRecord(
        problem=NamedRecord(name=printable(checked.name)),
        source=printable(str(checked.source)),
        line=checked.line,
        status=None,
        reason=checked.message,
        warnings=[],
    ).to_json()


def record_lost(checked: Checked, folder: Path) -> str:
    """Write the cells and gain sets that a region has lost, as a list and as a picture; if everything is proved again,
    remove those of an earlier check. Return what was done, empty for nothing and for the check of gains."""
    from vctune.study.region_check import RegionFinding

    finding = checked.finding
    if not isinstance(finding, RegionFinding) or finding.again.cut:
        return ""
    if not finding.again.lost:
        gone = [path for name in LOST if (path := folder / name).exists()]
        for path in gone:
            path.unlink()
        removed = ", ".join(path.name for path in gone)
        return f"everything is proved again: removed {removed} from {folder}" if gone else ""
    from vctune.report.region_figure import lost_figure
    from vctune.report.style import figure_file

    make_folder(folder)
    record = json.dumps(finding.record(), indent=2, allow_nan=False)
    write_together({folder / LOST[0]: record + "\n", **figure_file(lost_figure(finding.again), folder, "lost")})
    return f"the lost cells and gain sets are listed and drawn in {folder}: {', '.join(LOST)}"
