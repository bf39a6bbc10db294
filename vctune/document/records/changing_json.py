"""Define the record of the claim about hands whose damping changes, and of the storage function that proves this
claim."""

from __future__ import annotations

from typing import Annotated

from vctune.document.records.part import Pair, Part, Proof, Shown
from vctune.model.hands import Hand, Hands


class StorageRecord(Part):
    """The storage function (k_eq/T) q^2 + zeta' Y zeta, without dimensions (model/README.md, section 21).

    `states` names zeta. Y is a weighted sum of matrices; `terms` states each weight as a function of the hand.
    """

    states: list[str]
    terms: list[str]
    matrices: list[list[list[float]]]


class ChangingRecord(Part):
    """The claim about every hand of a box whose damping takes any value of its range at every sample."""

    verdict: Annotated[Proof, Shown("changing damping", "of hands of {within}, at every sample")]
    box: dict[str, Pair]
    boxes: int
    storage: StorageRecord | None = None

    @property
    def within(self) -> Hands:
        """The box."""
        return Hands(*(Hand(**{name: ends[k] for name, ends in self.box.items()}) for k in (0, 1)))
