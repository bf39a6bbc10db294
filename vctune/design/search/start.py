"""A start of a local optimisation, and the constraints that it violates."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from vctune.model.gains import AnyCoupling, Gains


class Missed(IntEnum):
    """The most serious constraint that a design violates; a greater value is more serious.

    A serious violation makes the lesser ones meaningless: an unstable loop has no margins, and if Re(D + Z_h) < 0, no
    coupling suffices.
    """

    NOTHING = 0
    COUPLING = 1
    SENSITIVITY = 2
    RESISTANCE = 3
    STABILITY = 4


@dataclass(frozen=True, slots=True)
class Start:
    """A design from which the exchange starts a local optimisation.

    Attributes
    ----------
    gains, coupling : the design, dimensionless
    error : its transparency error; inf if it violates a constraint at the scan's frequencies
    missed : the most serious constraint that the design violates at these frequencies
    violation : amount of the violation, comparable among designs that violate the same constraint; for
        `Missed.COUPLING` and `Missed.SENSITIVITY` the logarithm of a ratio; 0 if the design violates no constraint
    corner : corner frequency of the multiplier for walls; None if it is unknown
    """

    gains: Gains
    coupling: AnyCoupling
    error: float
    missed: Missed = Missed.NOTHING
    violation: float = 0.0
    corner: float | None = None

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
