"""Define the record of prices: how much a better device would reduce the least error, one row for each of its
numbers."""

from __future__ import annotations

from vctune.document.records.part import Part, text
from vctune.document.schema.number_units import unit_of
from vctune.model.numbers.units import Units

# Relative change of the error, for a number that improves by 1 %, below which a price counts as zero
NO_DIFFERENCE = 5e-5


class PriceRecord(Part):
    """The price of a parameter of the device: the relative change of the least error, to first order, if this number
    improves."""

    key: str
    old: float
    new: float
    change: float

    @property
    def worth(self) -> str:
        """The effect of improving the number on the error, in words."""
        return "no difference" if abs(self.change) < NO_DIFFERENCE else f"{100 * self.change:+.2f} %"

    def cells(self, units: Units) -> tuple[str, str, str]:
        """Return the value, a better value, and their unit."""
        return text(self.old, 4), text(self.new, 4), unit_of(tuple(self.key.split(".")), units)
