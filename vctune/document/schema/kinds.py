"""Check the kind of device for which gains, a design or a region were made. vctune refuses those for another kind."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from vctune.document.reading import GainsFile, ProblemFile
from vctune.document.records.gains_json import ProblemRecord
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake
from vctune.model.display import IMPEDANCE, DisplayName, stated_display
from vctune.model.numbers.units import UNITS, UnitSystem

# Words for each kind of display in messages
DISPLAYS: Mapping[DisplayName, str] = MappingProxyType(
    {"admittance": "an admittance display", "impedance": "an impedance display", "servo": "a servo"}
)


def require_gains_of(file: ProblemFile, given: GainsFile) -> None:
    """Check that gains are for the same kind of device as a problem."""
    lines = toml.Lines(given.text)
    telling = ("coupling", "stiffness" if given.kind is IMPEDANCE else "mass")
    keys = {"display": telling, "units": ("design", "units")}
    mistakes = [
        Mistake("other-kind", ".".join(keys[which]), message, lines.locate(keys[which]))
        for which, message in _differences(file, given.kind.name, given.units, "gains")
    ]
    if mistakes:
        raise InputError(given.source, mistakes)


def require_record_of(file: ProblemFile, record: ProblemRecord, source: str, what: str) -> None:
    """Check that a record is for the same kind of device as a problem."""
    table: Any = toml.parse(record.text, source).get("device")
    device = table if isinstance(table, dict) else {}
    differ = _differences(file, stated_display(device).name, record.units, what)
    if differ:
        keys = {"display": "problem.text", "units": "problem.units"}
        raise InputError(source, [Mistake("other-kind", keys[which], message) for which, message in differ])


def _differences(file: ProblemFile, display: DisplayName, units: UnitSystem | None, what: str) -> list[tuple[str, str]]:
    """Return the differences between two kinds. Each is "display" or "units", with its message."""
    device, remedy = file.problem.device, f"name the problem of the {what}, or solve this one"
    verb = "are" if what == "gains" else "is"
    sides = [("display", DISPLAYS[display], DISPLAYS[device.display])]
    if units is not None:
        sides.append(("units", _in_units(units), _in_units(device.units)))
    return [
        (key, f"the {what} {verb} for {one}, and {file.source} has {other} (device.{key}); {remedy}")
        for key, one, other in sides
        if one != other
    ]


def _in_units(system: UnitSystem) -> str:
    units = UNITS[system]
    return f"a {system} device, in {units.damping} and {units.stiffness}"
