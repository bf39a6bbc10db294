"""Join a problem file and a ROS 2 parameter file into one problem, whose coupling is the ROS 2 admittance, and write a
design for a servo as parameters of a ROS 2 admittance_controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log, log10, pi, sqrt
from typing import Any

from vctune.document.reading import ProblemFile
from vctune.document.ros import AXES, Admittance, AdmittanceFile
from vctune.document.text.errors import InputError
from vctune.model.device import Device
from vctune.model.gains import Coupling
from vctune.model.problem import Problem

WEIGHED = 4  # Number of digits of a tool's mass, which is no better known than gravity
OF_FILE = ("admittance", "ft_sensor", "gravity_compensation")  # Names of the tables of a parameter file
FILTER = "force_sensor.filter_coefficient"  # Key under which the joint problem states the controller's filter


NOTHING_BEHIND = {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}}  # [environment] of an arm: nothing virtual behind it


def device_tables(document: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a problem that describe its device and hands, with the criterion "hands"."""
    tables = {key: value for key, value in document.items() if key not in ("experiment", "coupling")}
    return {**tables, "stability": {**tables.get("stability", {}), "criterion": "hands"}}


def arm_tables(document: dict[str, Any]) -> dict[str, Any]:
    """Return `device_tables` of an arm, which has nothing behind its admittance unless the document states it."""
    return {"environment": NOTHING_BEHIND, **device_tables(document)}


def document_of_both(device: dict[str, Any], given: AdmittanceFile, axis: Admittance) -> dict[str, Any]:
    """Return the tables of a device together with the tables of a parameter file for one axis."""
    rendered = {
        "mass": axis.mass,
        "damping_ratio": axis.damping_ratio,
        "stiffness": axis.stiffness,
        "joint_damping": axis.joint_damping,
    }
    both = device | {"admittance": rendered, "ft_sensor": {"filter_coefficient": given.filter_coefficient}}
    if given.load is None:
        return both
    # the moments of inertia stay in the proportion of the weight when a repair changes it
    low, high = (inertia / given.load.weight for inertia in given.load.inertia(axis.axis))
    return both | {"gravity_compensation": {"CoG": {"force": given.load.weight, "inertia": [low, high]}}}


def as_problem(document: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a problem whose coupling is the admittance of a joint document, as the controller computes
    it."""
    device, coefficient = document["device"], document["ft_sensor"]["filter_coefficient"]
    axis, T = Admittance(axis="", line=0, **document["admittance"]), float(device["sample_time"])
    if "servo" in device:
        device, numbers = _as_servo(device, axis), {"rule": "euler", "mass": axis.mass, "drag": axis.damping}
    else:
        coupling = coupling_of_admittance(axis, T)
        numbers = {"damping": coupling.damping, "mass": coupling.mass, "drag": coupling.drag}
    part, name = FILTER.split(".")
    sensor = {key: value for key, value in device.get(part, {}).items() if key != name}
    sensor |= {name: coefficient} if coefficient < 1 else {}
    device = {**device, part: sensor} if sensor else {key: value for key, value in device.items() if key != part}
    tables = {key: table for key, table in document.items() if key not in OF_FILE}
    if "gravity_compensation" in document:
        load = document["gravity_compensation"]["CoG"]
        low, high = (float(f"{load['force'] * share:.{WEIGHED}g}") for share in load["inertia"])
        tables["tool"] = {"mass": low if low == high else {"min": low, "max": high}}
    if "servo" not in device and "environment" in tables and axis.stiffness > 0:
        tables["environment"] = _beside(tables["environment"], axis.stiffness)
    return {**tables, "device": device, "coupling": numbers}


def _beside(environment: dict[str, Any], spring: float) -> dict[str, Any]:
    """Return a box of environments beside the controller's spring, which a loop of its own leaves to them."""
    stated = environment.get("stiffness", {})
    ends = dict(stated) if isinstance(stated, dict) else {"min": stated, "max": stated}
    ends = {"min": 0.0, **ends}
    return {**environment, "stiffness": {end: value + spring for end, value in ends.items()}}


def followed(problem: Problem) -> Problem:
    """Return a problem whose velocity loop follows the controller's own position, x + T v at each sample."""
    return replace(problem, device=replace(problem.device, summed=problem.device.kind.own_loop))


def _as_servo(device: dict[str, Any], axis: Admittance) -> dict[str, Any]:
    """Return the device's table with the spring of the controller added to the servo."""
    servo = {key: value for key, value in device["servo"].items() if key not in ("command", "stiffness")}
    if axis.stiffness > 0:
        servo["stiffness"] = axis.stiffness
    return {**device, "servo": servo}


def corner_hz(coefficient: float, sample_time: float) -> float:
    """Return the corner frequency of the filter y += coefficient (x - y), Hz."""
    return -log(1 - coefficient) / (2 * pi * sample_time)


def coupling_of_admittance(axis: Admittance, sample_time: float, *, servo: bool = False) -> Coupling:
    """Return the coupling that equals an admittance without its spring, as the controller computes it."""
    mass = axis.mass - axis.damping * sample_time
    taken = 0.0 if servo else axis.stiffness * sample_time / 2
    return Coupling(2 * mass / sample_time, mass, axis.damping - taken)


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
        taken = 0.0 if self.device.rule == "euler" else self.coupling.drag * self.device.sample_time
        return float(self.coupling.mass + taken)


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
        (f"device.{FILTER}", {design.filter_coefficient for design in designs}),
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
