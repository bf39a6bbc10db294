"""A design as parameters of a ROS 2 admittance_controller: proved as that controller steps them."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

from vctune.design.ros.admittance_design import RenderedAxis, axes_of, parameters_of
from vctune.design.ros.admittance_problem import as_problem, device_tables, document_of_both
from vctune.document.reading import ProblemFile, problem_file
from vctune.document.ros import AdmittanceFile
from vctune.document.ros_writing import admittance_text
from vctune.document.text.digest import digest
from vctune.document.text.errors import InputError
from vctune.document.text.toml_writing import toml_text
from vctune.firmware.c_source import statement
from vctune.firmware.firmware import Firmware, firmware
from vctune.model.gains import AnyCoupling, Gains, series_coupling

PARAMETERS = "admittance_controller.yaml"


def ros2_firmware(file: ProblemFile, gains: Gains, coupling: AnyCoupling) -> Firmware:
    """Return a design as the controller steps it, proved.

    Parameters
    ----------
    file : the problem
    gains, coupling : the design

    Raises
    ------
    InputError
        If the device is no servo: what follows the command is then a loop that vctune designs.
    """
    if file.problem.device.kind.own_loop:
        message = "is no servo, and an admittance_controller commands one; write [device.servo], or export to C"
        raise InputError.of(file.source, "other-kind", message, key="device")
    given = _parameters(file, coupling)
    tables = {"name": file.problem.name, **device_tables(file.document)}
    law = problem_file(toml_text(as_problem(document_of_both(tables, given, given.axes[0]))), Path(file.source))
    made = firmware(law, *law.problem.fixed_design, "double")
    return replace(
        made,
        gains=gains,
        coupling=coupling,
        problem_sha256=file.sha256,
        design_sha256=digest([file.sha256, asdict(gains), asdict(coupling)]),
    )


def ros2_files(file: ProblemFile, made: Firmware) -> dict[str, str]:
    """Return the parameter file, with what is proved of it in its comments.

    Parameters
    ----------
    file : the problem
    made : as of `ros2_firmware`
    """
    given, certificate = _parameters(file, made.coupling), made.record.certificate
    axes = ", ".join(axis.axis for axis in given.axes)
    hands = None if certificate is None else certificate.hands
    least = [] if hands is None else [f"{axes}: least Re Z_c / R {hands.min_ratio:.6g}, as the controller steps it."]
    again = f"vctune check {Path(file.source).name} {PARAMETERS} proves it again."
    return {PARAMETERS: admittance_text(given, [*statement(made), *least, again])}


def _parameters(file: ProblemFile, coupling: AnyCoupling) -> AdmittanceFile:
    """Return the parameters of every axis that moves as the device does."""
    series, device = series_coupling(coupling), file.problem.device
    return parameters_of([RenderedAxis(axis, device, series) for axis in axes_of(file.problem)], file.source)
