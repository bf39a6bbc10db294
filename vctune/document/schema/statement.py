"""Write a problem as a document that states every default: the inverse of `vctune.document.schema.defaults`."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from math import inf, pi
from typing import Any

from vctune.document.text.toml import placed
from vctune.model.device import Device
from vctune.model.experiment import Experiment
from vctune.model.fields import table_of
from vctune.model.numbers.units import hertz
from vctune.model.parts import PARTS
from vctune.model.problem import Band, Problem, Range
from vctune.model.worlds import Worlds


def statement(problem: Problem) -> dict[str, Any]:
    """Return the document of a problem, as a problem file would state it."""
    device, transparency, stability = problem.device, problem.transparency, problem.stability
    operator = None if device.operator is None else asdict(device.operator)
    if problem.hands_met is not None:
        operator = {name: {"min": low, "max": high} for name, (low, high) in problem.hands.ranges.items()}
    variables = [key.split(".") for key in device.kind.stated]
    rule = [(["coupling", "rule"], device.rule)] if device.rule != "trapezoid" else []
    constraints = {"safety_factor": stability.safety_factor, "criterion": stability.criterion}
    constraints |= {"max_sensitivity": stability.max_sensitivity} if device.kind.own_loop else {}
    constraints |= {
        each.name: value for each in fields(stability) if (value := getattr(stability, each.name)) != each.default
        if each.name not in ("band", "safety_factor", "max_sensitivity")
    }  # fmt: skip
    uncertainty: dict[str, Any] = {}
    radii = device.servo.radii if device.servo is not None else ()
    if problem.uncertainty is not None:
        divided = device.delay_key if device.divided else None
        uncertainty = {key: width for key, width in problem.uncertainty.half_widths if key != divided}
        uncertainty |= {key: asdict(ends) for key, ends in problem.uncertainty.ranges}
        uncertainty |= {"objective": problem.uncertainty.objective}
        radii = radii or problem.uncertainty.unmodelled
    uncertainty |= {"unmodelled": [list(point) for point in radii]} if radii else {}
    document: dict[str, Any] = {
        "name": problem.name,
        "description": problem.description,
        "device": device_table(device),
        "operator": operator,
        "environment": {"stiffness": inf} if problem.rigid else problem.worlds and _worlds(problem.worlds),
        **placed({}, [*((key, _range(getattr(problem.bounds, key[1]))) for key in variables), *rule]),
        "transparency": {
            "band_hz": _hz(transparency.band),
            "reference_impedance": transparency.reference_impedance,
            "norm": transparency.norm,
            "weights": asdict(transparency.weights),
        },
        "stability": ({"band_hz": _hz(stability.band)} if device.kind.banded else {}) | constraints,
        "uncertainty": uncertainty or None,
        "experiment": [_experiment(experiment) for experiment in problem.experiments] or None,
    }
    return {key: table for key, table in document.items() if table is not None}


def device_table(device: Device) -> dict[str, Any]:
    """Return the table [device] of a device, without its operator."""
    own = ["sample_time"] if device.servo else ["mass", "damping", "sample_time", "delay", "hold"]
    own += ["units"] if device.units != "linear" else []
    own += ["display"] if device.kind.inverse else []
    own += ["friction"] if device.friction is not None else []
    table: dict[str, Any] = {name: getattr(device, name) for name in own}
    if (servo := device.servo) is not None and servo.latency is not None:
        device = replace(device, servo=replace(servo, delay=servo.latency, latency=None))
    for key, part in PARTS.items():
        if (stated := getattr(device, key)) is not None:
            table[key] = table_of(stated)
            for number in part.numbers:
                if number.order_key and number.name not in table[key]:
                    del table[key][number.order_key]  # the low-pass does not exist
    if table.get("velocity", {}).get("at") == "motor":
        del table["velocity"]["at"]
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


def _range(variable: Range) -> float | dict[str, float]:
    return variable.min if variable.fixed else asdict(variable)


def _hz(band: Band) -> list[float]:
    return [_edge(band.min), _edge(band.max)]


def _edge(omega: float) -> float:
    """Return a frequency, rad/s, in hertz. If it was a short decimal in hertz, the result is that decimal."""
    short = hertz(omega)
    return short if omega == inf or 2 * pi * short == omega else omega / (2 * pi)


def _experiment(experiment: Experiment) -> dict[str, Any]:
    """Return an experiment as a table, with defaults written out."""
    parts = {key: getattr(experiment, key) for key in ("environment", "operator", "friction", "sensors", "baseline")}
    tables: dict[str, Any] = {key: table_of(part) for key, part in parts.items() if part is not None}
    limit = {} if experiment.limit is None else {"actuator": {"limit": experiment.limit}}
    return {"name": experiment.name, **tables, **limit}
