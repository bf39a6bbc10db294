"""A start of a local optimisation, and the constraints that it violates."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from vctune.model.gains import AnyCoupling, Gains


class Missed(IntEnum):
    """The gravest demand that a design misses.

    A graver one leaves the lighter without a meaning: an unstable loop has no margins, and where Re(D + Z_h) < 0 no
    coupling will do.
    """

    NOTHING = 0
    COUPLING = 1
    SENSITIVITY = 2
    RESISTANCE = 3
    STABILITY = 4


@dataclass(frozen=True, slots=True)
class Start:
    """A design to polish.

    Attributes
    ----------
    gains, coupling : the design, dimensionless
    error : its transparency error; inf where it misses a demand at the scan's frequencies
    missed : the gravest demand that it misses there
    violation : by how much, comparable among designs that miss the same demand; of `Missed.COUPLING` and
        `Missed.SENSITIVITY` the logarithm of a ratio; 0 where nothing is missed
    """

    gains: Gains
    coupling: AnyCoupling
    error: float
    missed: Missed = Missed.NOTHING
    violation: float = 0.0

    @property
    def admissible(self) -> bool:
        """Whether it meets every demand at the scan's frequencies."""
        return self.missed is Missed.NOTHING

    @property
    def workable(self) -> bool:
        """Whether its loop is stable with Re(D + Z_h) > 0, so that the optimiser's formulas are defined there."""
        return self.missed < Missed.RESISTANCE

    @property
    def rank(self) -> tuple[Missed, float, float]:
        """The order of starts: the violated constraint, the violation, then the error."""
        return self.missed, self.violation, self.error
