"""Provide `vctune check` as a function. This module imports the optimiser only if a check needs it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vctune.design.verdict.checked import Checked as Checked
from vctune.design.verdict.checked import CheckVerdict as CheckVerdict
from vctune.design.verdict.gains_check import check_files as check_files
from vctune.design.verdict.gains_check import check_problem
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design as design_of
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile, read_problem
from vctune.document.records.printed_json import NamedRecord, RefusalRecord
from vctune.document.ros import is_admittance as is_admittance
from vctune.document.ros import read_admittances
from vctune.document.text.errors import InputError, printable
from vctune.document.text.output_files import make_folder, write_together
from vctune.model.gains import AnyCoupling
from vctune.running import time_limit as limited

if TYPE_CHECKING:
    from vctune.design.search.optimum import Progress
    from vctune.model.problem import Problem
    from vctune.study.region_check import Recheck

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
    return recheck(problem_of(problem), Path(baseline))[0]


def recheck(file: ProblemFile, baseline: Path, progress: Progress = lambda stage: None) -> tuple[Checked, Recheck]:
    """Prove a region again, as `check_region` does. Return the check, and the verdicts on cells and gain sets."""
    from vctune.study.region_check import recheck_region

    return recheck_region(file, baseline, progress)


def refused_region(baseline: Path, error: InputError) -> Checked:
    """Return the check of a region that cannot be read or does not belong to the problem."""
    return Checked(baseline, baseline.stem, CheckVerdict.BAD_INPUT, str(error), error.mistakes[0].line or 1, None)


def check_parameter_files(
    problems: Sequence[Path],
    files: Sequence[Path],
    progress: Progress = lambda stage: None,
    begun: Callable[[Problem], None] = lambda problem: None,
) -> list[Checked]:
    """Check parameter files of ROS 2 against the problem of the device, or against several that share its axes."""
    from vctune.design.ros.admittance_check import check_parameters

    if not problems:
        message = "without a problem; name the problem of the device with files of ROS 2"
        raise InputError.of(str(files[0]), "ambiguous-files", message)
    read = [read_problem(path) for path in problems]
    for problem in read:
        begun(problem.problem)
    return [
        check
        for path in files
        for given in read_admittances(path)
        for check in check_parameters(read, path, given, progress)
    ]


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


def write_lost(checked: Checked, again: Recheck, folder: Path) -> None:
    """Write the cells and gain sets that a region has lost, as a list and as a picture."""
    from vctune.report.region_figure import lost_figure
    from vctune.report.style import figure_file

    make_folder(folder)
    record = json.dumps(checked.finding.record() if checked.finding else None, indent=2, allow_nan=False)
    write_together({folder / LOST[0]: record + "\n", **figure_file(lost_figure(again), folder, "lost")})


def remove_lost(folder: Path) -> list[str]:
    """Remove the lost.json and lost.svg of an earlier check, and return the names of the removed files."""
    gone = [path for name in LOST if (path := folder / name).exists()]
    for path in gone:
        path.unlink()
    return [path.name for path in gone]
