"""Define the records of hands whose damping changes, and of the storage functions that prove them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from vctune.document.records.part import Pair, Part, Proof, Row, Shown
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.units import Units


class StorageRecord(Part):
    """The storage function (k_eq/T) q^2 + zeta' Y zeta, without dimensions (model/README.md, section 21)."""

    states: list[str]
    terms: list[str]
    matrices: list[list[list[float]]]
    device: dict[str, Pair] | None = None


class ChangingRecord(Part):
    """The claim about every hand of a box whose damping may take any value in its range at every sample."""

    verdict: Annotated[Proof, Shown("changing damping", "of hands of {within}, at every sample")]
    box: dict[str, Pair]
    boxes: int
    storages: list[StorageRecord] | None = None

    @property
    def within(self) -> Hands:
        """The box."""
        return Hands(*(Hand(**{name: ends[k] for name, ends in self.box.items()}) for k in (0, 1)))


class ExaminedRecord(ChangingRecord):
    """The verdict on such hands for a problem that does not require the claim."""

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the row; "not proved" does not mean that such a hand makes the design unstable."""
        (row,) = super().rows(units)
        if self.verdict == "proved":
            yield row._replace(label="damping")
        else:
            yield Row("damping", "not proved", "the claims are about hands that stay as they are")
