"""The parameters of an NLP by name: the one layout of what CasADi's symbols are taken from and numbers are put into.

The parameters are tables, one after another, each column by column: `common` with one column, and one table for each
kind of frequency with a column for each. A layout gives the rows of a table their names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.nlp_structure import DEMANDS, TERMS, NlpStructure
from vctune.design.variables import NAMES
from vctune.model.transparency import PANEL_NODES

Layout = dict[str, int]
"""How many rows each name has, in order."""

PULSE_TRANSFER: Layout = {"re_G_v": 1, "im_G_v": 1, "re_G_x": 1, "im_G_x": 1}
"""From force to velocity and to position in the sampled loop, at a frequency of |S|."""
SAMPLED_PLANT: Layout = {"pole": 1, "one_minus_pole": 1, "drift": 1, "velocity": 2, "position": 2, "whole_samples": 1}
"""The fields of `SampledPlant`, for a tracked peak of |S|, whose frequency is not known beforehand."""
STABILITY_CUT: Layout = {"open": 1, "velocity": 1, "position": 1}
"""The fields of `Cut`."""


def common_layout(structure: NlpStructure) -> Layout:
    """Return the rows of what all frequencies have in common.

    The device's mass and damping, the five variables' scales, their values where they are not free, the weights, and,
    where an operator eases the conditions, its damping and the safety factor.
    """
    layout = {"mass": 1, "damping": 1, "scales": len(NAMES), "fixed": len(NAMES), "weights": len(TERMS)}
    return layout | ({"operator_damping": 1, "safety_factor": 1} if structure.operator_damping else {})


def frequency_layout(structure: NlpStructure) -> Layout:
    """Return the rows of a frequency: omega, the hold and, where devices differ, mass and damping."""
    layout = {"omega": 1, "hold_re": 1, "hold_lag": 1}
    return layout | ({"mass": 1, "damping": 1} if structure.uncertain else {})


@dataclass(frozen=True, slots=True)
class Table:
    """A part of the parameters.

    Attributes
    ----------
    layout : names of its rows
    columns : how many columns it has
    """

    layout: Layout
    columns: int

    @property
    def rows(self) -> int:
        """How many rows it has."""
        return sum(self.layout.values())


def tables(structure: NlpStructure) -> dict[str, Table]:
    """Return the parts of an NLP's parameters by name, in their order."""
    frequency = frequency_layout(structure)
    kinds = (frequency, PULSE_TRANSFER, STABILITY_CUT, frequency)
    demands = {
        name: Table(layout, count) for name, layout, count in zip(DEMANDS, kinds, structure.capacities, strict=True)
    }
    nodes = PANEL_NODES * structure.panels * structure.objective_devices
    return {
        "common": Table(common_layout(structure), 1),
        "node": Table({**frequency, "weight": 1}, nodes),
        **demands,
        "tracked_peaks": Table(SAMPLED_PLANT, structure.tracked_peaks),
    }


def unpacked(layout: Layout, column: Any) -> dict[str, Any]:
    """Return the parts of a column, numbers or symbols, by name."""
    ends = np.cumsum([*layout.values()]).tolist()
    return {name: column[end - count : end] for (name, count), end in zip(layout.items(), ends, strict=True)}


def packed(parts: dict[str, Table], numbers: dict[str, dict[str, Any]]) -> Floats:
    """Return the parameters as one array.

    Parameters
    ----------
    parts : of `tables`
    numbers : for each table that has columns, and each of its names, an array of shape (columns,) or (rows, columns);
        columns that are not used repeat the last one, those of a table without numbers are 0
    """
    return np.concatenate([_packed(table, numbers.get(name)) for name, table in parts.items()])


def _packed(table: Table, numbers: dict[str, Any] | None) -> Floats:
    if numbers is None:
        return np.zeros(table.rows * table.columns)
    known = np.vstack([np.reshape(numbers[name], (count, -1)) for name, count in table.layout.items()])
    return known[:, np.minimum(np.arange(table.columns), known.shape[1] - 1)].ravel(order="F")
