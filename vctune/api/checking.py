"""`vctune check`, as a function."""

from __future__ import annotations

import json
from math import inf
from pathlib import Path

from vctune.design.verdict.gains_check import Checked, check_problem
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design as design_of
from vctune.document.building import problem as problem_of
from vctune.document.text.output_files import make_folder, write_together
from vctune.model.gains import Coupling
from vctune.running import time_limit as limited
from vctune.study.region_check import Recheck
from vctune.study.region_check import check_region as prove_again

LOST = ("lost.json", "lost.svg")


def check(
    problem: ProblemSource,
    gains: DesignSource | None = None,
    coupling: Coupling | None = None,
    *,
    time_limit: float = inf,
) -> Checked:
    """Prove a design that already exists.

    Parameters
    ----------
    problem : path of a problem file, its tables as a dict, or the problem
    gains : N s/m and N/m, with their coupling; or a gains file or its path; None if the problem fixes every number
    coupling : N s/m and kg
    time_limit : s, after which claims that are not proved yet are undecided

    Returns
    -------
    Checked
        `result`, `message` in one line, `warnings`; `finding.judgement` is what is proved, `finding.repairs` what
        would mend a violated design.

    Raises
    ------
    InputError
        If problem or design are invalid or for different kinds of device, or there is no design.
    """
    with limited(time_limit):
        file = problem_of(problem)
        given = None if gains is None else design_of(gains, coupling, file.problem.device.kind)
        return check_problem(file, given)


def check_region(problem: ProblemSource, baseline: str | Path) -> Checked:
    """Prove again, with a problem as it is today, the cells and gain sets that a region file had proved.

    Parameters
    ----------
    problem : path of a problem file, its tables as a dict, or the problem
    baseline : path of a region.json

    Returns
    -------
    Checked
        `result`, `message`, `warnings`; `finding.again` is what was proved again.

    Raises
    ------
    InputError
        If problem or baseline are none, or the problem no longer has such a region.
    """
    return prove_again(problem_of(problem), Path(baseline))[0]


def write_lost(checked: Checked, again: Recheck, folder: Path) -> None:
    """Write what a region has lost, as a list and as a picture.

    Parameters
    ----------
    checked : whose finding becomes lost.json
    again : the cells and gain sets, drawn in lost.svg
    folder : made if it is not there

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    from vctune.report.figures.region_figure import lost_figure
    from vctune.report.page.page import figure_file

    make_folder(folder)
    record = json.dumps(checked.finding.record() if checked.finding else None, indent=2, allow_nan=False)
    write_together({folder / LOST[0]: record + "\n", **figure_file(lost_figure(again), folder, "lost")})


def remove_lost(folder: Path) -> list[str]:
    """Remove what an earlier check had lost and this one has not; return the names of the files."""
    gone = [path for name in LOST if (path := folder / name).exists()]
    for path in gone:
        path.unlink()
    return [path.name for path in gone]
