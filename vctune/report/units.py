"""The units of a page, in one place: those of another kind of device go here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Units:
    """What the numbers of a device are in.

    Attributes
    ----------
    force, mass, damping, mobility, stiffness, speed : of a handle that moves along a line
    """

    force: str = "N"
    mass: str = "kg"
    damping: str = "N s/m"
    mobility: str = "m/(N s)"
    stiffness: str = "N/m"
    speed: str = "m/s"


UNITS = Units()
"""Of every page and figure of a design."""
