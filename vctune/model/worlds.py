"""The environments that a device renders: every environment of a box. SI units (model/README.md, section 18)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from math import inf

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import Units


@dataclass(frozen=True, slots=True)
class World:
    """A virtual environment, mass s + damping + stiffness/s, as the firmware runs it.

    Attributes
    ----------
    mass : m, kg, >= 0; inf for one without limit
    damping : b, N s/m, >= 0
    stiffness : k, N/m, >= 0; inf for one without limit
    """

    mass: Number
    damping: Number
    stiffness: Number

    def in_units(self, impedance: float, time: float) -> World:
        """Return the environment with impedances in units of `impedance` [N s/m] and times in units of `time` [s].

        Parameters
        ----------
        impedance : N s/m, > 0
        time : s, > 0
        """
        return World(self.mass / (impedance * time), self.damping / impedance, self.stiffness * time / impedance)


@dataclass(frozen=True, slots=True)
class Worlds:
    """Every environment of a box; the damping has no upper limit.

    Attributes
    ----------
    low, high : its least and its greatest numbers; `high.damping` is inf
    """

    low: World
    high: World

    def in_words(self, units: Units) -> str:
        """Return the box with its units, without limits that exclude nothing."""
        ranges = [
            _range(low, high, unit)
            for low, high, unit in (
                (self.low.mass, self.high.mass, units.mass),
                (self.low.damping, self.high.damping, units.damping),
                (self.low.stiffness, self.high.stiffness, units.stiffness),
            )
        ]
        return ", ".join(each for each in ranges if each) or "any mass, damping and stiffness"

    def in_units(self, impedance: float, time: float) -> Worlds:
        """Return the same environments with impedances in units of `impedance` [N s/m] and times in `time` [s].

        Parameters
        ----------
        impedance : N s/m, > 0
        time : s, > 0
        """
        return Worlds(self.low.in_units(impedance, time), self.high.in_units(impedance, time))

    def converted(self, number: Callable[[float], Number]) -> Worlds:
        """Return the same environments with finite numbers of another arithmetic."""
        low, high = (
            World(*(each if each == inf else number(each) for each in astuple(end))) for end in (self.low, self.high)
        )
        return Worlds(low, high)


EVERY_WORLD = Worlds(World(0.0, 0.0, 0.0), World(inf, inf, inf))
"""Every environment that is passive as it runs."""


def _range(low: Number, high: Number, unit: str) -> str:
    if high < inf:
        return f"up to {high:g} {unit}" if low == 0 < high else f"{low:g} to {high:g} {unit}"
    return f"at least {low:g} {unit}" if low > 0 else ""


@dataclass(frozen=True, slots=True)
class WorldsMet:
    """The environments that a design has to bear with a reserve.

    Attributes
    ----------
    worlds : the box
    factor : g >= 1: the coupling divided by any number from 1 to g has to bear them too
    """

    worlds: Worlds
    factor: Number
