"""Solve, check and export problems with several uncoupled axes."""

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

INDEX = "index.html"  # Page in the problem's folder with one line for each axis
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class AxisDesign:
    """The design of one axis."""

    axis: AxisProblem  # the axis, with its problem
    record: DesignRecord  # record of its design, or of the reason why it has no design


def once_per_problem(
    axes: AxesFile,
    function: Callable[[AxisProblem], Result],
    other_inputs: Callable[[AxisProblem], Hashable] = lambda axis: None,
) -> list[tuple[AxisProblem, Result]]:
    """Apply a function to each axis. Axes that state the same problem and have the same other inputs share one call."""
    results: dict[Hashable, Result] = {}
    pairs = []
    for axis in axes.axes:
        key = (axis.file.sha256, other_inputs(axis))
        if key not in results:
            results[key] = function(axis)
        pairs.append((axis, results[key]))
    return pairs


def solve_axes(
    axes: AxesFile,
    *,
    gap: float | None = None,
    prices: bool = False,
    progress: Progress = lambda stage: None,
) -> list[AxisDesign]:
    """Solve the problem of each axis. vctune solves the problem of equal axes only once."""
    from vctune.design.nlp.ipopt_version import ipopt_version

    def solved_axis(axis: AxisProblem) -> Solved:
        return solve(
            axis.file,
            gap=gap,
            prices=prices,
            progress=lambda stage: progress(f"{axis.name}: {stage}"),
        )

    # equal axes share one result, but the record of each axis needs the problem with the name of this axis
    return [
        AxisDesign(axis, record_of(axis.file, replace(solved, problem=axis.file.problem), ipopt_version(), today()))
        for axis, solved in once_per_problem(axes, solved_axis)
    ]


def axis_folder(axes: AxesFile, axis: AxisProblem, out: Path) -> Path:
    """Return the folder of an axis: OUT/PROBLEM/AXIS."""
    return out / folder_name(axes.name) / folder_name(axis.name)


def claim_axes(axes: AxesFile, out: Path) -> None:
    """Create the folder of each axis, and check that the design of its problem may be written there."""
    for axis in axes.axes:
        claim_folder(axis.file, axis_folder(axes, axis, out))


def write_axes(axes: AxesFile, designs: list[AxisDesign], out: Path, *, reported: bool) -> dict[Path, Path]:
    """Write the design of each axis into the axis's folder."""
    renamed: dict[Path, Path] = {}
    for design in designs:
        renamed |= write_record(axis_folder(axes, design.axis, out), design.axis.file, design.record)
    records = {design.axis.name: design.record for design in designs}
    write_together({out / folder_name(axes.name) / INDEX: axes_page(axes.name, records, reported=reported)})
    return renamed


def gains_of_axes(axes: AxesFile, folder: Path) -> dict[str, GainsFile]:
    """Return the gains of each axis, read from the folder that `vctune solve` writes for a file with axes."""
    return {axis.name: read_gains(folder / folder_name(axis.name) / GAINS_FILE) for axis in axes.axes}


def check_axes(
    axes: AxesFile,
    gains: Mapping[str, GainsFile] | None = None,
    progress: Progress = lambda stage: None,
) -> list[Checked]:
    """Check the gains that the file fixes for each axis, or given gains."""

    def checked_axis(axis: AxisProblem) -> Checked:
        progress(f"proving {axis.name}")
        return _checked(axis, _gains_of(gains, axis))

    def inputs_of_gains(axis: AxisProblem) -> Hashable:
        file = _gains_of(gains, axis)
        return None if file is None else (file.kind.name, file.gains, file.coupling, file.sha256)

    return [
        _of_axis(checked, axis, _gains_of(gains, axis))
        for axis, checked in once_per_problem(axes, checked_axis, inputs_of_gains)
    ]


def check_parameters(
    axes: AxesFile,
    path: Path,
    only: Sequence[str] = (),
    progress: Progress = lambda stage: None,
) -> list[Checked]:
    """Check the selected axes of a ROS 2 parameter file. Each selected axis belongs to the axis of the same name in the
    problem file."""
    parameters, axis_names = read_admittance(path), {axis.name for axis in axes.axes}
    selected = [axis.axis for axis in axes_asked_for(path, parameters, only)]
    if missing := [name for name in selected if name not in axis_names]:
        message = (
            f"selects {', '.join(missing)}, and {axes.axes[0].file.source} has no [[axis]] of that name; write one"
        )
        raise InputError.of(str(path), "contradiction", message, key="admittance.selected_axes", line=parameters.line)
    axes_of_problem: dict[str, list[AxisProblem]] = {}
    for axis in axes.axes:
        if axis.name in selected:
            axes_of_problem.setdefault(axis.file.sha256, []).append(axis)
    checks: dict[str, Checked] = {}
    for equal_axes in axes_of_problem.values():
        names = [axis.name for axis in equal_axes]
        checked = check_admittance(_renamed(equal_axes[0].file, axes.name), path, parameters, names, progress)
        # check_admittance returns the checks in the order of the parameter file
        checks |= dict(zip([name for name in selected if name in names], checked, strict=True))
    return [checks[name] for name in selected]


def _gains_of(gains: Mapping[str, GainsFile] | None, axis: AxisProblem) -> GainsFile | None:
    """Return the given gains of an axis; None for the gains that the problem file fixes."""
    return None if gains is None else gains[axis.name]


def _checked(axis: AxisProblem, gains: GainsFile | None) -> Checked:
    """Return the check of an axis. If the input of the axis has an error, the check reports it, so the other axes are
    still checked."""
    try:
        return check_problem(axis.file, gains)
    except InputError as error:
        message = "; ".join(f"{mistake.key}: {mistake.message} [{mistake.code}]" for mistake in error.mistakes)
        return Checked(source=Path(), name="", verdict=CheckVerdict.BAD_INPUT, message=message, line=1, finding=None)


def _of_axis(checked: Checked, axis: AxisProblem, gains: GainsFile | None) -> Checked:
    """Return a check with the source, the name and the line of an axis, because equal axes share one check."""
    source = Path(axis.file.source if gains is None else gains.source)
    line = axis.line if gains is None else checked.line
    message, finding = f"{axis.name}: {checked.message}", checked.finding
    if isinstance(finding, DesignFinding):
        finding = replace(finding, file=_renamed(finding.file, axis.file.problem.name))
    else:
        message = f"{source}:{line}: {message}"
    return replace(checked, source=source, name=axis.file.problem.name, message=message, line=line, finding=finding)


def _renamed(file: ProblemFile, name: str) -> ProblemFile:
    """Return a problem file whose problem has another name."""
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
    """Export each axis and write the files, or export all axes as the parameters of one ROS 2 controller."""
    if to == "ros2":
        require_double(precision)
        designs = [
            RosAxis(axis.name, axis.file, *stated_design(axis.file, _gains_of(gains, axis), None)[1])
            for axis in axes.axes
        ]
        renamed_file = _renamed(axes.axes[0].file, axes.name)
        exported = export_parameters(renamed_file, designs, unproved=unproved, progress=progress)
        return [(exported, write_export(exported, out / folder_name(axes.name)))]

    def stage_of(axis: AxisProblem) -> Progress:
        return lambda stage: progress(f"{axis.name}: {stage}")

    # each axis has its own files, so equal axes are exported as often as they occur
    exports = [
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
    pairs = zip(axes.axes, exports, strict=True)
    return [(exported, write_export(exported, axis_folder(axes, axis, out))) for axis, exported in pairs]
