"""A start of a local optimisation, and the constraints that it violates."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from vctune.model.gains import AnyCoupling, Gains


class Missed(IntEnum):
    """The most serious constraint that a design violates; a greater value is more serious."""

    NOTHING = 0
    COUPLING = 1
    SENSITIVITY = 2
    RESISTANCE = 3
    STABILITY = 4


@dataclass(frozen=True, slots=True)
class Start:
    """A design from which the exchange starts a local optimisation."""

    gains: Gains  # the design, dimensionless
    coupling: AnyCoupling
    error: float  # its transparency error; inf if it violates a constraint at the scan's frequencies
    missed: Missed = Missed.NOTHING  # the most serious constraint that the design violates at these frequencies
    violation: float = 0.0  # amount of the violation, comparable among designs that violate the same constraint
    corner: float | None = None  # corner frequency of the multiplier for walls; None if it is unknown

    @property
    def admissible(self) -> bool:
        """Whether the design meets every constraint at the scan's frequencies."""
        return self.missed is Missed.NOTHING

    @property
    def workable(self) -> bool:
        """Whether the loop is stable and Re(D + Z_h) > 0, so that the formulas of the NLP are defined."""
        return self.missed < Missed.RESISTANCE

    @property
    def rank(self) -> tuple[Missed, float, float]:
        """Sort key of starts: the violated constraint, the violation, then the error."""
        return self.missed, self.violation, self.error
