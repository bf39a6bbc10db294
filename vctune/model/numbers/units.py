"""Define the names and units of a device's parameters, for a linear and for a rotary handle, and the keys of the
design variables in a problem file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from math import inf, pi
from types import MappingProxyType
from typing import Literal


def in_full(number: float) -> str:
    """Return a number of a proved range with all its digits: rounded, the range might be wider than what is proved."""
    return repr(float(number)).removesuffix(".0")


def narrowed(low: float, high: float) -> tuple[str, str]:
    """Return the edges of a proved band with six digits, each rounded inwards."""
    up, down = Context(6, ROUND_CEILING), Context(6, ROUND_FLOOR)
    return f"{float(up.create_decimal(repr(low))):g}", f"{float(down.create_decimal(repr(high))):g}"


def hertz(omega: float) -> float:
    """Return an angular frequency in hertz."""
    return float(f"{omega / (2 * pi):.12g}")


def finite_hertz(omega: float | None) -> float | None:
    """Return a frequency in hertz, or None if it is infinite or None."""
    return None if omega is None or omega == inf else hertz(omega)


UnitSystem = Literal["linear", "rotary"]  # Motion of the handle: along a line, or about an axis


@dataclass(frozen=True, slots=True)
class Units:
    """The units of all quantities, and the names of mass and force."""

    mass_name: str  # names of mass and force
    force_name: str
    mass: str  # units of mass, of K_v and b_c, of K_p and k_c, and of a PID's integral gain
    damping: str
    stiffness: str
    integral_gain: str
    mobility: str  # units of the reciprocals of damping and stiffness
    compliance: str
    force: str  # units of signals
    position: str
    position_integral: str
    speed: str
    time: str = "s"  # units of time and frequency
    frequency: str = "Hz"

    @property
    def acceleration(self) -> str:
        """The unit of an acceleration, such as "m/s2"."""
        return f"{self.speed}2"

    def of(self, quantity: str) -> str:
        """Return the unit of a quantity by its name. The quantity "" has the unit ""."""
        unit: str = getattr(self, quantity) if quantity else ""
        return unit

    def translated(self, text: str) -> str:
        """Return a text about a linear device in the words and units of this device."""
        if self == LINEAR:
            return text
        return UNIT.sub(lambda found: SAME[found[0]], WORD.sub(self._called, text))

    def _called(self, found: re.Match[str]) -> str:
        article, word, plural = found[1] or "", found[2], found[3] or ""
        called = self.mass_name if word.lower() == "mass" else self.force_name
        vowel = called[0] in "aeiou"
        article = article.replace("a ", "an ").replace("A ", "An ") if vowel and article in ("a ", "A ") else article
        return article + (called.capitalize() if word[0].isupper() else called) + ("s" if plural else "")


LINEAR = Units(
    mass_name="mass",
    force_name="force",
    mass="kg",
    damping="N s/m",
    stiffness="N/m",
    integral_gain="N/(m s)",
    mobility="m/(N s)",
    compliance="m/N",
    force="N",
    position="m",
    position_integral="m s",
    speed="m/s",
)
ROTARY = Units(
    mass_name="inertia",
    force_name="torque",
    mass="kg m2",
    damping="N m s/rad",
    stiffness="N m/rad",
    integral_gain="N m/(rad s)",
    mobility="rad/(N m s)",
    compliance="rad/(N m)",
    force="N m",
    position="rad",
    position_integral="rad s",
    speed="rad/s",
)
# Quantities whose units depend on the motion of the handle
QUANTITIES = tuple(
    each.name for each in fields(Units) if each.name not in ("mass_name", "force_name", "time", "frequency")
)
UNITS: Mapping[UnitSystem, Units] = MappingProxyType({"linear": LINEAR, "rotary": ROTARY})
# Words to translate, with their articles
WORD = re.compile(r"(?<![.\w])([Aa] )?(mass|force)(es|s)?\b(?! /)", re.IGNORECASE)
SAME = {LINEAR.of(quantity): ROTARY.of(quantity) for quantity in QUANTITIES}
# Matches a unit in a description: at the beginning or after a comma, up to a period, a comma, a semicolon or the end
UNIT = re.compile(rf"(?:(?<=, )|^)({'|'.join(map(re.escape, sorted(SAME, key=len, reverse=True)))})(?=[.;,]|$)")


# Keys of K_v, K_p, b_c, m_c and b_0, the design variables of an admittance display and of a servo, whose K_v and K_p
# are 0
KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")
# Keys of K_v, K_p (which is 0), b_c and k_c, the design variables of an impedance display
SPRING_KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.stiffness")
SYMBOLS = dict(zip(KEYS, ("K_v", "K_p", "b_c", "m_c", "b_0"), strict=True)) | {SPRING_KEYS[3]: "k_c"}
# Symbol of each design variable in equations, and its quantity (`vctune.model.numbers.units`)
OF_KEYS = dict(zip(KEYS, ("damping", "stiffness", "damping", "mass", "damping"), strict=True)) | {
    SPRING_KEYS[3]: "stiffness"
}


def keys_of(count: int) -> tuple[str, ...]:
    """Return the keys of a design that has this many numbers: `KEYS` for five numbers, `SPRING_KEYS` for four."""
    return KEYS if count == len(KEYS) else SPRING_KEYS
