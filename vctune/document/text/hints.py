"""The probable intention behind a number that does not parse, such as a decimal comma or a unit."""

from __future__ import annotations

import re
from math import pi

PREFIXED = {"g": ("kg", 1e-3), "ms": ("s", 1e-3), "us": ("s", 1e-6), "µs": ("s", 1e-6), "mm": ("m", 1e-3)} | {
    "cm": ("m", 1e-2), "kHz": ("Hz", 1e3), "kN/m": ("N/m", 1e3), "N/mm": ("N/m", 1e3),
    "g cm2": ("kg m2", 1e-7), "kg cm2": ("kg m2", 1e-4), "mNm": ("N m", 1e-3), "mN m": ("N m", 1e-3),
    "deg": ("rad", pi / 180), "rpm": ("rad/s", pi / 30),
}  # fmt: skip
"""Units that users write instead of those of the file, and their conversion."""
CALLED = {
    "inertia": "mass",
    "moment_of_inertia": "mass",
    "handle_inertia": "handle_mass",
}
"""Keys by what a rotary device's numbers are called; a key of a torque is that of a force."""
WITH_COMMA = re.compile(r"([-+]?\d+),(\d+)")
WITH_UNIT = re.compile(r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?) *([A-Za-zµ][\w /^²·*]*)")
ASSIGNED = re.compile(r"=\s*([^#]*?)\s*(?:#.*)?$")


def number_meant(text: str) -> str:
    """Return the hint at the number that a text probably means, with a decimal comma or a unit; "" if there is none.

    Parameters
    ----------
    text : the written text
    """
    comma = WITH_COMMA.fullmatch(text)
    if comma:
        return f"; is the comma a decimal point? Write {comma[1]}.{comma[2]}"
    found = WITH_UNIT.fullmatch(text)
    if not found:
        return ""
    number, unit = found[1].replace(",", "."), found[2].strip()
    of, scale = PREFIXED.get(unit, ("", 1.0))
    alone = f"{float(number) * scale:.12g}" if of else number
    return f"; write {alone} alone: the file is in {of or 'SI units'}, without units behind numbers"


def hint_on_line(line: str) -> str:
    """Return the hint at the number that a line of TOML, which does not parse, probably means; "" if there is none.

    Parameters
    ----------
    line : line of the file
    """
    assigned = ASSIGNED.search(line)
    return number_meant(assigned[1]) if assigned else ""


def commas_meant(values: list[object]) -> str:
    """Return the hint at the pair of numbers with decimal commas that a list probably means; "" if there is none.

    Parameters
    ----------
    values : values of the list
    """
    if len(values) != 4 or not all(type(value) is int for value in values):
        return ""
    a, b, c, d = values
    return f"; are these decimal points? Write [{a}.{b}, {c}.{d}]"
