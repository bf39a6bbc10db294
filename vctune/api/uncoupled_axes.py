"""Solve, check and export problems with several uncoupled axes.

Each axis is a problem. vctune solves equal problems only once.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from vctune.api.argument_ranges import Format
from vctune.api.design_files import write_record
from vctune.api.exporting import (
    Exported,
    export,
    export_parameters,
    require_double,
    stated_design,
    write_export,
)
from vctune.api.folders import GAINS_FILE, claim_folder
from vctune.api.solving import solve
from vctune.design.result import Solved
from vctune.design.ros.admittance_check import axes_asked_for, check_admittance
from vctune.design.search.optimum import Progress
from vctune.design.verdict.checked import Checked, CheckVerdict, DesignFinding
from vctune.design.verdict.design_record import record_of
from vctune.design.verdict.gains_check import check_problem
from vctune.document.problem_axes import AxesFile, AxisProblem
from vctune.document.reading import GainsFile, ProblemFile, read_gains
from vctune.document.records.design_json import DesignRecord
from vctune.document.ros import read_admittance
from vctune.document.text.date import today
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import folder_name, write_together
from vctune.firmware.ros2 import RosAxis
from vctune.report.page.axes_page import HEADINGS as HEADINGS
from vctune.report.page.axes_page import axes_page
from vctune.report.page.axes_page import axis_row as axis_row
from vctune.report.page.axes_page import promises as promises
from vctune.simulation.firmware.stepped import Precision

INDEX = "index.html"
Found = TypeVar("Found")


@dataclass(frozen=True, slots=True)
class AxisDesign:
    """The design of one axis.

    Attributes
    ----------
    axis : the axis, with its problem
    record : record of its design, or of the reason why it has no design
    """

    axis: AxisProblem
    record: DesignRecord


def of_each(
    axes: AxesFile,
    work: Callable[[AxisProblem], Found],
    given: Callable[[AxisProblem], Hashable] = lambda axis: None,
) -> list[tuple[AxisProblem, Found]]:
    """Apply a function to each axis. Axes that state the same problem share one call.

    Parameters
    ----------
    axes : problem file with several axes
    work : function of an axis; called once for each distinct problem
    given : function that returns the other inputs of the work on an axis. Axes share a call only if these inputs are
        also equal

    Returns
    -------
    list
        Pairs of an axis and its result, in the order of the file.
    """
    done: dict[Hashable, Found] = {}
    found = []
    for axis in axes.axes:
        key = (axis.file.sha256, given(axis))
        if key not in done:
            done[key] = work(axis)
        found.append((axis, done[key]))
    return found


def solve_axes(
    axes: AxesFile, *, gap: float | None = None, prices: bool = False, progress: Progress = lambda stage: None
) -> list[AxisDesign]:
    """Solve the problem of each axis. vctune solves the problem of equal axes only once.

    Parameters
    ----------
    axes : problem file with several axes
    gap, prices : see `vctune.solve`
    progress : function that receives the name of the axis and the stage of the work

    Returns
    -------
    list of AxisDesign
        One design for each axis, in the order of the file.
    """
    from vctune.design.nlp.ipopt_version import ipopt_version

    def work(axis: AxisProblem) -> Solved:
        return solve(axis.file, gap=gap, prices=prices, progress=lambda stage: progress(f"{axis.name}: {stage}"))

    return [
        AxisDesign(axis, record_of(axis.file, replace(solved, problem=axis.file.problem), ipopt_version(), today()))
        for axis, solved in of_each(axes, work)
    ]


def axis_folder(axes: AxesFile, axis: AxisProblem, out: Path) -> Path:
    """Return the folder of an axis: OUT/PROBLEM/AXIS.

    Parameters
    ----------
    axes, axis : the problem file, and one of its axes
    out : parent folder of the problem's folder
    """
    return out / folder_name(axes.name) / folder_name(axis.name)


def claim_axes(axes: AxesFile, out: Path) -> None:
    """Create the folder of each axis, and check that the design of its problem may be written there.

    Parameters
    ----------
    axes : problem file with several axes
    out : parent folder of the problem's folder

    Raises
    ------
    InputError
        If a folder cannot be written, or holds the design of another problem.
    """
    for axis in axes.axes:
        claim_folder(axis.file, axis_folder(axes, axis, out))


def write_axes(axes: AxesFile, designs: list[AxisDesign], out: Path, *, reported: bool) -> dict[Path, Path]:
    """Write the design of each axis into the axis's folder.

    Write a page with one line for each axis into the problem's folder.

    Parameters
    ----------
    axes : problem file with several axes
    designs : designs of its axes
    out : parent folder of the problem's folder
    reported : whether each folder has a report or will get one

    Returns
    -------
    dict
        The files of earlier designs that were renamed, with their new names.
    """
    renamed: dict[Path, Path] = {}
    for design in designs:
        renamed |= write_record(axis_folder(axes, design.axis, out), design.axis.file, design.record)
    found = {design.axis.name: design.record for design in designs}
    write_together({out / folder_name(axes.name) / INDEX: axes_page(axes.name, found, reported=reported)})
    return renamed


def gains_of_axes(axes: AxesFile, folder: Path) -> dict[str, GainsFile]:
    """Return the gains of each axis, read from the folder that `vctune solve` writes for a file with axes.

    Parameters
    ----------
    axes : problem file with several axes
    folder : the problem's folder, which contains one folder for each axis

    Raises
    ------
    InputError
        If the folder of an axis has no gains.
    """
    return {axis.name: read_gains(folder / folder_name(axis.name) / GAINS_FILE) for axis in axes.axes}


def check_axes(
    axes: AxesFile,
    gains: Mapping[str, GainsFile] | None = None,
    progress: Progress = lambda stage: None,
) -> list[Checked]:
    """Check the gains that the file fixes for each axis, or given gains.

    Parameters
    ----------
    axes : problem file with several axes
    gains : gains by the name of the axis; None for the gains that the file fixes
    progress : function that receives the name of the axis

    Returns
    -------
    list of Checked
        One check for each axis, in the order of the file. vctune proves equal axes only once.
    """

    def work(axis: AxisProblem) -> Checked:
        progress(f"proving {axis.name}")
        return _checked(axis, _gains_of(gains, axis))

    def told(axis: AxisProblem) -> Hashable:
        file = _gains_of(gains, axis)
        return None if file is None else (file.kind.name, file.gains, file.coupling, file.sha256)

    return [_of_axis(found, axis, _gains_of(gains, axis)) for axis, found in of_each(axes, work, told)]


def check_parameters(
    axes: AxesFile,
    path: Path,
    only: Sequence[str] = (),
    progress: Progress = lambda stage: None,
) -> list[Checked]:
    """Check the selected axes of a ROS 2 parameter file. Each belongs to the axis of the same name in the problem file.

    Parameters
    ----------
    axes : problem file with several axes
    path : path of the parameter file
    only : names of the axes to check; empty for all axes that the parameter file selects
    progress : function that receives the current stage

    Returns
    -------
    list of Checked
        One check for each examined axis.

    Raises
    ------
    InputError
        If the parameter file selects an axis that the problem lacks, or an axis of the other kind of motion (a rotation
        for a translation, or the reverse); or if `only` names an axis that the file does not select.
    """
    given, known = read_admittance(path), {axis.name for axis in axes.axes}
    asked = [axis.axis for axis in axes_asked_for(path, given, only)]
    if missing := [name for name in asked if name not in known]:
        message = (
            f"selects {', '.join(missing)}, and {axes.axes[0].file.source} has no [[axis]] of that name; write one"
        )
        raise InputError.of(str(path), "contradiction", message, key="admittance.selected_axes", line=given.line)
    groups: dict[str, list[AxisProblem]] = {}
    for axis in axes.axes:
        if axis.name in asked:
            groups.setdefault(axis.file.sha256, []).append(axis)
    found: dict[str, Checked] = {}
    for group in groups.values():
        names = [axis.name for axis in group]
        checks = check_admittance(_named(group[0].file, axes.name), path, given, names, progress)
        found |= dict(zip([name for name in asked if name in names], checks, strict=True))  # in the file's order
    return [found[name] for name in asked]


def _gains_of(gains: Mapping[str, GainsFile] | None, axis: AxisProblem) -> GainsFile | None:
    return None if gains is None else gains[axis.name]


def _checked(axis: AxisProblem, given: GainsFile | None) -> Checked:
    try:
        return check_problem(axis.file, given)
    except InputError as error:
        said = "; ".join(f"{mistake.key}: {mistake.message} [{mistake.code}]" for mistake in error.mistakes)
        return Checked(Path(), "", CheckVerdict.BAD_INPUT, said, 1, None)


def _of_axis(checked: Checked, axis: AxisProblem, given: GainsFile | None) -> Checked:
    """Return a check of one axis as the check of another axis that has the same problem."""
    source = Path(axis.file.source if given is None else given.source)
    line = axis.line if given is None else checked.line
    message, finding = f"{axis.name}: {checked.message}", checked.finding
    if isinstance(finding, DesignFinding):
        finding = replace(finding, file=_named(finding.file, axis.file.problem.name))
    else:
        message = f"{source}:{line}: {message}"
    return replace(checked, source=source, name=axis.file.problem.name, message=message, line=line, finding=finding)


def _named(file: ProblemFile, name: str) -> ProblemFile:
    return replace(file, problem=replace(file.problem, name=name))


def export_axes(
    axes: AxesFile,
    gains: Mapping[str, GainsFile] | None,
    out: Path,
    *,
    to: Format = "c",
    precision: Precision = "double",
    unproved: bool = False,
    progress: Progress = lambda stage: None,
) -> list[tuple[Exported, Path]]:
    """Export each axis into its own folder, or all axes as the parameters of one ROS 2 controller.

    The parameter file of a controller goes into the problem's folder.

    Parameters
    ----------
    axes : problem file with several axes
    gains : gains by the name of the axis; None for the gains that the file fixes
    out : parent folder of the problem's folder
    to, precision, unproved, progress : see `vctune.export`

    Returns
    -------
    list
        Pairs of an export and the folder of its files.

    Raises
    ------
    NotCertifiedError
        If a design is not certified and `unproved` is not set. This is also an `InputError`.
    InputError
        If an axis has no design, or cannot be exported.
    """
    if to == "ros2":
        require_double(precision)
        designs = [
            RosAxis(axis.name, axis.file, *stated_design(axis.file, _gains_of(gains, axis), None)[1])
            for axis in axes.axes
        ]
        named = _named(axes.axes[0].file, axes.name)
        made = export_parameters(named, designs, unproved=unproved, progress=progress)
        return [(made, write_export(made, out / folder_name(axes.name)))]

    def stage_of(axis: AxisProblem) -> Progress:
        return lambda stage: progress(f"{axis.name}: {stage}")

    exported = [
        export(
            axis.file,
            _gains_of(gains, axis),
            to=to,
            precision=precision,
            unproved=unproved,
            progress=stage_of(axis),
        )
        for axis in axes.axes
    ]
    pairs = zip(axes.axes, exported, strict=True)
    return [(one, write_export(one, axis_folder(axes, axis, out))) for axis, one in pairs]
