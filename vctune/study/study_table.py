"""Arrange the rows of a study as columns, in the order of its points, for files, figures and summaries."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from io import StringIO
from itertools import product
from math import isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.judging.judge import Status
from vctune.design.records.rest import ChatterColumns
from vctune.document.schema.number_units import heading, unit_of
from vctune.document.study_file import Study, number_keys
from vctune.document.text.json import printed
from vctune.document.text.toml import value_at
from vctune.model.display import ADMITTANCE, STEPPED, Display, stated_display
from vctune.model.numbers.units import UNITS, UnitSystem
from vctune.study.row_record import COLUMN_OF_KEY, QUANTITY_OF_COLUMN, SHOWN_COLUMNS
from vctune.study.rows import StudyRows

AxisValues = tuple[float, ...]


def points(study: Study) -> Iterator[AxisValues]:
    """Yield the values of the axes at every point; the last axis of a grid varies fastest."""
    columns = [axis.values for axis in study.axes]
    return product(*columns) if study.sample.kind == "grid" else zip(*columns, strict=True)


@dataclass(frozen=True, slots=True)
class Summary:
    """The summary of a sweep."""

    study: str  # name of the study
    points: int  # number of finished points, and by their status
    status: dict[str, int]
    idle: int  # number of certified designs that render almost nothing
    yardstick: dict[str, Any]  # scale of the errors, except for the keys `varied`, which an axis states
    units: dict[str, str]  # units of axes and numbers, by key and column
    # certified row with the least error of those that do not buzz, or of all if all do; None without one
    best: dict[str, Any] | None
    worst: dict[str, Any] | None  # certified row with the greatest error
    corner: dict[str, Any] | None  # smallest box over the axes that holds every point without a certified design

    def to_json(self) -> dict[str, Any]:
        """Return the object for JSON."""
        return {**printed("sweep", **asdict(self)), "schema": "vctune/sweep/2"}


def summary(study: Study, table: Table) -> Summary:
    """Return the summary of a sweep."""
    certified = np.flatnonzero(table.certified)
    error = table.numbers["error"][certified]
    by_error = certified[np.argsort(error, kind="stable")]
    by_worth = certified[np.lexsort((error, table.buzzing[certified]))]
    measured = study.yardstick
    yardstick = {
        "band_hz": list(measured.band.hz),
        "reference_impedance": measured.reference_impedance,
        "norm": measured.norm,
        "weights": asdict(measured.weights),
        "varied": [axis.key for axis in study.axes if axis.path[0] == "transparency"],
    }
    return Summary(
        study=study.name,
        points=len(table.status),
        status=dict(sorted(Counter(table.status).items())),
        idle=int(table.idle.sum()),
        yardstick=yardstick,
        units=table.units,
        best=table.row(int(by_worth[0])) if certified.size else None,
        worst=table.row(int(by_error[-1])) if certified.size else None,
        corner=_corner(table) if not table.certified.all() else None,
    )


def _corner(table: Table) -> dict[str, Any]:
    without = ~table.certified
    low = {key: float(column[without].min()) for key, column in table.axes.items()}
    high = {key: float(column[without].max()) for key, column in table.axes.items()}
    inside = np.logical_and.reduce([(column >= low[key]) & (column <= high[key]) for key, column in table.axes.items()])
    reasons = Counter(reason for reason, lacks in zip(table.reason, without, strict=True) if lacks)
    count = int(without.sum())
    box = {"low": low, "high": high}
    return {"points": count, "share": count / int(inside.sum()), **box, "reason": reasons.most_common(1)[0][0]}


@dataclass(frozen=True, slots=True)
class Table:
    """The table of a study: columns of equal length."""

    axes: dict[str, Floats]  # values of the axes, by dotted key
    status: list[str]  # texts; a certified point has the reason ""
    idle: NDArray[np.bool_]  # whether each design is certified but hardly uses its velocity loop
    reason: list[str]
    numbers: dict[str, Floats]
    system: UnitSystem = "linear"  # the problem's system of units
    kind: Display = ADMITTANCE

    @property
    def certified(self) -> NDArray[np.bool_]:
        """Flags of the points that have a certified design."""
        return np.array([status == Status.CERTIFIED for status in self.status], dtype=bool)

    @property
    def buzzing(self) -> NDArray[np.bool_]:
        """Flags of the points whose design some kick keeps moving."""
        return np.asarray(self.numbers["kicks_moving"] > 0)

    def columns(self) -> dict[str, Any]:
        """Return every column by its name."""
        return {**self.axes, "status": self.status, "idle": self.idle, **self.numbers, "reason": self.reason}

    @property
    def units(self) -> dict[str, str]:
        """The unit of each column that has one."""
        units = UNITS[self.system]
        found = {key: unit_of(number_keys()[key], units) for key in self.axes}
        found |= {name: units.of(SHOWN_COLUMNS[name].of) or SHOWN_COLUMNS[name].unit for name in self.numbers}
        return {name: unit for name, unit in found.items() if unit}

    def row(self, i: int) -> dict[str, Any]:
        """Return one row, with None for absent values."""
        return {name: _plain(column[i]) for name, column in self.columns().items()}

    def rows(self) -> list[dict[str, Any]]:
        """Return all rows, with None for absent values."""
        return [self.row(i) for i in range(len(self.status))]

    def __repr__(self) -> str:
        axes = ", ".join(self.axes)
        return f"Table({len(self.status)} points over {axes}, {int(self.certified.sum())} certified)"


def _plain(value: Any) -> Any:
    """Return a value of a column as a plain Python object; None if it does not exist."""
    if isinstance(value, str):
        return value or None
    if isinstance(value, np.bool_):
        return bool(value)
    return None if isnan(value) else float(value)


def number_columns(study: Study) -> list[str]:
    """Return the names of the columns of numbers that designs of a study's display have."""
    device = study.document["device"]
    absent = {COLUMN_OF_KEY[key] for key in set(COLUMN_OF_KEY) - set(stated_display(device).stated)}
    steps = value_at(device, ("velocity", "resolution")) or any("resolution" in axis.path for axis in study.axes)
    absent |= set() if steps else set(ChatterColumns.model_fields)
    return [name for name in QUANTITY_OF_COLUMN if name not in absent]


def table_of(study: Study, rows: StudyRows, keys: list[str]) -> Table:
    """Return the table of a study, with the numbers that designs of its display have."""
    values = np.array(list(points(study)), dtype=float).reshape(-1, len(study.axes))
    device, found = study.document["device"], [rows.known[key] for key in keys]
    return Table(
        {axis.key: values[:, k] for k, axis in enumerate(study.axes)},
        [row["status"] for row in found],
        np.array([row["idle"] for row in found], dtype=bool),
        [row["reason"] or "" for row in found],
        {
            name: np.array([nan if row.get(name) is None else row[name] for row in found], dtype=float)
            for name in number_columns(study)
        },
        device.get("units") or "linear",
        STEPPED if value_at(study.document, ("coupling", "rule")) == "euler" else stated_display(device),
    )


def csv_text(table: Table) -> str:
    """Return a table as CSV, with numbers in their shortest exact decimals and blanks for absent values."""
    stream, units = StringIO(), table.units
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(heading(name, units.get(name, "")) for name in table.columns())
    for row in table.rows():
        writer.writerow(
            str(value).lower() if isinstance(value, bool) else "" if value is None else value for value in row.values()
        )
    return stream.getvalue()
