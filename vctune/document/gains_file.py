"""Write the gains file. The user can paste its tables [gains] and [coupling] into a problem; [design] states their
origin. See document/README.md, section 2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

from vctune.document.text.toml import placed, quoted
from vctune.model.display import STEPPED, Display
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.units import UNITS, UnitSystem


def design_numbers(kind: Display, gains: Gains, coupling: AnyCoupling) -> dict[str, float]:
    """Return the gains and coupling parameters that the display of a design has, by key and in order."""
    numbers = zip(kind.keys, astuple(gains) + astuple(coupling), strict=True)
    return {key: number for key, number in numbers if key not in kind.absent}


def design_tables(kind: Display, gains: Gains, coupling: AnyCoupling) -> dict[str, dict[str, Any]]:
    """Return the tables [gains] and [coupling] of a design; a servo has only [coupling]."""
    stated: dict[str, float | str] = {"coupling.rule": "euler"} if kind is STEPPED else {}
    stated |= design_numbers(kind, gains, coupling)
    return placed({}, ((key.split("."), value) for key, value in stated.items()))


def numbers_text(kind: Display, gains: Gains, coupling: AnyCoupling) -> str:
    """Return the values of a design as one line of text. The line keeps the solved values when a user edits the
    gains."""
    return " ".join(repr(number) for number in design_numbers(kind, gains, coupling).values())


def numbers_in(text: str, kind: Display) -> dict[str, float]:
    """Return the values that `numbers_text` wrote, by key."""
    try:
        return dict(zip(kind.stated, map(float, text.split()), strict=True))
    except ValueError:
        return {}


def _line(kind: Display, table: str, name: str, value: Any, units: UnitSystem) -> str:
    if isinstance(value, str):
        return f"{name} = {quoted(value)}  # M a + D v = F"
    return f"{name} = {value!r}  # {kind.labelled(f'{table}.{name}', UNITS[units])}"


def gains_text(
    kind: Display,
    gains: Gains,
    coupling: AnyCoupling,
    origin: Mapping[str, str | float],
    units: UnitSystem = "linear",
) -> str:
    """Return the text of a gains file."""
    stated, tables = {**origin, "display": kind.name, "units": units}, design_tables(kind, gains, coupling)
    written = [
        [
            f"[{table}]",
            *(_line(kind, table, name, value, units) for name, value in values.items()),
            "",
        ]
        for table, values in tables.items()
    ]
    lines = [
        f"# Paste {' and '.join(f'[{table}]' for table in tables)} into a problem file to fix these numbers.",
        *(line for table in written for line in table),
        "[design]",
        *(f"{key} = {quoted(value) if isinstance(value, str) else repr(value)}" for key, value in stated.items()),
    ]
    return "\n".join(lines) + "\n"
