"""Define the record of what the hand feels of a design."""

from __future__ import annotations

from collections.abc import Iterator

from vctune.document.records.part import Number, Part, Row, text
from vctune.model.numbers.units import Units

GRAMS = 0.1  # Mass below which a mass is told in grams, kg
RENDERED = 0.1  # Greatest relative difference of the felt stiffness of a wall that is rendered from the stated one


class FreeRecord(Part):
    """The mass and the damping of free motion at `hz`: of a design, and of the bare device, which a servo lacks."""

    hz: float
    mass: float
    damping: float
    bare_mass: Number = None
    bare_damping: Number = None


class WallRecord(Part):
    """The stiffness that the hand feels at `hz` of the stiffest wall, and that wall's own."""

    hz: float
    felt: float
    stated: float

    @property
    def rendered(self) -> bool:
        """Whether the hand feels about the stated stiffness; a proof of stability does not say so."""
        return abs(self.felt - self.stated) <= RENDERED * self.stated


class InHandRecord(Part):
    """What the hand feels, by the frequency model in double precision; null for what does not exist."""

    limp: bool = False  # whether K_p holds no static force: its spring is nothing in the transparency band
    free: FreeRecord | None = None
    wall: WallRecord | None = None
    count: Number = None  # force of one count of the encoder, N

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield free motion, the stiffest wall and the force of a count."""
        if (free := self.free) is not None:
            moves = f"and {text(free.damping, 2)} {units.damping} at {text(free.hz)} Hz"
            bare = "" if free.bare_mass is None else f"; the bare device {_weighed(free.bare_mass, units)}"
            value, _, unit = _weighed(free.mass, units).partition(" ")
            yield Row("feels like", value, f"{unit} {moves}{bare}")
        if (wall := self.wall) is not None:
            share = f"{100 * RENDERED:g} %"
            verdict = f"rendered to {share}" if wall.rendered else f"stable, but not rendered to {share}"
            stated = f"of the wall of {text(wall.stated)} {units.stiffness} at {text(wall.hz)} Hz: {verdict}"
            yield Row("stiffest wall felt", text(wall.felt, 4), f"{units.stiffness} {stated}")
        if self.count is not None:
            yield Row("count of the encoder", text(self.count, 3), f"{units.force} without filters, in its sample")


def _weighed(mass: float, units: Units) -> str:
    """Return a mass with its unit, a light one in grams."""
    if units.mass == "kg" and abs(mass) < GRAMS:
        return f"{text(1e3 * mass, 2)} g"
    return f"{text(mass, 2)} {units.mass}"
