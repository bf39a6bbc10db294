"""Write a design for a servo as parameters of a ROS 2 admittance_controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10, sqrt

from vctune.design.ros.admittance_problem import FILTER_OF_SAMPLES
from vctune.document.reading import ProblemFile
from vctune.document.ros import AXES, Admittance, AdmittanceFile
from vctune.document.text.errors import InputError
from vctune.model.device import Device
from vctune.model.gains import Coupling
from vctune.model.problem import Problem

DIGITS = 7  # Number of significant digits to which the code rounds a damping up
# Time constant, s, of a weak spring that the file states only because the damping ratio refers to a stiffness
RETURN = 1e4


@dataclass(frozen=True, slots=True)
class RenderedAxis:
    """The design of one axis."""

    axis: str  # name of the axis, one of `AXES`
    device: Device  # device of the axis, a servo
    coupling: Coupling  # coupling of the design; the controller cannot render its damper b_c

    @property
    def stiffness(self) -> float:
        """The stiffness S, N/m."""
        servo = self.device.servo
        return 0.0 if servo is None or servo.stiffness is None else float(servo.stiffness)

    @property
    def filter_coefficient(self) -> float:
        """Weight of each new sample in the filter of the force; 1 without a filter."""
        coefficient = self.device.sensing.filter_coefficient
        return 1.0 if coefficient is None else float(coefficient)

    @property
    def mass(self) -> float:
        """The mass M, kg."""
        return float(self.coupling.mass + self.coupling.drag * self.device.sample_time)


def axes_of(problem: Problem) -> tuple[str, ...]:
    """Return the names of the axes that have the device's kind of motion."""
    turns = problem.device.units == "rotary"
    return tuple(axis for axis in AXES if axis.startswith("r") == turns)


def problems_of_axes(files: Sequence[ProblemFile]) -> dict[str, ProblemFile]:
    """Return the problem for each axis: of several problems the one with its name, else the one with its motion."""
    alone = {file.problem.name: file for file in files if len(files) > 1 and file.problem.name in axes_of(file.problem)}
    owners = dict[str, ProblemFile]()
    for axis in AXES:
        fitting = [file for file in files if axis in axes_of(file.problem) and file not in alone.values()]
        if axis not in alone and len(fitting) > 1:
            message = f"is, as {fitting[0].source}, for the axis {axis}; give one of them the name of its axis"
            raise InputError.of(fitting[1].source, "contradiction", message, key="name")
        if axis in alone or fitting:
            owners[axis] = alone[axis] if axis in alone else fitting[0]
    return owners


def parameters_of(designs: Sequence[RenderedAxis], source: str) -> AdmittanceFile:
    """Return the parameters that render designs, one design for each selected axis."""
    for key, values in (
        ("device.sample_time", {design.device.sample_time for design in designs}),
        (f"device.{FILTER_OF_SAMPLES}", {design.filter_coefficient for design in designs}),
    ):
        if len(values) > 1:
            message = f"differs between axes: {', '.join(f'{value:g}' for value in sorted(values))}; write one for all"
            raise InputError.of(source, "contradiction", message, key=key)
    without_spring = any(design.stiffness == 0 for design in designs)
    rates = [design.coupling.drag / design.mass for design in designs]
    joint_damping = rounded_up(min(rates)) if without_spring else 0.0
    axes = tuple(_axis(design, joint_damping) for design in designs)
    return AdmittanceFile(axes, designs[0].filter_coefficient, 1, {})


def _axis(design: RenderedAxis, joint_damping: float) -> Admittance:
    mass, drag, stiffness = design.mass, float(design.coupling.drag), design.stiffness
    left = drag - joint_damping * mass
    if left <= 0:
        return Admittance(design.axis, mass, 0.0, stiffness, joint_damping, 1)
    stiffness = stiffness or float(f"{drag / RETURN:.1e}")
    ratio = rounded_up(left / (2 * sqrt(mass * stiffness)))
    return Admittance(design.axis, mass, ratio, stiffness, joint_damping, 1)


def rounded_up(number: float) -> float:
    """Return a number >= 0 rounded up to `DIGITS` significant digits."""
    if number == 0:
        return 0.0
    place = DIGITS - 1 - floor(log10(number))
    return float(f"{ceil(number * 10.0**place)}e{-place}")
