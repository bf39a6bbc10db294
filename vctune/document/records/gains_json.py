"""Define the records that several documents share: the problem, gains, coupling, and the transparency error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from math import inf
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from vctune.document.records.part import DisplayPart, Number, Part, Row, Shown, filled, how_shown
from vctune.model.device import Device
from vctune.model.display import DISPLAYS, DisplayName
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.numbers.units import Units, UnitSystem
from vctune.model.transparency import TERMS, TermName

NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


class ProblemRecord(Part):
    """The problem: its name, its digest, the text of its file, and the motion of its device."""

    name: str
    sha256: str
    text: str
    units: UnitSystem = "linear"


def stated_units(device: Device) -> dict[str, UnitSystem]:
    """Return the motion that a record states; empty for a linear device."""
    return {} if device.units == "linear" else {"units": device.units}


class GainsRecord(Part):
    """Gains of the velocity loop. Both are 0 for a servo, and K_p is 0 for an impedance display."""

    velocity: Annotated[NotNegative, Shown("velocity K_v", digits=8, of="damping")]
    position: Annotated[NotNegative, Shown("position K_p", digits=8, of="stiffness")]

    @property
    def plain(self) -> Gains:
        """The gains."""
        return Gains(self.velocity, self.position)


class CouplingRecord(Part):
    """The virtual coupling of an admittance display or a servo. An infinite b_c is null."""

    damping: Annotated[Positive | None, Shown("damping b_c", digits=8, of="damping")]
    mass: Annotated[Positive, Shown("mass m_c", digits=8, of="mass")]
    drag: Annotated[NotNegative, Shown("drag b_0", digits=8, of="damping")] = 0.0

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the numbers of the coupling. An infinite damping is called rigid."""
        damping, *others = super().rows(units)
        yield damping if self.damping is not None else Row(damping.label, "rigid", "")
        yield from others

    @property
    def plain(self) -> AnyCoupling:
        """The coupling."""
        return Coupling(inf if self.damping is None else self.damping, self.mass, self.drag)


class SpringRecord(Part):
    """The virtual coupling of an impedance display."""

    damping: Annotated[NotNegative, Shown("damping b_c", digits=8, of="damping")]
    stiffness: Annotated[Positive, Shown("stiffness k_c", digits=8, of="stiffness")]

    @property
    def plain(self) -> SpringDamper:
        """The coupling."""
        return SpringDamper(self.damping, self.stiffness)


def coupling_tag(value: Any) -> str:
    """Return the tag of a coupling, given as tables or as a record."""
    stiff = "stiffness" in value if isinstance(value, dict) else isinstance(value, SpringRecord)
    return "<spring>" if stiff else "<mass>"


AnyCouplingRecord = Annotated[
    Annotated[CouplingRecord, Tag("<mass>")] | Annotated[SpringRecord, Tag("<spring>")], Discriminator(coupling_tag)
]


def coupling_record(coupling: AnyCoupling) -> CouplingRecord | SpringRecord:
    """Return the record of a coupling."""
    if isinstance(coupling, SpringDamper):
        return SpringRecord(**asdict(coupling))
    return CouplingRecord(**asdict(coupling) | ({"damping": None} if coupling.rigid else {}))


def term_labels(display: DisplayName) -> dict[TermName, str]:
    """Return the label of each error term: of free motion, of the commanded motion or force, and of the coupling."""
    if display == "impedance":
        return {"admittance": "|1/G_hh|/Z_0", "tracking": "|1 - A H/N|", "coupling": "Z_0 |1/Z_c|"}
    return {"admittance": "|Z_0 G_hh|", "tracking": "|1 - G_he|", "coupling": "|Z_c|/Z_0"}


class TransparencyRecord(DisplayPart):
    """The error and its unweighted terms. An impedance display has the dual terms."""

    error: Annotated[Number, Shown("error")]
    admittance: Annotated[Number, Shown("{admittance_label}")]
    tracking: Annotated[Number, Shown("{tracking_label}")]
    coupling: Annotated[Number, Shown("{coupling_label}")]

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield the error and its terms. Terms that are always 0 are left out."""
        absent = {filled(self, shown.label, units) for term, shown in how_shown(type(self)).items()
                  if term in TERMS and term not in DISPLAYS[self.display].terms}  # fmt: skip
        yield from (row for row in super().rows(units) if row.label not in absent)

    @property
    def admittance_label(self) -> str:
        """Label of the error term of free motion."""
        return term_labels(self.display)["admittance"]

    @property
    def tracking_label(self) -> str:
        """Label of the error term of tracking, that is, of the commanded motion or force."""
        return term_labels(self.display)["tracking"]

    @property
    def coupling_label(self) -> str:
        """Label of the error term of the coupling."""
        return term_labels(self.display)["coupling"]
