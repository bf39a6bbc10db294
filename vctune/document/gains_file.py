"""The gains file: [gains] and [coupling] to paste into a problem, [design] to say where they come from.

See document/README.md, section 2.
"""

from __future__ import annotations

from dataclasses import astuple

from vctune.document.text.toml_writing import quoted
from vctune.model.display import DisplayName
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.numbers.keys import keys_of, labelled
from vctune.model.numbers.units import UNITS, UnitSystem


def design_tables(gains: Gains, coupling: AnyCoupling) -> dict[str, dict[str, float]]:
    """Return the tables [gains] and [coupling] of a design; an impedance display has no K_p.

    Parameters
    ----------
    gains, coupling : plain floats
    """
    numbers = astuple(gains) + astuple(coupling)
    tables: dict[str, dict[str, float]] = {"gains": {}, "coupling": {}}
    for key, value in zip(keys_of(len(numbers)), numbers, strict=True):
        table, name = key.split(".")
        if not (key == "gains.position" and isinstance(coupling, SpringDamper)):
            tables[table][name] = value
    return tables


def design_numbers(gains: Gains, coupling: AnyCoupling) -> dict[str, float]:
    """Return the numbers of a design by their keys, in order; an impedance display has no K_p.

    Parameters
    ----------
    gains, coupling : plain floats
    """
    tables = design_tables(gains, coupling)
    return {f"{table}.{name}": value for table, numbers in tables.items() for name, value in numbers.items()}


def numbers_text(gains: Gains, coupling: AnyCoupling) -> str:
    """Return the numbers of a design as one text, from which an edited file knows what it was.

    Parameters
    ----------
    gains, coupling : plain floats
    """
    return " ".join(repr(number) for number in design_numbers(gains, coupling).values())


def numbers_in(text: str, gains: Gains, coupling: AnyCoupling) -> dict[str, float]:
    """Return the numbers that `numbers_text` wrote by their keys; none where they are not those of such a design.

    Parameters
    ----------
    text : of the numbers
    gains, coupling : a design of the same kind
    """
    try:
        return dict(zip(design_numbers(gains, coupling), map(float, text.split()), strict=True))
    except ValueError:
        return {}


def gains_text(gains: Gains, coupling: AnyCoupling, origin: dict[str, str], units: UnitSystem = "linear") -> str:
    """Return the text of a gains file.

    Parameters
    ----------
    gains, coupling : plain floats, written in their shortest exact decimals
    origin : keys and texts of the [design] table, beside the display and the units
    units : of the device
    """
    display: DisplayName = "impedance" if isinstance(coupling, SpringDamper) else "admittance"
    stated = {**origin, "display": display, "units": units}
    written = [
        [
            f"[{table}]",
            *(f"{name} = {value!r}  # {labelled(f'{table}.{name}', UNITS[units])}" for name, value in numbers.items()),
            "",
        ]
        for table, numbers in design_tables(gains, coupling).items()
    ]
    lines = [
        "# Paste [gains] and [coupling] into a problem file to fix them.",
        *(line for table in written for line in table),
        "[design]",
        *(f"{key} = {quoted(text)}" for key, text in stated.items()),
    ]
    return "\n".join(lines) + "\n"
