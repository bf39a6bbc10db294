"""Define a box of the environments that a device renders. SI units (model/README.md, section 18)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, replace
from itertools import product
from math import inf
from typing import Any

from vctune.model.hands import PlacesInHands
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import Units, in_full

WORLD = ("environment.mass", "environment.damping", "environment.stiffness")  # Keys of an environment's parameters
OVER_LIMIT = "Z_c over its limit"  # name of the number by which a coupling may be divided before something fails


@dataclass(frozen=True, slots=True)
class World:
    """A virtual environment, mass s + damping + stiffness/s, in its discrete form."""

    mass: Number  # m, kg, >= 0; inf for no limit
    damping: Number  # b, N s/m, >= 0; inf for no limit
    stiffness: Number  # k, N/m, >= 0; inf for no limit

    def in_words(self, units: Units) -> str:
        """Return the parameters that are not 0, with units; "nothing" without any."""
        parts = ((self.mass, units.mass), (self.damping, units.damping), (self.stiffness, units.stiffness))
        return ", ".join(f"{in_full(number)} {unit}" for number, unit in parts if number) or "nothing"

    @property
    def by_key(self) -> dict[str, Number]:
        """The parameters by their keys in a problem file."""
        return dict(zip(WORLD, astuple(self), strict=True))

    @classmethod
    def of(cls, values: Mapping[str, Number]) -> World:
        """Return the environment whose parameters a mapping states under their keys."""
        return cls(*(values[key] for key in WORLD))

    def in_units(self, impedance: float, time: float) -> World:
        """Return the environment in other units of impedance and time."""
        return World(self.mass / (impedance * time), self.damping / impedance, self.stiffness * time / impedance)


@dataclass(frozen=True, slots=True)
class Worlds:
    """A box of environments: all environments whose numbers lie between two limits."""

    low: World  # the environments with the least and with the greatest numbers
    high: World
    walls: bool = False
    corner: Number | None = None

    @property
    def linear(self) -> Worlds:
        """The same environments without walls."""
        return replace(self, walls=False, corner=None)

    @property
    def exact(self) -> bool:
        """Whether all environments of the box have one mass and one stiffness."""
        return bool(self.low.mass == self.high.mass and self.low.stiffness == self.high.stiffness)

    @property
    def nothing(self) -> bool:
        """Whether there is no mass and no spring in the box, but perhaps a damper."""
        return bool(self.high.mass == 0 == self.high.stiffness)

    @property
    def least_damped(self) -> list[World]:
        """The environments with the least and the greatest mass and stiffness, at the least damping."""
        low, high = self.low, self.high
        ends = product((low.mass, high.mass), (low.stiffness, high.stiffness))
        return list(dict.fromkeys(World(mass, low.damping, stiffness) for mass, stiffness in ends))

    def in_words(self, units: Units) -> str:
        """Return "every environment of ..." with units. The text omits limits that exclude nothing."""
        if self.exact and self.high.mass == 0 == self.low.damping:
            spring = f"its spring of {in_full(self.high.stiffness)} {units.stiffness} and"
            own = spring if self.high.stiffness else "nothing or"
            return f"{own} any damper behind it"
        ranges = [
            _range(low, high, unit)
            for low, high, unit in (
                (self.low.mass, self.high.mass, units.mass),
                (self.low.damping, self.high.damping, units.damping),
                (self.low.stiffness, self.high.stiffness, units.stiffness),
            )
        ]
        stated = ", ".join(each for each in ranges if each) or "any mass, damping and stiffness"
        return f"every environment of {stated}{', walls among them' if self.walls else ''}"

    def in_units(self, impedance: float, time: float) -> Worlds:
        """Return the same environments in other units of impedance and time."""
        corner = None if self.corner is None else self.corner * time
        return replace(
            self, low=self.low.in_units(impedance, time), high=self.high.in_units(impedance, time), corner=corner
        )

    def converted(self, number: Callable[[float], Number]) -> Worlds:
        """Return these environments with their finite numbers in another arithmetic."""
        low, high = (
            World(*(each if each == inf else number(each) for each in astuple(end))) for end in (self.low, self.high)
        )
        return replace(self, low=low, high=high, corner=None if self.corner is None else number(self.corner))


# All environments that are passive in their discrete form
EVERY_WORLD = Worlds(World(0.0, 0.0, 0.0), World(inf, inf, inf))


def _range(low: Number, high: Number, unit: str) -> str:
    if low == high:
        return f"{in_full(low)} {unit}"
    if high < inf:
        return f"up to {in_full(high)} {unit}" if low == 0 < high else f"{in_full(low)} to {in_full(high)} {unit}"
    return f"at least {in_full(low)} {unit}" if low > 0 else ""


@dataclass(frozen=True, slots=True)
class WorldsMet:
    """The environments that a design must render stably with a safety factor."""

    worlds: Worlds  # the box of environments
    factor: Number  # safety factor g >= 1; the coupling divided by any number from 1 to g must also render them stably


@dataclass(frozen=True, slots=True)
class PlacesInWorlds:
    """Some angles for each of n owners, each in a hand with an environment: arrays of shape (n, places)."""

    in_hands: PlacesInHands
    worlds: World  # environment whose numbers are arrays of the same shape

    def __getitem__(self, index: Any) -> PlacesInWorlds:
        return PlacesInWorlds(self.in_hands[index], World(*(number[index] for number in astuple(self.worlds))))

    @property
    def each(self) -> list[PlacesInWorlds]:
        """The first place of every owner, the second, and so on, in arrays of shape (n,)."""
        return [self[:, k] for k in range(self.in_hands.at.shape[1])]
