"""Write a design as parameters of a ROS 2 admittance_controller, proved with the arithmetic of that controller."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from shlex import quote

from vctune.design.ros.admittance import (
    RenderedAxis,
    as_problem,
    device_tables,
    document_of_both,
    parameters_of,
)
from vctune.document.reading import ProblemFile, problem_file
from vctune.document.ros import AXES, GRAVITY, AdmittanceFile, Load
from vctune.document.text.errors import InputError
from vctune.document.text.json import digest
from vctune.document.text.toml import toml_text
from vctune.firmware.firmware import Firmware, firmware
from vctune.firmware.preamble import statement
from vctune.model.gains import AnyCoupling, Gains, series_coupling
from vctune.version import __version__

CONTROLLER = "admittance_controller"  # Name of the controller in the file


def admittance_text(given: AdmittanceFile, comments: Sequence[str]) -> str:
    """Return the YAML text of a parameter file."""
    first, named = given.axes[0], {axis.axis: axis for axis in given.axes}
    axes = [named.get(name, first) for name in AXES]
    selected = ", ".join(str(name in named).lower() for name in AXES)
    lists = {name: [getattr(axis, name) for axis in axes] for name in ("mass", "damping_ratio", "stiffness")}
    lines = [f"# {line}".rstrip() for line in comments]
    lines += [f"{CONTROLLER}:", "  ros__parameters:", "    ft_sensor:"]
    lines += [f"      filter_coefficient: {_number(given.filter_coefficient)}", "    admittance:"]
    lines += [f"      # {', '.join(AXES)}", f"      selected_axes: [{selected}]"]
    lines += [f"      {name}: [{', '.join(map(_number, numbers))}]" for name, numbers in lists.items()]
    lines += [f"      joint_damping: {_number(first.joint_damping)}"]
    if given.load is not None:
        lines += ["    gravity_compensation: # [tool]; state its frame.id and CoG.pos", "      CoG:"]
        lines += [f"        force: {_number(given.load.weight)}"]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return a number in its shortest exact decimals, with a decimal point."""
    text = repr(float(value))
    mantissa, exponent, power = text.partition("e")
    return text if "." in mantissa else f"{mantissa}.0{exponent}{power}"


PARAMETERS = "admittance_controller.yaml"  # Name of the parameter file


@dataclass(frozen=True, slots=True)
class RosAxis:
    """A design for one axis of the controller."""

    axis: str  # name of the axis: x, y, z, rx, ry or rz
    file: ProblemFile  # the problem
    gains: Gains  # the design
    coupling: AnyCoupling


def ros2_firmware(axes: Sequence[RosAxis]) -> list[Firmware]:
    """Return designs as firmware, each with the proof of the law that the controller steps with its parameters."""
    for axis in axes:
        _require_servo(axis)
    parameters, proved_law = _parameters(axes), dict[str, Firmware]()
    designs = []
    for axis, rendered_axis in zip(axes, parameters.axes, strict=True):
        tables = {"name": axis.file.problem.name, **device_tables(axis.file.document)}
        text = toml_text(as_problem(document_of_both(tables, parameters, rendered_axis)))
        if text not in proved_law:
            law_file = problem_file(text, Path(axis.file.source))
            proved_law[text] = firmware(law_file, *law_file.problem.fixed_design, "double")
        sha256 = axis.file.sha256
        design = digest([sha256, asdict(axis.gains), asdict(axis.coupling)])
        decimals = replace(proved_law[text], gains=axis.gains, coupling=axis.coupling)
        designs.append(replace(decimals, problem_sha256=sha256, design_sha256=design))
    return designs


def ros2_files(name: str, axes: Sequence[RosAxis], controllers: Sequence[Firmware]) -> dict[str, str]:
    """Return the parameter file by its name, with the proved claims and their assumptions as comments, and the problem
    files with which it is checked."""
    axes_of_line: dict[str, list[str]] = {}
    for axis, controller in zip(axes, controllers, strict=True):
        statement_lines = [line for line in statement(controller) if line and not line.startswith("Controller of ")]
        axes_of_line.setdefault("\n".join([*statement_lines, _least_ratio(controller)]), []).append(axis.axis)
    comments = [f"Parameters of {name} for an admittance_controller of ROS 2, written by vctune {__version__}.", ""]
    comments += [
        line for text, names in axes_of_line.items() for line in (f"{', '.join(names)}:", *text.split("\n"), "")
    ]
    problems = dict[str, str]()
    for axis in axes:
        if axis.file.text not in problems.values():
            stem = re.sub(r"[^\w.-]+", "-", axis.file.problem.name)
            problems[f"{stem}-{axis.axis}.toml" if f"{stem}.toml" in problems else f"{stem}.toml"] = axis.file.text
    again = f"vctune check {' '.join(map(quote, problems))} {PARAMETERS}"
    text = admittance_text(_parameters(axes), [*comments, "This proves it again, in the folder of this file:", again])
    return {PARAMETERS: text, **problems}


def _least_ratio(controller: Firmware) -> str:
    """Return the sentence on the least Re Z_c / R in hands; "" without such a claim."""
    certificate = controller.record.certificate
    hands = None if certificate is None else certificate.hands
    return "" if hands is None else f"Least Re Z_c / R {hands.min_ratio:.6g}, as the controller steps it."


def _require_servo(axis: RosAxis) -> None:
    """Refuse an axis whose device is not a servo."""
    device = axis.file.problem.device
    if device.kind.own_loop:
        message = "is no servo, and an admittance_controller commands one; write [device.servo], or export to C"
        raise InputError.of(axis.file.source, "other-kind", message, key="device")


def _parameters(axes: Sequence[RosAxis]) -> AdmittanceFile:
    rendered = [RenderedAxis(axis.axis, axis.file.problem.device, series_coupling(axis.coupling)) for axis in axes]
    return replace(parameters_of(rendered, axes[0].file.source), load=_load(axes))


def _load(axes: Sequence[RosAxis]) -> Load | None:
    """Return the tool that hangs on every axis; None without one, or if it is not one known mass."""
    tools = {axis.file.problem.hands.tool for axis in axes}
    tool = tools.pop()
    turns = any(axis.file.problem.device.units == "rotary" for axis in axes)
    if tools or tool is None or turns or tool.low != tool.high or tool.low.damping > 0 or tool.low.mass == 0:
        return None
    return Load(float(f"{tool.low.mass * GRAVITY:.6g}"), (0.0, 0.0, 0.0), turned=True)
