"""Define the record of what the hand feels of a design."""

from __future__ import annotations

from collections.abc import Iterator

from vctune.document.records.part import Number, Part, Row, text
from vctune.model.numbers.units import Units

GRAMS = 0.1  # Mass below which a mass is told in grams, kg
RENDERED = 0.1  # Greatest difference of the felt stiffness of a rendered wall from the wall's own, relative


class InHandRecord(Part):
    """What the hand feels, by the frequency model in double precision; null for what does not exist."""

    limp: bool = False  # whether K_p holds no static force: its spring is nothing in the transparency band
    mass_1hz: Number = None  # of free motion: with the design, and of the bare device
    damping_1hz: Number = None
    bare_mass_1hz: Number = None
    felt_wall_10hz: Number = None  # stiffness that is felt of the stiffest wall, and its own
    wall: Number = None
    count: Number = None  # force of one count of the encoder, N

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield free motion, the stiffest wall and the force of a count."""
        if self.mass_1hz is not None and self.damping_1hz is not None:
            value, unit = _weighed(self.mass_1hz, units)
            felt, bare = f"{unit} and {_short(self.damping_1hz)} {units.damping} at 1 Hz", self.bare_mass_1hz
            felt += "" if bare is None else f"; the bare device {' '.join(_weighed(bare, units))}"
            yield Row("feels like", value, felt)
        if self.felt_wall_10hz is not None and self.wall is not None:
            rendered = abs(self.felt_wall_10hz - self.wall) <= RENDERED * self.wall
            verdict = f"{'rendered' if rendered else 'stable, but not rendered'} to {100 * RENDERED:g} %"
            stated = f"{units.stiffness} of the wall of {text(self.wall)} {units.stiffness} at 10 Hz: {verdict}"
            yield Row("stiffest wall felt", text(self.felt_wall_10hz, 4), stated)
        if self.count is not None:
            yield Row("count of the encoder", text(self.count, 3), f"{units.force} without filters, in its sample")


def _weighed(mass: float, units: Units) -> tuple[str, str]:
    """Return a mass and its unit, which is g for a light one."""
    light = units.mass == "kg" and abs(mass) < GRAMS
    return _short(1e3 * mass if light else mass), "g" if light else units.mass


def _short(value: float) -> str:
    return f"{float(text(value, 2)):g}"
