"""Read measured points of a plane of gains: a CSV table of two of a design's numbers, and whether it was stable."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from math import isfinite
from pathlib import Path

from vctune.document.schema.validation import MAX_MISTAKES
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake
from vctune.model.numbers.units import SYMBOLS

STABLE = {"yes": True, "true": True, "1": True, "stable": True, "no": False, "false": False, "0": False}
STABLE |= {"unstable": False}
LAW = {"coupling.mass": "M", "coupling.drag": "D"}  # Symbols of Euler's law
COLUMN = "stable"  # Header of the column that says whether the device was stable


@dataclass(frozen=True, slots=True)
class MeasuredPoint:
    """Two numbers of a design, SI units, with which a device was measured."""

    x: float
    y: float
    stable: bool


def measured_points(path: Path, keys: tuple[str, str]) -> list[MeasuredPoint]:
    """Return the points of a CSV file with columns of two keys (or the last parts of these) and of `stable`.

    Parameters
    ----------
    path : Path
        The file; "-" is standard input.
    keys : tuple of str
        Dotted keys of x and y.

    Returns
    -------
    list of MeasuredPoint

    Raises
    ------
    InputError
        If a column is missing, or a number or an answer cannot be read: each with its line.
    """
    source = str(toml.called(path))
    rows = list(csv.reader(StringIO(toml.read_text(path)), skipinitialspace=True))
    heads = [head.strip() for head in rows[0]] if rows else []
    at = [_column(heads, key, source) for key in (*keys, COLUMN)]
    found, mistakes = list[MeasuredPoint](), list[Mistake]()
    for line, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        try:
            found.append(_point(row, at, (*keys, COLUMN)))
        except ValueError as error:
            mistakes.append(Mistake("log-text", "", str(error), line))
    if mistakes:
        raise InputError(source, mistakes[:MAX_MISTAKES])
    return found


def _column(heads: Sequence[str], key: str, source: str) -> int:
    for name in (key, key.rpartition(".")[2], SYMBOLS.get(key), LAW.get(key)):
        if name in heads:
            return heads.index(name)
    there, short = ", ".join(heads) or "none", f" or {key.rpartition('.')[2]}" if "." in key else ""
    message = f"has no column {key}{short}; a header names both axes and {COLUMN} (yes or no), divided by commas, and "
    message += f"there are: {there}"
    raise InputError.of(source, "log-columns", message, line=1)


def _point(row: Sequence[str], at: Sequence[int], keys: Sequence[str]) -> MeasuredPoint:
    cells = [row[k].strip() if k < len(row) else "" for k in at]
    numbers = list[float]()
    for key, cell in zip(keys, cells[:2], strict=False):
        try:
            number = float(cell)
        except ValueError:
            raise ValueError(f"{key} is {cell!r}, no number") from None
        if not isfinite(number):
            raise ValueError(f"{key} is {cell}, not finite")
        numbers.append(number)
    stable = STABLE.get(cells[2].lower())
    if stable is None:
        raise ValueError(f"{keys[2]} is {cells[2]!r}; write yes or no")
    x, y = numbers
    return MeasuredPoint(x, y, stable)
