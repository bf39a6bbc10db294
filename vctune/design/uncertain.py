"""The box of devices of an uncertain problem: each parameter lies around its stated value, or in a range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from math import inf, nextafter, pi

from vctune.model.device import Device
from vctune.model.hands import Hands
from vctune.model.parts import Unmodelled
from vctune.model.problem import Uncertainty
from vctune.proof.device_box import DeviceBox


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
