"""Delays near a whole number of samples, where the sensed force jumps with the delay."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import ceil, floor

from vctune.model.device import Device
from vctune.model.hands import Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import DELAYS
from vctune.model.sampled.velocity_loop import SNAP
from vctune.model.servo import latency
from vctune.proof.device_box import DeviceBox

NEAR = 0.05  # Share of a sample within which a delay is near a whole number of samples
# Distance, in samples, between a whole number of samples and the delay just below it for which the prover proves the
# claims
NEXT_TO = 1e-7
# Time after a step of the command at which the sensed acceleration is greatest, as a share of the lag of a servo and
# its sensor
PEAK = 0.75


def sensed_force_jumps(device: Device, hands: Hands) -> bool:
    """Return whether the sensed force jumps where the delay passes a whole number of samples."""
    filtered = device.sensing.bandwidth_hz is not None
    followed = device.servo is None or device.servo.order == 1
    direct = device.actuator is None and device.structure is None and followed and not filtered
    return direct and device.kind.senses_force and hands.high.mass > 0


def beside_whole_sample(device: Device, hands: Hands) -> tuple[Device, ...]:
    """Return a device whose delay is just below a whole number of samples, and one whose delay is that number."""
    samples = delay_in_samples(device)
    whole = round(samples)
    if whole < 1 or abs(samples - whole) > NEAR * (1 + SNAP) or not sensed_force_jumps(device, hands):
        return ()
    return tuple(_with(device, at) for at in (whole - NEXT_TO, whole) if abs(samples - at) > NEXT_TO / 2)


def reaching_whole_sample(box: DeviceBox, hands: Hands) -> DeviceBox:
    """Return a box with its delay extended to each whole number of samples that is near one of its ends."""
    key = next((key for key in DELAYS if key in box.uncertain), None)
    if key is None or not sensed_force_jumps(box.nominal, hands):
        return box
    first, last = delay_in_samples(box.low), delay_in_samples(box.high)
    above, below = floor(first * (1 + SNAP)), ceil(last * (1 - SNAP))
    low, high = box.low, box.high
    if above >= 1 and first - above <= NEAR:
        low = _with(low, above - NEXT_TO, key)
    if below - last <= NEAR:
        high = _with(high, below, key)
    return replace(box, low=low, high=high)


def kept_at_whole_sample(device: Device, before: Device) -> Device:
    """Return a device with the delay, in samples, of another device, if that delay is next to a whole number of
    samples."""
    samples = delay_in_samples(before)
    near = round(samples) >= 1 and abs(samples - round(samples)) <= 2 * NEXT_TO
    return _with(device, samples) if near else device


def next_to_whole_samples(box: DeviceBox) -> list[Device]:
    """Return the devices of a box on both sides of whole samples, for the delay and for its sum with the sensor's
    delay."""
    found: dict[Device, None] = {}
    T = box.nominal.sample_time
    sides = (*_peaks(box.nominal), -NEXT_TO, NEXT_TO)
    for device, key in product(box.corners(), (key for key in DELAYS if key in box.uncertain)):
        low, high = box.low.number(key), box.high.number(key)
        others = {sum(device.number(name) or 0.0 for name in DELAYS if name != key)}
        others |= {0.0} if key == device.delay_key else set()
        for other in others:
            for whole in range(ceil((low + other) / T), floor((high + other) / T - sides[0]) + 1):
                for side in sides:
                    delay = (whole + side) * T - other
                    if low <= delay <= high:
                        found[device.with_numbers({key: delay})] = None
    return list(found)


def _peaks(device: Device) -> tuple[float, ...]:
    """Return the distances, in samples, between a whole sample and the peak of a fast servo's sensed acceleration."""
    if device.servo is None:
        return ()
    late = latency(device, FLOATS)
    lag = late.lag + late.sensor - device.sensing.delay
    below = PEAK * lag / device.sample_time
    return (-below,) if below < 0.5 else ()


def delay_in_samples(device: Device) -> float:
    """Return the sum of the device's delay and its sensor's delay, in samples."""
    return sum(device.number(key) or 0.0 for key in DELAYS) / device.sample_time


def _with(device: Device, samples: float, key: str | None = None) -> Device:
    """Return a device whose delays add up to a given number of samples, in short decimals."""
    key = key or next((key for key in DELAYS if device.number(key)), device.delay_key)
    other = sum(device.number(name) or 0.0 for name in DELAYS if name != key)
    return device.with_numbers({key: float(f"{samples * device.sample_time - other:.15g}")})
