"""Guess the number that a user meant by a text that does not parse, such as 0,4 or "400 g"."""

from __future__ import annotations

import re
from math import pi

# Units that users write instead of the file's units, with the conversion
PREFIXED = {"g": ("kg", 1e-3), "ms": ("s", 1e-3), "us": ("s", 1e-6), "µs": ("s", 1e-6), "mm": ("m", 1e-3)} | {
    "cm": ("m", 1e-2), "kHz": ("Hz", 1e3), "kN/m": ("N/m", 1e3), "N/mm": ("N/m", 1e3),
    "g cm2": ("kg m2", 1e-7), "kg cm2": ("kg m2", 1e-4), "mNm": ("N m", 1e-3), "mN m": ("N m", 1e-3),
    "deg": ("rad", pi / 180), "rpm": ("rad/s", pi / 30),
}  # fmt: skip
# Names that users give to keys by mistake, in particular names of rotary quantities
CALLED = {
    "inertia": "mass",
    "moment_of_inertia": "mass",
    "handle_inertia": "handle_mass",
}
WITH_COMMA = re.compile(r"([-+]?\d+),(\d+)")
WITH_UNIT = re.compile(r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?) *([A-Za-zµ][\w /^²·*]*)")
FINER = ((1e-6, "microseconds"), (1e-3, "milliseconds"))  # Finer units of time, each in seconds, with its name
# Sample time, s, from which vctune asks whether it is in seconds: twice the sample time of the slowest example
LONGEST_SAMPLE = 0.1
SLOWEST_RATE = 10.0  # Hz, from which a sample time may be a rate
ASSIGNED = re.compile(r"=\s*([^#]*?)\s*(?:#.*)?$")


def number_meant(text: str) -> str:
    """Return a hint on the number that a text probably means, with a decimal comma or a unit; "" without a guess."""
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
    """Return a hint on the number that an unparsable line of TOML probably means; "" without a guess."""
    assigned = ASSIGNED.search(line)
    return number_meant(assigned[1]) if assigned else ""


def commas_meant(values: list[object]) -> str:
    """Return a hint on the pair of numbers that a list split by decimal commas probably means; "" without a guess."""
    if len(values) != 4 or not all(type(value) is int for value in values):
        return ""
    a, b, c, d = values
    return f"; are these decimal points? Write [{a}.{b}, {c}.{d}]"


def seconds_meant(value: float) -> str:
    """Return the sample time, s, that a great number probably means: in a finer unit, or as a rate."""
    unit, instead = in_finer_unit(value, LONGEST_SAMPLE)
    rate = f"; or the rate of {value:g} Hz? Then write {1 / value:.6g}" if value >= SLOWEST_RATE else ""
    return f"is it in {unit}? Then write {instead:g}{rate}"


def in_finer_unit(value: float, most: float) -> tuple[str, float]:
    """Return the finer unit in which a number of seconds may have been written, and the value in seconds."""
    scale, unit = next(((scale, unit) for scale, unit in reversed(FINER) if value * scale < most / 5), FINER[0])
    return unit, float(f"{value * scale:.12g}")
