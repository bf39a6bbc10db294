"""The phases of a design's parts as the rows of a table: how much each part delays the loop."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

import numpy as np

from vctune.analysis.phases import PARTS, Phases, crossover, force_phases, loop_phases, sensor_miss
from vctune.model.gains import Gains
from vctune.model.numbers.frequency import hertz
from vctune.model.problem import Problem
from vctune.report.typography import quantity

# Number of frequencies at which the code averages |1 - F_s|: the midpoints of logarithmically equal intervals
POINTS = 200


@dataclass(frozen=True, slots=True)
class PhaseTable:
    """The phases of a design's parts, as texts."""

    headings: tuple[str, ...]  # headings of the columns
    rows: list[tuple[str, ...]]  # name of each part, and its phase in each column
    remark: str  # sentence about the force sensor's loss; empty without a sensor


def phase_table(problem: Problem, gains: Gains) -> PhaseTable:
    """Return the phases of the loop and of the force path at the loop's crossover, and of the force path at the band's
    upper edge."""
    device, edge, force_name = problem.device, problem.transparency.band.max, problem.units.force_name
    cross = crossover(device, gains)
    columns: list[tuple[str, Phases]] = []
    if cross is not None:
        columns = [(f"loop, {_hz(cross)}", loop_phases(device, gains, cross))]
        columns += [(f"{force_name} path, {_hz(cross)}", force_phases(device, gains, cross))]
    if gains.closed:
        columns += [(f"{force_name} path, {_hz(edge)}", force_phases(device, gains, edge))]
    parts = [part for part in PARTS if any(part in phases.shares for _, phases in columns)]
    rows = [
        (problem.units.translated(part), *(_degrees(phases.shares.get(part)) for _, phases in columns))
        for part in parts
    ]
    rows += [("together", *(_degrees(phases.total) for _, phases in columns))] if columns else []
    return PhaseTable(("", *(heading for heading, _ in columns)), rows, _remark(problem))


def _remark(problem: Problem) -> str:
    band = problem.transparency.band
    share = np.append((np.arange(POINTS) + 0.5) / POINTS, 1.0)
    miss = sensor_miss(problem.device, band.min * (band.max / band.min) ** share)
    if miss is None:
        return ""
    mean, force_name = float(np.sqrt(np.mean(miss[:-1] ** 2))), problem.units.force_name
    return (
        f"The {force_name} sensor loses |1 - F_s| = {mean:.2g} of the hand's {force_name} on average over the "
        f"transparency band, and {miss[-1]:.2g} at its upper edge. No gain affects this loss, and the error does not "
        "include it."
    )


def _degrees(angle: float | None) -> str:
    return "" if angle is None else f"{round(degrees(angle), 1) + 0.0:.1f}°".replace("-", "−")


def _hz(omega: float) -> str:
    return str(quantity(hertz(omega), "Hz"))
