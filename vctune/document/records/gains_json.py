"""Define the records that several documents share: the problem, gains, coupling, and the transparency error."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Discriminator, Tag

from vctune.document.records.part import DisplayPart, Nullable, RecordPart, Row
from vctune.model.device import Device
from vctune.model.display import DISPLAYS, DisplayName
from vctune.model.fields import Shown
from vctune.model.gains import Coupling, SpringDamper
from vctune.model.numbers.units import Units, UnitSystem
from vctune.model.transparency import TERMS, TermName


class ProblemRecord(RecordPart):
    """The problem: its name, its digest, the text of its file, and the motion of its device."""

    name: str
    sha256: str
    text: str
    units: UnitSystem = "linear"
    source: str | None = None  # the file, as the command named it


def stated_units(device: Device) -> dict[str, UnitSystem]:
    """Return the motion that a record states; empty for a linear device."""
    return {} if device.units == "linear" else {"units": device.units}


def coupling_tag(value: Any) -> str:
    """Return the tag of a coupling, given as tables or as a record."""
    stiff = "stiffness" in value if isinstance(value, dict) else isinstance(value, SpringDamper)
    return "<spring>" if stiff else "<mass>"


AnyCouplingRecord = Annotated[
    Annotated[Coupling, Tag("<mass>")] | Annotated[SpringDamper, Tag("<spring>")], Discriminator(coupling_tag)
]


def term_labels(display: DisplayName) -> dict[str, str]:
    """Return the label of each error term: of free motion, of the commanded motion or force, and of the coupling."""
    if display == "impedance":
        return {"admittance": "|1/G_hh|/Z_0", "tracking": "|1 - A H/N|", "coupling": "Z_0 |1/Z_c|"}
    return {"admittance": "|Z_0 G_hh|", "tracking": "|1 - G_he|", "coupling": "|Z_c|/Z_0"}


APART = "of the device itself when free, not counted"  # Note on a term that no design changes


class TransparencyRecord(DisplayPart):
    """The error and its unweighted terms. An impedance display has the dual terms."""

    error: Annotated[Nullable, Shown("error")]
    admittance: Annotated[Nullable, Shown("{labels[admittance]}")]
    tracking: Annotated[Nullable, Shown("{labels[tracking]}")]
    coupling: Annotated[Nullable, Shown("{labels[coupling]}")]
    apart: list[TermName] | None = None  # terms that the error does not count, because no design changes them

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the error and its terms. Terms that are always 0 are left out."""
        for name, row in zip(("error", *TERMS), super().rows(units), strict=True):
            if name == "error" or name in self.terms:
                yield row._replace(unit=APART) if name in (self.apart or ()) else row

    @property
    def terms(self) -> tuple[str, ...]:
        """The terms that are not always 0."""
        return DISPLAYS[self.display].terms

    @property
    def labels(self) -> dict[str, str]:
        """The label of each error term."""
        return term_labels(self.display)
