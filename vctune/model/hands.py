"""The hand at the handle: a least operator, a hand, and every hand of a box. SI units."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import Units


@dataclass(frozen=True, slots=True)
class LeastOperator:
    """The least impedance Z_h = mass s + damping of the hand that is always at the handle.

    Attributes
    ----------
    mass : m_h, kg, >= 0
    damping : b_h, N s/m, >= 0
    """

    mass: Number
    damping: Number


@dataclass(frozen=True, slots=True)
class Hand:
    """A hand at the handle, mass s + damping + stiffness/s (model/README.md, section 14).

    Attributes
    ----------
    mass : M, kg, >= 0
    damping : B, N s/m, >= 0
    stiffness : K, N/m, >= 0
    """

    mass: Number
    damping: Number
    stiffness: Number

    def in_words(self, units: Units) -> str:
        """Return its numbers with their units."""
        mass, damping, stiffness = (float(f"{number:.4g}") for number in (self.mass, self.damping, self.stiffness))
        return f"{mass:g} {units.mass}, {damping:g} {units.damping}, {stiffness:g} {units.stiffness}"

    def in_units(self, impedance: float, time: float) -> Hand:
        """Return the hand in other units of impedance and time.

        Parameters
        ----------
        impedance : the new unit of impedance, N s/m, > 0
        time : the new unit of time, s, > 0

        Returns
        -------
        Hand
            M in impedance times time, B in impedance, K in impedance over time.
        """
        return Hand(self.mass / (impedance * time), self.damping / impedance, self.stiffness * time / impedance)


HAND = ("operator.mass", "operator.damping", "operator.stiffness")
"""The numbers of a hand by their keys in a problem file, in the order of `Hand`."""


@dataclass(frozen=True, slots=True)
class Hands:
    """Every hand of a box.

    Attributes
    ----------
    low, high : its least and its greatest numbers
    """

    low: Hand
    high: Hand

    def in_words(self, units: Units) -> str:
        """Return the box with its units."""
        (m, b, k), (M, B, K) = ((hand.mass, hand.damping, hand.stiffness) for hand in (self.low, self.high))
        return f"{m:g} to {M:g} {units.mass}, {b:g} to {B:g} {units.damping}, {k:g} to {K:g} {units.stiffness}"

    @property
    def middle(self) -> Hand:
        """The hand in the middle of the box."""
        low, high = self.low, self.high
        return Hand(
            0.5 * (low.mass + high.mass), 0.5 * (low.damping + high.damping), 0.5 * (low.stiffness + high.stiffness)
        )

    def in_units(self, impedance: float, time: float) -> Hands:
        """Return the box of hands in other units of impedance and time.

        Parameters
        ----------
        impedance : the new unit of impedance, N s/m, > 0
        time : the new unit of time, s, > 0

        Returns
        -------
        Hands
            Both ends of the box, converted by `Hand.in_units`.
        """
        return Hands(self.low.in_units(impedance, time), self.high.in_units(impedance, time))
