"""Boxes of devices, divided into parts whose sampled loops have the same states (model/README.md, section 21)."""

from __future__ import annotations

from itertools import pairwise
from math import ceil, floor

from vctune.model.device import Device
from vctune.model.parts import DELAYS
from vctune.model.sampled.changing.storage_function import Range
from vctune.model.sampled.velocity_loop import SNAP
from vctune.proof.device_box import DeviceBox


def parts_alike(device: Device, devices: DeviceBox | None) -> list[tuple[Device, tuple[Range, ...]]]:
    """Return a device with plain numbers for each part, and the ranges of the part's uncertain parameters."""
    if devices is None or not devices.uncertain:
        return [(device, ())]
    ranges = [Range(key, devices.low.number(key), devices.high.number(key)) for key in devices.uncertain]
    late = [each for each in ranges if each.key in DELAYS]
    if len(late) > 1:
        return []
    others = [each for each in ranges if each.key not in DELAYS]
    known = sum(devices.nominal.number(key) or 0.0 for key in DELAYS if key not in [each.key for each in late])
    found = []
    for delays in [[each] for each in _between_wholes(late[0], known, device.sample_time)] if late else [[]]:
        numbers = (*delays, *others)
        middle = {each.key: 0.5 * (each.low + each.high) for each in numbers}
        found.append((devices.nominal.with_numbers(middle), numbers))
    return found


def _between_wholes(late: Range, known: float, T: float) -> list[Range]:
    """Divide a range at whole numbers of samples of the delay, and of its sum with a known delay."""
    wholes = {
        k * T - other
        for other in (0.0, known)
        for k in range(floor((late.low + other) / T), ceil((late.high + other) / T) + 1)
    }
    near = SNAP * T
    inner = sorted(edge for edge in wholes if late.low + near < edge < late.high - near)
    parts = [Range(late.key, low, high) for low, high in pairwise([late.low, *inner, late.high])]
    ends = any(abs(edge - late.high) <= near for edge in wholes)
    return [*parts, Range(late.key, late.high, late.high)] if ends else parts
