"""Boxes of devices: each parameter of a device lies within a relative half-width of its stated value, or in a range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from math import inf, nextafter, pi

from vctune.model.device import Device
from vctune.model.hands import Hands
from vctune.model.numbers.arithmetic import Number
from vctune.model.parts import UNCERTAIN, Unmodelled
from vctune.model.problem import Uncertainty

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


def device_box(device: Device, uncertainty: Uncertainty) -> DeviceBox:
    """Return the box of devices around a nominal one."""
    widths = [(key, width) for key, width in uncertainty.half_widths if device.number(key) is not None]
    least, most = (
        {key: _edge(device.number(key), sign * width) for key, width in widths}
        | {key: ends.min if sign < 0 else ends.max for key, ends in uncertainty.ranges}
        for sign in (-1, 1)
    )
    low, high = device.with_numbers(least), device.with_numbers(most)
    if not uncertainty.unmodelled:
        return DeviceBox(device, low, high)
    own = Unmodelled(uncertainty.unmodelled)
    first, last = replace(own, share=1.0), replace(own, share=1.0, phase=nextafter(2 * pi, inf))
    return DeviceBox(replace(device, unmodelled=own), replace(low, unmodelled=first), replace(high, unmodelled=last))


# The keys of the parameters of a rigid device that add to the same parameters of a hand: mass and damping
ADDED = ("mass", "damping")


def moved_as_one(box: DeviceBox) -> tuple[str, ...]:
    """Return which uncertain parameters of a box matter only through their sum with the same parameter of the hand."""
    if box.nominal.kind.senses_force or box.nominal.structure is not None:
        return ()
    return tuple(key for key in ADDED if key in box.uncertain)


def in_longer_hands(box: DeviceBox, hands: Hands, keys: Sequence[str]) -> tuple[DeviceBox, Hands]:
    """Move the uncertainty of a device's mass and damping into the hands, because only the sums matter."""
    least = {key: box.low.number(key) for key in keys}
    range_ = {key: nextafter(box.high.number(key) - value, inf) for key, value in least.items()}
    high = {key: nextafter(getattr(hands.high, key) + value, inf) for key, value in range_.items()}
    rest = DeviceBox(*(device.with_numbers(least) for device in (box.nominal, box.low, box.high)))
    return rest, replace(hands, high=replace(hands.high, **high))


def _edge(value: float, change: float) -> float:
    """Return value (1 + change) as a decimal, rounded towards the value: 0.4 changed by 0.1 is 0.44."""
    exact = _exact(value) * (1 + _exact(change))
    edge = float(exact)
    beyond = _exact(edge) < exact if change < 0 else _exact(edge) > exact
    return nextafter(edge, value) if beyond else edge


def _exact(decimal: float) -> Fraction:
    """Return the decimal that a float prints as."""
    return Fraction(repr(float(decimal)))
