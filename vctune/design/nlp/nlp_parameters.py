"""Arrange the parameters of an NLP by name, in the same layout for CasADi's symbols and for numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.nlp.nlp_structure import DEMANDS, NlpStructure
from vctune.model.display import SERVO, DisplayName
from vctune.model.loop.device_response import DeviceResponse, DriveResponse, Spring
from vctune.model.loop.filters import FilterResponse
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.hand_loop import LoopInHand
from vctune.model.sampled.velocity_loop import SampledPlant
from vctune.model.sampled.worlds.loop_in_worlds import Disjuncts
from vctune.model.transparency import PANEL_NODES, TERMS

# Types of the optional parts of a `DeviceResponse`, by its fields
PARTS: dict[str, Any] = {"estimate": FilterResponse, "sensor": FilterResponse, "spring": Spring, "factor": Pair}
Layout = dict[str, int]  # Number of rows for each name, in order

# Real and imaginary parts of the pulse transfer functions from force to velocity and position, at a frequency for |S|
PULSE_TRANSFER: Layout = {"re_G_v": 1, "im_G_v": 1, "re_G_x": 1, "im_G_x": 1}
# The rows of `PULSE_TRANSFER`, and the logarithm of the radius of unmodelled dynamics
PERTURBED_LOOP: Layout = {**PULSE_TRANSFER, "log_radius": 1}
# The angle theta, the least permitted ratio Re Z_c / R, and the loop in a hand at this angle
LOOP_IN_HAND: Layout = {"theta": 1, "factor": 1} | {
    f"{part}_{side}": 1 for part in LoopInHand._fields for side in ("even", "odd")
}
# F, the firmware's low-passes, through which the coupling of an impedance display acts
FIRMWARE_FILTER: Layout = {"low_pass_re": 1, "low_pass_im": 1}
# The loop of an impedance display, in one hand or in any passive hand: R/s^2 = (l_0 + l_1 K_v)/(q_0 + q_1 K_v + q_2
# K_v^2)
FORCE_IN_HAND: Layout = {"theta": 1, "factor": 1, **FIRMWARE_FILTER, "lost": 2, "size": 3}
# R and -s Im Z_seen of a servo in a hand, which do not depend on any gain
COMMAND_IN_HAND: Layout = {"theta": 1, "factor": 1, "required": 1, "swing": 1}
IN_HAND: dict[DisplayName, Layout] = {
    "admittance": LOOP_IN_HAND,
    "impedance": FORCE_IN_HAND,
    "servo": COMMAND_IN_HAND,
}
# Rows that a box of environments adds to the loop in a hand
WORLDS_IN_HAND: Layout = {
    **{f"environment_{end}_{name}": 1 for end in ("low", "high") for name in ("mass", "damping", "stiffness")},
    **{f"by_{name}": 1 for name in Disjuncts._fields},
    "reserve": 1,
    "spare": 1,
}
# Rows that walls add: `walled` is 1 for the condition on walls and 0 for the condition on linear environments; the
# other rows are the fields of `AtWall`
WALLS_IN_HAND: Layout = {"walled": 1, "share": 1, "lead": 1}
# Rows of a tangent of the stability boundary: the fields of `Cut`
STABILITY_CUT: Layout = {"open": 1, "velocity": 1, "position": 1}


def in_hand_layout(structure: NlpStructure) -> Layout:
    """Return the layout of a loop in a hand."""
    worlds, walls = WORLDS_IN_HAND if structure.worlds else {}, WALLS_IN_HAND if structure.walls else {}
    return IN_HAND[structure.kind.name] | worlds | walls


def common_layout(structure: NlpStructure) -> Layout:
    """Return the layout of the parameters that all frequencies share."""
    numbers = len(structure.kind.keys) + structure.walls
    layout = {"mass": 1, "damping": 1, "scales": numbers, "fixed": numbers, "weights": len(TERMS)}
    return layout | ({"operator_damping": 1, "safety_factor": 1} if structure.operator_damping else {})


def frequency_layout(structure: NlpStructure) -> Layout:
    """Return the layout of the frequency model at a frequency: omega, the drive, the device's parts, for an uncertain
    device the mass and damping, and for an impedance display the firmware's filter."""
    layout = {"omega": 1, "drive_re": 1, "drive_lag": 1}
    layout |= {f"{part}_{field.name}": 1 for part in structure.parts for field in fields(PARTS[part])}
    layout |= {"mass": 1, "damping": 1} if structure.uncertain else {}
    return layout | (FIRMWARE_FILTER if structure.kind.inverse else {})


def plant_layout(structure: NlpStructure) -> Layout:
    """Return the layout of a sampled plant, for a peak of |S| whose frequency is a variable of the NLP."""
    order = structure.order
    velocity = order + 1 if structure.differenced else order
    taps = {"velocity_newer": velocity, "velocity_older": velocity}
    taps |= {"position_newer": order + 1, "position_older": order + 1}
    return {"open": order, **taps, "whole_samples": 1} | ({"low_pass": 1} if structure.low_passes else {})


def device_numbers(at: DeviceResponse) -> dict[str, Any]:
    """Return a device's constants at frequencies, keyed by the names of `frequency_layout`, without absent parts."""
    numbers = {"omega": at.omega, "drive_re": at.drive.re, "drive_lag": at.drive.lag}
    numbers |= {"mass": at.mass, "damping": at.damping}
    for name in PARTS:
        part = getattr(at, name)
        for field in fields(part) if part is not None else ():
            number = getattr(part, field.name)
            numbers[f"{name}_{field.name}"] = 0.0 if number is None else number
    return numbers


def device_of(structure: NlpStructure, numbers: dict[str, Any], operator: Any) -> DeviceResponse:
    """Return the response of a device at a frequency from symbols by name. The function is the inverse of
    `device_numbers`."""
    parts = {
        name: PARTS[name](**{field.name: numbers[f"{name}_{field.name}"] for field in fields(PARTS[name])})
        for name in structure.parts
    }
    drive = DriveResponse(numbers["drive_re"], numbers["drive_lag"])
    given = numbers["omega"], numbers["mass"], numbers["damping"], drive
    return DeviceResponse(*given, operator=operator, **parts, follows=structure.kind is SERVO)


def plant_numbers(plant: SampledPlant) -> dict[str, Any]:
    """Return the constants of a sampled plant, keyed by the names of `plant_layout`."""
    (v_0, v_1), (x_0, x_1) = plant.velocity, plant.position
    taps = {"velocity_newer": v_0, "velocity_older": v_1, "position_newer": x_0, "position_older": x_1}
    low_pass = {} if plant.low_pass is None else {"low_pass": plant.low_pass}
    return {"open": plant.open, **taps, "whole_samples": plant.whole_samples, **low_pass}


def plant_of(structure: NlpStructure, rows: dict[str, Sequence[Any]]) -> SampledPlant:
    """Return a sampled plant from symbols by name. The function is the inverse of `plant_numbers`."""
    return SampledPlant(
        open=tuple(rows["open"]),
        velocity=(tuple(rows["velocity_newer"]), tuple(rows["velocity_older"])),
        position=(tuple(rows["position_newer"]), tuple(rows["position_older"])),
        whole_samples=rows["whole_samples"][0],
        fractional=True,
        low_pass=rows["low_pass"][0] if structure.low_passes else None,
        order=structure.low_passes,
    )


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the parameters."""

    layout: Layout  # names of the table's rows
    columns: int  # number of the table's columns

    @property
    def rows(self) -> int:
        """Number of the table's rows."""
        return sum(self.layout.values())


def tables(structure: NlpStructure) -> dict[str, Table]:
    """Return the tables of an NLP's parameters by name, in their order."""
    frequency = frequency_layout(structure)
    kinds = (frequency, PULSE_TRANSFER, STABILITY_CUT, frequency, PERTURBED_LOOP, in_hand_layout(structure))
    demands = {
        name: Table(layout, count) for name, layout, count in zip(DEMANDS, kinds, structure.capacities, strict=True)
    }
    nodes = PANEL_NODES * structure.panels * structure.objective_devices
    return {
        "common": Table(common_layout(structure), 1),
        "node": Table({**frequency, "weight": 1}, nodes),
        **demands,
        "tracked_peaks": Table(plant_layout(structure), structure.tracked_peaks),
    }


def unpacked(layout: Layout, column: Any) -> dict[str, Any]:
    """Return the parts of a column of numbers or symbols, by name."""
    ends = np.cumsum([*layout.values()]).tolist()
    return {name: column[end - count : end] for (name, count), end in zip(layout.items(), ends, strict=True)}


def packed(parts: dict[str, Table], numbers: dict[str, dict[str, Any]]) -> Floats:
    """Return all parameters as one array."""
    return np.concatenate([_packed(table, numbers.get(name)) for name, table in parts.items()])


def _packed(table: Table, numbers: dict[str, Any] | None) -> Floats:
    if numbers is None:
        return np.zeros(table.rows * table.columns)
    known = np.vstack([np.reshape(numbers[name], (count, -1)) for name, count in table.layout.items()])
    return known[:, np.minimum(np.arange(table.columns), known.shape[1] - 1)].ravel(order="F")
