"""The typography of numbers, units and mathematics: one format for the page, its tables and its figures."""

from __future__ import annotations

import re
from collections.abc import Callable
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from html import escape, unescape
from math import floor, inf, isfinite, log10
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from vctune.document.records.part import NOTHING, text

THIN = "\u202f"  # Thin space between a number and its unit
DIGITS = 4  # Number of significant digits where a reader does not need to copy the number
SAME = 1e-9  # Relative difference within which a limit equals a round number
PLAIN = (0.1, 1e4)  # Sizes between which a number keeps its unit without a prefix
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
PREFIXED = ("N", "Hz", "m", "s", "W")  # First letters of the units that take a prefix
SYMBOL = re.compile(r"(?<![\w.\"'])([A-Za-zτ])_([A-Za-z0-9]{1,5}\b)(?![_.])")  # A letter with a subscript
# patterns of plain signs, each with its typographic form; a minus between symbols has spaces around it
SIGNS: dict[str, str | Callable[[re.Match[str]], str]] = {
    r">=": "≥",
    r"<=": "≤",
    r"(?<![\w.)])-(?=\d)": "−",
    r"(?<=\w|\|) - (?=[\w|])": " − ",
    r"(\d)e([+-]\d+)(?!\w)": lambda found: f"{found[1]} × 10{raised(int(found[2]))}",
}


class Quantity(NamedTuple):
    """A number and its unit, as texts."""

    value: str
    unit: str

    def __str__(self) -> str:
        return f"{self.value}{THIN * (self.unit not in ('', '°'))}{self.unit}"


def quantity(value: float | None, unit: str = "", digits: int = DIGITS) -> Quantity:
    """Return a number in its unit with a suitable prefix."""
    return _together([value], unit, digits)


def span(low: float, high: float, unit: str = "", digits: int = DIGITS) -> Quantity:
    """Return a range of numbers in one unit, whose prefix suits the greater end."""
    return _together([low, high], unit, digits)


def _together(values: list[float | None], unit: str, digits: int) -> Quantity:
    size = max((abs(each) for each in values if each is not None and each != inf), default=0.0)
    power, unit = prefixed(size, unit)
    return Quantity(" to ".join(_number(each, power, digits) for each in values), spaced(unit))


def prefixed(size: float, unit: str) -> tuple[int, str]:
    """Return the power of ten of a suitable prefix, and the unit with this prefix."""
    if size == 0 or PLAIN[0] <= size < PLAIN[1] or not (unit == "kg" or unit.startswith(PREFIXED)):
        return 0, unit
    own = 3 if unit == "kg" else 0
    power = max(min(3 * floor(log10(size * (1 + 1e-12)) / 3) + own, 9), -9)
    if unit == "kg":
        power = min(power, 3)
        return power - own, f"{PREFIXES[power]}g"
    return power, f"{PREFIXES[power]}{unit}"


def _number(value: float | None, power: int, digits: int) -> str:
    if value is None:
        return "none"
    if abs(value) == inf:
        return "∞" if value > 0 else "−∞"
    scaled = float(f"{value / 10.0**power:.{digits}g}") if abs(value) >= NOTHING else 0.0
    if scaled and not 1e-3 <= abs(scaled) < 1e6:
        mantissa, _, exponent = f"{scaled:.{digits - 1}e}".partition("e")
        return f"{float(mantissa):g} × 10{raised(int(exponent))}".replace("-", "−")
    return f"{scaled:.10g}".replace("-", "−")


def limit(value: float | None, unit: str = "", digits: int = DIGITS, *, up: bool = False) -> Quantity:
    """Return a limit as `quantity` does, rounded to the safe side: up if smaller ones would be better, else down."""
    if value is None or not isfinite(value):
        return quantity(value, unit, digits)
    near = value + (-SAME if up else SAME) * abs(value)  # what equals a round number but for an error of floats stays
    rounding = Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR)
    return quantity(float(rounding.create_decimal_from_float(near)), unit, digits)


def in_place(value: float | None, hz: float | None, *, up: bool = False) -> str:
    """Return an extremum, rounded to the safe side, and its frequency; without one it is the limit for high ones."""
    where = "where ω → ∞" if hz is None else f"at {quantity(hz, 'Hz')}"
    return f"{limit(value, up=up)} {where}"


def tick(value: float) -> str:
    """Return the text at a tick of an axis. Very large and very small powers of ten are written as powers."""
    power = round(log10(value)) if value > 0 else 0
    if value > 0 and abs(value / 10.0**power - 1) < 1e-9 and not -3 < power < 4:
        return f"10{raised(power)}"
    return _number(value, 0, DIGITS)


def raised(exponent: int) -> str:
    """Return an exponent in superscript figures."""
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def spaced(unit: str) -> str:
    """Return a unit with thin spaces and superscript exponents."""
    return {"deg": "°"}.get(unit, re.sub(r"(?<=[a-z])2\b", "²", unit).replace(" ", THIN))


def plain(text: str) -> str:
    """Return a sentence with typographic signs; its numbers keep their digits."""
    for sign, put in SIGNS.items():
        text = re.sub(sign, put, text)
    return text


def html(text: str) -> str:
    """Return a sentence as escaped HTML, with symbols in italics and subscripts."""
    words = SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", escape(plain(text), quote=False))
    return re.sub("`([^`]+)`", r"<code>\1</code>", words)


def svg_texts(svg: str) -> str:
    """Return an SVG whose texts have subscripts and typographic signs."""
    lowered = '\\1<tspan dy=".25em" font-size="72%">\\2</tspan><tspan dy="-.18em">\u200b</tspan>'

    def typeset(found: re.Match[str]) -> str:
        return f"{found[1]}{SYMBOL.sub(lowered, escape(plain(unescape(found[2])), quote=False))}{found[3]}"

    return re.sub(r"(<text[^>]*>)([^<]*)(</text>)", typeset, svg)


def templates(put: Callable[[str], str] = lambda text: text) -> Environment:
    """Return Jinja's environment of the pages' templates, with its filters for numbers and mathematics."""
    escaped = select_autoescape(("html.j2",))
    found = Environment(
        loader=PackageLoader("vctune", "report"), autoescape=escaped, undefined=StrictUndefined, trim_blocks=True
    )
    found.filters |= {
        "math": lambda text: Markup(html(put(text))),
        "amount": lambda value, unit="", digits=DIGITS: "" if value is None else str(quantity(value, unit, digits)),
        "limit": limit,
        "plain": text,
    }
    return found


def words(name: str, *of: Any) -> str:
    """Return a sentence of words.txt.j2 about something, by its name."""
    made = getattr(templates().get_template("words.txt.j2").module, name)(*of)
    return re.sub(r"[ \n]+", " ", made).strip()  # a thin space stays
