"""Boxes of devices: mass, damping and delay known within relative half-widths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from math import nextafter

from vctune.model.problem import Uncertainty
from vctune.model.quantities import Device

UNCERTAIN = ("mass", "damping", "delay")
"""The numbers of a device that may be uncertain."""


@dataclass(frozen=True, slots=True)
class DeviceBox:
    """Every device whose uncertain numbers lie between those of two.

    Attributes
    ----------
    nominal : the device as its numbers say
    low, high : the numbers' least and greatest values; decimals within the box that is meant, to two units in the last
        place
    """

    nominal: Device
    low: Device
    high: Device

    @property
    def uncertain(self) -> tuple[str, ...]:
        """The numbers that are uncertain."""
        return tuple(name for name in UNCERTAIN if getattr(self.low, name) < getattr(self.high, name))

    @property
    def loops(self) -> tuple[DeviceBox, ...]:
        """The boxes of devices whose velocity loops must be stable by themselves, let go and in the operator's hand."""
        parts = zip(self.nominal.loops, self.low.loops, self.high.loops, strict=True)
        return tuple(DeviceBox(*ends) for ends in parts)

    def corners(self) -> list[Device]:
        """Return the devices at the vertices."""
        ends = product(*((getattr(self.low, name), getattr(self.high, name)) for name in self.uncertain))
        return [replace(self.nominal, **dict(zip(self.uncertain, end, strict=True))) for end in ends]

    def devices(self) -> list[Device]:
        """Return the nominal device and those at the vertices."""
        return [self.nominal, *self.corners()]


def device_box(device: Device, uncertainty: Uncertainty) -> DeviceBox:
    """Return the box of devices around one."""
    low, high = (
        replace(
            device,
            mass=_edge(device.mass, sign * uncertainty.mass),
            damping=_edge(device.damping, sign * uncertainty.damping),
            delay=_edge(device.delay, sign * uncertainty.delay),
        )
        for sign in (-1, 1)
    )
    return DeviceBox(device, low, high)


def _edge(value: float, change: float) -> float:
    """Return value (1 + change), of decimals, rounded towards the value: 0.4 by 0.1 is 0.44."""
    exact = _exact(value) * (1 + _exact(change))
    edge = float(exact)
    beyond = _exact(edge) < exact if change < 0 else _exact(edge) > exact
    return nextafter(edge, value) if beyond else edge


def _exact(decimal: float) -> Fraction:
    """Return the decimal that a float is written as."""
    return Fraction(repr(float(decimal)))
