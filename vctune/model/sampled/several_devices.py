"""Join several devices into one whose numbers are arrays, if the formulas have the same form for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.sampled.plant_in_hand import Delays, delays_of


class SeveralDevices(NamedTuple):
    """Several devices, joined into one."""

    device: Device  # device whose numbers are plain where all devices agree, and arrays elsewhere
    delays: Delays  # whole samples of the device's delays, plain where all devices agree, and arrays elsewhere


def alike(devices: Sequence[Device]) -> list[list[int]]:
    """Return groups of devices that `as_one` can join, by their indices."""
    groups: dict[object, list[int]] = {}
    for place, device in enumerate(devices):
        delays = delays_of(device)
        form = device.with_numbers(dict.fromkeys(device.numbers(), 0.0))
        own = place if device.servo is not None else None
        kind = (form, tuple(device.numbers()), delays.loop_fractional, delays.felt_fractional, own)
        groups.setdefault(kind, []).append(place)
    return list(groups.values())


def as_one(devices: Sequence[Device], shape: tuple[int, ...]) -> SeveralDevices:
    """Return similar devices (`alike`) as one device."""
    first, delays = devices[0], [delays_of(device) for device in devices]
    if len(set(devices)) == 1:
        return SeveralDevices(first, delays[0])
    differing = [key for key, number in first.numbers().items() if any(each.number(key) != number for each in devices)]
    numbers = {key: _array([each.number(key) for each in devices], shape) for key in differing}
    whole = (_array([getattr(each, name) for each in delays], shape) for name in ("loop", "felt"))
    loop, felt = (part if np.any(part != part.flat[0]) else int(part.flat[0]) for part in whole)
    return SeveralDevices(first.with_numbers(numbers), replace(delays[0], loop=loop, felt=felt))


def _array(numbers: Sequence[float], shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.array(numbers, float).reshape(shape)
