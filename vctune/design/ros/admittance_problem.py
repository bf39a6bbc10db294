"""Join a problem file and a ROS 2 parameter file: the problem of a device whose coupling is the ROS 2 admittance."""

from __future__ import annotations

from math import log, pi
from typing import Any

from vctune.document.ros import Admittance, AdmittanceFile
from vctune.model.gains import Coupling

OF_FILE = ("admittance", "ft_sensor")  # Names of the tables of a parameter file
# Keys under which the joint problem states the controller's filter: for a servo, and for any other device
FILTER_OF_SAMPLES, FILTER_AS_CORNER = "force_sensor.filter_coefficient", "force_sensor.bandwidth_hz"


NOTHING = {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}}  # [environment] of an arm: nothing virtual behind it


def device_tables(document: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a problem that describe its device and hands, with the criterion "hands"."""
    tables = {key: value for key, value in document.items() if key not in ("experiment", "coupling")}
    return {**tables, "stability": {**tables.get("stability", {}), "criterion": "hands"}}


def arm_tables(document: dict[str, Any]) -> dict[str, Any]:
    """Return `device_tables` of an arm, which has nothing behind its admittance unless the document states it.

    With unmodelled dynamics every passive environment is behind it: a box of environments is not proved with them.
    """
    own = device_tables(document)
    return own if "unmodelled" in own.get("uncertainty", {}) else {"environment": NOTHING, **own}


def document_of_both(device: dict[str, Any], given: AdmittanceFile, axis: Admittance) -> dict[str, Any]:
    """Return the tables of a device together with the tables of a parameter file for one axis."""
    rendered = {
        "mass": axis.mass,
        "damping_ratio": axis.damping_ratio,
        "stiffness": axis.stiffness,
        "joint_damping": axis.joint_damping,
    }
    return device | {"admittance": rendered, "ft_sensor": {"filter_coefficient": given.filter_coefficient}}


def as_problem(document: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a problem whose coupling is the admittance of a joint document, as the controller computes
    it."""
    device, coefficient = document["device"], document["ft_sensor"]["filter_coefficient"]
    axis, T = Admittance(axis="", line=0, **document["admittance"]), float(device["sample_time"])
    coupling = coupling_of_admittance(axis, T, servo="servo" in device)
    if "servo" in device:
        device = _as_servo(device, axis, coefficient)
    elif coefficient < 1:
        device = _with_filter(device, FILTER_AS_CORNER, corner_hz(coefficient, T))
    numbers = {"damping": coupling.damping, "mass": coupling.mass, "drag": coupling.drag}
    tables = {key: table for key, table in document.items() if key not in OF_FILE}
    if "servo" not in device and tables.get("environment") == NOTHING:  # the controller's spring is the environment
        spring = {"min": axis.stiffness, "max": axis.stiffness}
        tables["environment"] = {**NOTHING, "stiffness": spring}
    return {**tables, "device": device, "coupling": numbers}


def _as_servo(device: dict[str, Any], axis: Admittance, coefficient: float) -> dict[str, Any]:
    """Return the device's table with the spring and the filter of the controller added to the servo."""
    servo = {key: value for key, value in device["servo"].items() if key != "command"}
    if axis.stiffness > 0:
        servo["stiffness"] = axis.stiffness
    return _with_filter({**device, "servo": servo}, FILTER_OF_SAMPLES, coefficient)


def _with_filter(device: dict[str, Any], key: str, number: float) -> dict[str, Any]:
    part, name = key.split(".")
    return {**device, part: {**device.get(part, {}), name: number}}


def corner_hz(coefficient: float, sample_time: float) -> float:
    """Return the corner frequency of the filter y += coefficient (x - y), Hz."""
    return -log(1 - coefficient) / (2 * pi * sample_time)


def coupling_of_admittance(axis: Admittance, sample_time: float, *, servo: bool = False) -> Coupling:
    """Return the coupling that equals an admittance without its spring, as the controller computes it."""
    mass = axis.mass - axis.damping * sample_time
    taken = 0.0 if servo else axis.stiffness * sample_time / 2
    return Coupling(2 * mass / sample_time, mass, axis.damping - taken)
