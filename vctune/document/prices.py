"""The record of what a better device would be worth: a row for each of its numbers."""

from __future__ import annotations

from vctune.document.part import Number, Part, text
from vctune.document.units import unit_of
from vctune.model.units import Units

NO_DIFFERENCE = 5e-4
"""Share of the error below which a change of it is none. The search tells basins apart to 1e-3, twice that; half shows
the fourth digit of what nobody will feel."""


class PriceRecord(Part):
    """What a better number of the device is worth: the error of the design that there is then, and its change."""

    key: str
    old: float
    new: Number
    error: Number
    change: Number

    @property
    def worth(self) -> str:
        """What the better number does to the error, in words."""
        if self.new is None:
            return "not tried: the others took too long"
        if self.error is None or self.change is None:
            return "no design found"
        if abs(self.change) < NO_DIFFERENCE:
            return "no difference"
        return f"{100 * self.change:+.1f} %"

    def cells(self, units: Units) -> tuple[str, str, str, str]:
        """Return the value, a better one, their unit, the error then."""
        new, error = ("" if number is None else text(number, 4) for number in (self.new, self.error))
        return text(self.old, 4), new, unit_of(tuple(self.key.split(".")), units), error
