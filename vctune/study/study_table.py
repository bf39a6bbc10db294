"""Arrange the rows of a study as columns, in the order of its points, for files, figures and summaries."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from io import StringIO
from math import isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.verdict.judge import Status
from vctune.document.records.rows_json import COLUMN_OF_KEY, QUANTITY_OF_COLUMN
from vctune.document.schema.number_units import heading, unit_of
from vctune.document.study_axes import number_keys
from vctune.document.study_file import Study
from vctune.model.display import DisplayName, stated_display
from vctune.model.numbers.units import UNITS, UnitSystem
from vctune.study.points import points
from vctune.study.rows import Rows


@dataclass(frozen=True, slots=True)
class Table:
    """The table of a study: columns of equal length."""

    axes: dict[str, Floats]  # values of the axes, by dotted key
    status: list[str]  # texts; a certified point has the reason ""
    idle: NDArray[np.bool_]  # whether each design is certified but hardly uses its velocity loop
    reason: list[str]
    numbers: dict[str, Floats]
    system: UnitSystem = "linear"  # the problem's system of units
    display: DisplayName = "admittance"  # kind of display

    @property
    def certified(self) -> NDArray[np.bool_]:
        """Flags of the points that have a certified design."""
        return np.array([status == Status.CERTIFIED for status in self.status], dtype=bool)

    def columns(self) -> dict[str, Any]:
        """Return every column by its name."""
        return {**self.axes, "status": self.status, "idle": self.idle, **self.numbers, "reason": self.reason}

    @property
    def units(self) -> dict[str, str]:
        """The unit of each column that has one."""
        units = UNITS[self.system]
        of_axes = {key: unit_of(number_keys()[key], units) for key in self.axes}
        of_numbers = {name: units.of(quantity) for name, quantity in QUANTITY_OF_COLUMN.items()}
        return {
            name: unit
            for name, unit in {**of_axes, **of_numbers}.items()
            if unit and (name in of_axes or name in self.numbers)
        }

    def headed(self) -> dict[str, Any]:
        """Return every column by its name with its unit, as in files."""
        units = self.units
        return {heading(name, units.get(name, "")): column for name, column in self.columns().items()}

    def __repr__(self) -> str:
        axes = ", ".join(self.axes)
        return f"Table({len(self.status)} points over {axes}, {int(self.certified.sum())} certified)"

    def row(self, i: int) -> dict[str, Any]:
        """Return one row, with None for absent values."""
        return {name: _plain(column[i]) for name, column in self.columns().items()}

    def rows(self) -> list[dict[str, Any]]:
        """Return all rows, with None for absent values."""
        return [self.row(i) for i in range(len(self.status))]

    def subset(self, chosen: NDArray[np.intp]) -> Table:
        """Return some of the rows, in the given order."""
        return Table(
            {key: column[chosen] for key, column in self.axes.items()},
            [self.status[i] for i in chosen],
            self.idle[chosen],
            [self.reason[i] for i in chosen],
            {name: column[chosen] for name, column in self.numbers.items()},
            self.system,
        )


def _plain(value: Any) -> Any:
    """Return a value of a column as a plain Python object; None if it does not exist."""
    if isinstance(value, str):
        return value or None
    if isinstance(value, np.bool_):
        return bool(value)
    return None if isnan(value) else float(value)


def table_of(study: Study, rows: Rows, keys: list[str]) -> Table:
    """Return the table of a study."""
    values = np.array(list(points(study)), dtype=float).reshape(-1, len(study.axes))
    numbers = {name: np.full(len(keys), nan) for name in _columns(study)}
    status, idle, reason = [], [], []
    for i, row in enumerate(rows.read(keys)):
        status.append(row["status"])
        idle.append(row["idle"])
        reason.append(row["reason"] or "")
        for name, column in numbers.items():
            column[i] = nan if row[name] is None else row[name]
    axes, device = {axis.key: values[:, k] for k, axis in enumerate(study.axes)}, study.document["device"]
    system: UnitSystem = device.get("units") or "linear"
    return Table(axes, status, np.array(idle, dtype=bool), reason, numbers, system, stated_display(device).name)


def _columns(study: Study) -> list[str]:
    """Return the names of the numerical columns for designs of the study's display."""
    kind = stated_display(study.document["device"])
    absent = {COLUMN_OF_KEY[key] for key in set(COLUMN_OF_KEY) - set(kind.stated)}
    return [name for name in QUANTITY_OF_COLUMN if name not in absent]


def csv_text(table: Table) -> str:
    """Return a table as CSV, with numbers in their shortest exact decimals and blanks for absent values."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    columns = table.headed()
    writer.writerow(columns)
    for i in range(len(table.status)):
        plain = (_plain(column[i]) for column in columns.values())
        writer.writerow(
            str(value).lower() if isinstance(value, bool) else "" if value is None else value for value in plain
        )
    return stream.getvalue()
