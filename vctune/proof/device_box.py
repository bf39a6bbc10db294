"""Boxes of devices: each uncertain parameter of a device lies between those of two devices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import pi

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Number
from vctune.model.parts import UNCERTAIN

DIRECTION = "unmodelled.phase"  # The key of the direction of a response at the edge of the disc, rad


@dataclass(frozen=True, slots=True)
class DeviceBox:
    """All devices whose uncertain parameters lie between the parameters of two devices."""

    nominal: Device  # the device with its stated numbers
    low: Device  # devices with the least and the greatest values of the parameters
    high: Device

    @property
    def uncertain(self) -> tuple[str, ...]:
        """The keys of the uncertain parameters."""
        keys = (*UNCERTAIN, *((DIRECTION,) if self.low.unmodelled is not None else ()))
        ends = ((key, self.low.number(key), self.high.number(key)) for key in keys)
        return tuple(key for key, low, high in ends if low is not None and low < high)

    @property
    def modelled(self) -> DeviceBox:
        """The same devices, each with its nominal response."""
        return DeviceBox(self.nominal.modelled, self.low.modelled, self.high.modelled)

    @property
    def loops(self) -> tuple[DeviceBox, ...]:
        """The boxes of devices whose velocity loops must be stable: without a hand and in the operator's hand."""
        parts = zip(self.nominal.loops, self.low.loops, self.high.loops, strict=True)
        return tuple(DeviceBox(*ends) for ends in parts)

    def device(self, numbers: Mapping[str, Number]) -> Device:
        """Return a device of the box."""
        return self.low.with_numbers(numbers)

    def corners(self) -> list[Device]:
        """Return the devices at the vertices of the box."""
        box = self.modelled
        ends = {key: (box.low.number(key), box.high.number(key)) for key in box.uncertain}
        if len(ends) <= MOST_AT_ONCE:
            found = [dict(zip(ends, values, strict=True)) for values in product(*ends.values())]
        else:
            found = [{key: value} for key, pair in ends.items() for value in pair]
        if self.nominal.unmodelled is not None:
            turns = [{"unmodelled.share": 1.0, DIRECTION: 2 * pi * k / PHASES} for k in range(PHASES)]
            found = [numbers | turn for numbers in found for turn in turns]
        return [self.nominal.with_numbers(numbers) for numbers in found]

    def devices(self) -> list[Device]:
        """Return the nominal device and the devices at the corners."""
        return [self.nominal, *self.corners()]


PHASES = 8  # Number of directions on the edge of a disc that the search tries beforehand
MOST_AT_ONCE = 4  # Greatest number of uncertain parameters for which the search tries all vertices beforehand
