"""Define the least operator, a hand at the handle, and a box of hands. SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from decimal import Decimal
from itertools import product
from typing import Any

import numpy as np

from vctune.model.fields import Real, record
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import Units, in_full


@dataclass(frozen=True, slots=True)
class LeastOperator:
    """The least operator: the impedance Z_h = mass s + damping that every hand at the handle includes.

    Attributes
    ----------
    mass : Number
        m_h, kg, >= 0.
    damping : Number
        b_h, N s/m, >= 0.
    """

    mass: Number
    damping: Number

    def in_words(self, units: Units) -> str:
        """Return "at least ..." with the parameters that are not 0."""
        parts = ((self.mass, units.mass), (self.damping, units.damping))
        return f"at least {' and '.join(f'{in_full(number)} {unit}' for number, unit in parts if number)}"


def passive_hand(least: LeastOperator | None, units: Units) -> str:
    """Return "any passive hand", with what the proof counts on in every hand."""
    return "any passive hand" if least is None else f"any passive hand of {least.in_words(units)}"


@record
class Hand:
    """A hand at the handle, mass s + damping + stiffness/s (model/README.md, section 14).

    All three are at least 0.
    """

    mass: Real
    damping: Real
    stiffness: Real

    @property
    def numbers(self) -> dict[str, Number]:
        """The hand's parameters by their names."""
        return {name: getattr(self, name) for name in NAMES}

    @property
    def by_key(self) -> dict[str, Number]:
        """The hand's parameters by their keys in a problem file."""
        return {key: getattr(self, name) for key, name in zip(HAND, NAMES, strict=True)}

    @classmethod
    def of(cls, values: Mapping[str, Number]) -> Hand:
        """Return the hand whose parameters a mapping states under their keys in a problem file."""
        return cls(**{name: values[key] for key, name in zip(HAND, NAMES, strict=True)})

    def mapped(self, of: Callable[..., Number], *others: Hand) -> Hand:
        """Return the hand that results from applying a function to each number of this hand and the corresponding
        numbers of the others.

        Parameters
        ----------
        of : Callable[..., Number]
            Function of one number from this hand and one from each of the others.
        others : Hand
            Hands for the further arguments of the function.
        """
        return Hand(**{name: of(*(getattr(hand, name) for hand in (self, *others))) for name in NAMES})

    def in_words(self, units: Units) -> str:
        """Return the hand's parameters with their units."""
        return ", ".join(
            f"{float(f'{number:.4g}'):g} {units.of(QUANTITIES[name])}" for name, number in self.numbers.items()
        )

    def in_units(self, impedance: float, time: float) -> Hand:
        """Return the hand in other units of impedance and time.

        Parameters
        ----------
        impedance : float
            The new unit of impedance, N s/m, > 0.
        time : float
            The new unit of time, s, > 0.

        Returns
        -------
        Hand
            M in units of impedance times time, B in units of impedance, K in units of impedance over time.
        """
        new = {
            "mass": lambda number: number / (impedance * time),
            "damping": lambda number: number / impedance,
            "stiffness": lambda number: number * time / impedance,
        }
        return Hand(**{name: new[QUANTITIES[name]](number) for name, number in self.numbers.items()})


NAMES = tuple(field.name for field in fields(Hand))  # Names of a hand's parameters
# Quantity of each parameter of a hand; the quantity determines the unit
QUANTITIES = {field.name: field.metadata.get("quantity", field.name) for field in fields(Hand)}
HAND = tuple(f"operator.{name}" for name in NAMES)  # Keys of a hand's parameters in a problem file
# Keys of the mass and the stiffness, which determine where a hand resonates
MASS, STIFFNESS = "operator.mass", "operator.stiffness"


@dataclass(frozen=True, slots=True)
class Hands:
    """A box of hands: all hands whose numbers lie between two limits."""

    low: Hand  # the hands with the least and with the greatest numbers
    high: Hand
    tool: Hands | None = None  # the tools of which every hand includes one; they have no stiffness

    def in_words(self, units: Units) -> str:
        """Return the box in words with units. The text omits numbers that are 0 in all hands of the box."""
        known = [(name, *ends) for name, ends in self.ranges.items() if ends[1] > 0]
        if not known or self.low == self.high:
            parts = self.low.numbers.items()
            text = ", ".join(f"{in_full(number)} {units.of(QUANTITIES[name])}" for name, number in parts)
        else:
            each = (f"{in_full(low)} to {in_full(high)} {units.of(QUANTITIES[name])}" for name, low, high in known)
            text = ", ".join(each)
        return text if self.tool is None else f"{text}, {self.tool.as_tool(units)} included"

    def as_tool(self, units: Units) -> str:
        """Return a tool in words."""
        ends = [(name, *pair) for name, pair in self.ranges.items() if pair[1] > 0]
        parts = (
            f"{in_full(high) if low == high else f'{in_full(low)} to {in_full(high)}'} {units.of(QUANTITIES[name])}"
            for name, low, high in ends
        )
        return f"the tool of {' and '.join(parts)}"

    def with_tool(self, tool: Hands | None) -> Hands:
        """Return the box in which every hand includes a tool; the sums are those of the decimals that a file states."""
        if tool is None:
            return self
        low, high = self.low.mapped(_sum, tool.low), self.high.mapped(_sum, tool.high)
        return Hands(low, high, tool)

    @property
    def held(self) -> Hands:
        """The box without its tool."""
        if self.tool is None:
            return self
        return Hands(self.low.mapped(_difference, self.tool.low), self.high.mapped(_difference, self.tool.high))

    @property
    def ranges(self) -> dict[str, tuple[Number, Number]]:
        """The least and the greatest value of each parameter, by the parameter's name."""
        return {name: (getattr(self.low, name), getattr(self.high, name)) for name in NAMES}

    @property
    def corners(self) -> list[Hand]:
        """The hands at the vertices of the box, without duplicates."""
        ends = (sorted(set(pair)) for pair in self.ranges.values())
        return [Hand(**dict(zip(NAMES, corner, strict=True))) for corner in product(*ends)]

    @property
    def middle(self) -> Hand:
        """The hand at the centre of the box."""
        return self.low.mapped(lambda low, high: 0.5 * (low + high), self.high)

    def in_units(self, impedance: float, time: float) -> Hands:
        """Return the box of hands in other units of impedance and time."""
        tool = self.tool and self.tool.in_units(impedance, time)
        return Hands(self.low.in_units(impedance, time), self.high.in_units(impedance, time), tool)


def _sum(a: Number, b: Number) -> float:
    return float(Decimal(repr(float(a))) + Decimal(repr(float(b))))


def _difference(a: Number, b: Number) -> float:
    return float(Decimal(repr(float(a))) - Decimal(repr(float(b))))


def hands_as_one(hands: Sequence[Hand], shape: tuple[int, ...] = (-1,)) -> Hand:
    """Return several hands as one hand whose numbers are arrays."""
    each = {name: np.array([getattr(hand, name) for hand in hands], float).reshape(shape) for name in NAMES}
    return Hand(**each)


@dataclass(frozen=True, slots=True)
class PlacesInHands:
    """Frequencies or angles, each paired with a hand, as arrays of one shape."""

    at: Any  # omega, rad/s, or theta = omega T, rad
    hands: Hand  # hand whose numbers are arrays of the same shape

    def __len__(self) -> int:
        return int(self.at.shape[-1])

    def mapped(self, of: Callable[..., Any], *others: PlacesInHands) -> PlacesInHands:
        """Apply a function to `at` and to each number of the hands, and return the results as places."""
        hands = self.hands.mapped(of, *(each.hands for each in others))
        return PlacesInHands(of(self.at, *(each.at for each in others)), hands)

    def __getitem__(self, index: Any) -> PlacesInHands:
        return self.mapped(lambda numbers: numbers[index])

    def joined(self, *more: PlacesInHands) -> PlacesInHands:
        """Return these places, followed by other places."""
        return self.mapped(lambda *each: np.concatenate(each, axis=-1), *more)

    @property
    def unique(self) -> PlacesInHands:
        """The places of shape (n,) without duplicates, sorted by `at` and then by the numbers of the hands."""
        rows = np.unique(np.vstack((self.at, *self.hands.numbers.values())), axis=1)
        at, *numbers = rows
        return PlacesInHands(at, Hand(*numbers))

    @classmethod
    def of(cls, places: Sequence[tuple[float, Hand]]) -> PlacesInHands:
        """Return places of shape (n,), made from n pairs (frequency or angle, hand)."""
        return cls(np.array([at for at, _ in places], float), hands_as_one([hand for _, hand in places]))
