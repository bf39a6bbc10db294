"""Write a problem as a document that states every default: the inverse of `vctune.document.schema.defaults`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, is_dataclass
from math import inf, pi
from typing import Any

from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.experiment import Environment, Experiment
from vctune.model.numbers.units import hertz
from vctune.model.parts import PARTS, Servo, VelocityEstimate
from vctune.model.problem import Band, Bounds, Problem, Range
from vctune.model.worlds import Worlds

# Keys in the table of a servo
SERVO_KEYS = ("units", "sample_time", *(key for key, part in PARTS.items() if "servo" not in part.refused_by))


def statement(problem: Problem) -> dict[str, Any]:
    """Return the document of a problem, as a problem file would state it."""
    device = table_of(problem.device)
    operator = device.pop("operator", None)
    transparency, stability = problem.transparency, problem.stability
    absent = ("band",) if problem.device.kind.own_loop else ("band", "max_sensitivity")
    if problem.hands_met is not None:
        low, high = asdict(problem.hands.low), asdict(problem.hands.high)
        operator = {name: {"min": low[name], "max": high[name]} for name in low}
    document: dict[str, Any] = {
        "name": problem.name,
        "description": problem.description,
        "device": device,
        **({"operator": operator} if operator else {}),
        **({"environment": _worlds(problem.worlds)} if problem.worlds else {}),
        **_bounds(problem.bounds, problem.device.kind.stated),
        "transparency": {
            "band_hz": _hz(transparency.band),
            "reference_impedance": transparency.reference_impedance,
            "norm": transparency.norm,
            "weights": asdict(transparency.weights),
        },
        "stability": {
            **({"band_hz": _hz(stability.band)} if problem.device.kind.banded else {}),
            **{name: value for name, value in asdict(stability).items() if name not in absent and value is not None},
        },
    }
    if problem.uncertainty is not None:
        stated = problem.uncertainty
        document["uncertainty"] = dict(stated.half_widths) | {"objective": stated.objective}
        if stated.unmodelled:
            document["uncertainty"]["unmodelled"] = [list(point) for point in stated.unmodelled]
    if problem.device.servo is not None and problem.device.servo.radii:
        uncertainty = document.setdefault("uncertainty", {})
        uncertainty["unmodelled"] = [list(point) for point in problem.device.servo.radii]
    if problem.experiments:
        document["experiment"] = [_experiment(experiment) for experiment in problem.experiments]
    return document


def table_of(value: Any) -> dict[str, Any]:
    """Return an object of the model as the table that states it, without absent parts."""
    table = {field.name: getattr(value, field.name) for field in fields(value)}
    table = {
        key: table_of(entry) if is_dataclass(entry) and not isinstance(entry, type) else entry
        for key, entry in table.items()
        if entry is not None
    }
    if isinstance(value, Servo):
        del table["radii"]  # [uncertainty] states the radii
    elif isinstance(value, Environment) and not value.late:
        del table["late"]
    elif isinstance(value, VelocityEstimate):
        table["from"] = table.pop("source")
    elif isinstance(value, Device) and value.servo is not None:
        table = {key: entry for key, entry in table.items() if key in SERVO_KEYS and entry != "linear"}
    elif isinstance(value, Device):
        if "resolution" in table:
            table.setdefault("velocity", {})["resolution"] = table.pop("resolution")
        absent = {"display": value.kind is ADMITTANCE, "units": value.units == "linear"}
        table = {key: entry for key, entry in table.items() if not absent.get(key)}
    for number in (
        number_of_part for part in PARTS.values() if isinstance(value, part.record) for number_of_part in part.numbers
    ):
        if number.order_key and number.name not in table:
            del table[number.order_key]  # the low-pass does not exist
    return table


def _worlds(worlds: Worlds) -> dict[str, Any]:
    """Return the environments as a table: all ranges, and the other keys unless they are at their defaults."""
    low, high = worlds.low, worlds.high
    return {
        "mass": {"min": low.mass, "max": high.mass},
        "damping": {"min": low.damping},
        "stiffness": {"min": low.stiffness, "max": high.stiffness},
        **({"walls": True} if worlds.walls else {}),
        **({"corner_hz": _edge(worlds.corner)} if worlds.corner is not None else {}),
    }


def _bounds(bounds: Bounds, keys: Sequence[str]) -> dict[str, Any]:
    """Return the ranges of the variables as tables; a fixed variable is a number."""

    def variable(range_: Range) -> float | dict[str, float]:
        return range_.min if range_.fixed else asdict(range_)

    tables: dict[str, Any] = {"gains": {}, "coupling": {}}
    for table, name in (key.split(".") for key in keys):
        tables[table][name] = variable(getattr(bounds, name))
    return {table: stated for table, stated in tables.items() if stated}


def _hz(band: Band) -> list[float]:
    return [_edge(band.min), _edge(band.max)]


def _edge(omega: float) -> float:
    """Return a frequency, rad/s, in hertz. If it was a short decimal in hertz, the result is that decimal."""
    short = hertz(omega)
    return short if omega == inf or 2 * pi * short == omega else omega / (2 * pi)


def _experiment(experiment: Experiment) -> dict[str, Any]:
    """Return an experiment as a table, without absent parts, and with defaults written out."""
    operator = {key: value for key, value in asdict(experiment.operator).items() if value is not None}
    sensors = asdict(experiment.sensors)
    operator["from"], operator["to"] = operator.pop("start"), operator.pop("end")
    parts = {
        "friction": experiment.friction and asdict(experiment.friction),
        "actuator": {"limit": experiment.limit} if experiment.limit is not None else None,
        "baseline": experiment.baseline and asdict(experiment.baseline),
    }
    return {
        "name": experiment.name,
        "environment": table_of(experiment.environment),
        "operator": operator,
        "sensors": sensors,
        **{name: table for name, table in parts.items() if table is not None},
    }
