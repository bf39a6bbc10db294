"""Delays near a whole number of samples, where the sensed force jumps with the delay.

The firmware samples the force just before a new command acts. If the delay is slightly shorter than a whole number of
samples, that command acts before the sample, and the force of a hand's mass differs by a whole step (model/README.md,
section 14). Either of the two cases may be the worse one. If a device's delay lies near a whole number of samples, the
prover therefore proves its design for the stated delay and on both sides of that number.
"""

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

NEAR = 0.05
"""Share of a sample within which a delay is near a whole number of samples. The delays of clocks, buses and amplifiers
are not known more exactly. With half or twice this share, the certificate would cover other delays, by the same
proofs."""
NEXT_TO = 1e-7
"""Distance, in samples, between a whole number of samples and the delay just below it for which the prover proves the
claims. Decimals can still distinguish the two delays. With half or twice this distance, vctune finds the same
designs."""
PEAK = 0.75
"""Time after a step of the command at which the sensed acceleration is greatest, as a share of the lag of a servo and
its sensor. At half and at 4/3 of this time, the acceleration is three quarters of the greatest."""


def sensed_force_jumps(device: Device, hands: Hands) -> bool:
    """Return whether the sensed force jumps where the delay passes a whole number of samples.

    The force jumps if the sensor measures the acceleration of a hand's mass immediately. The sensor does so only if the
    command moves the handle directly, without an actuator's low-pass or a spring, and if the sensor has no low-pass. A
    servo of order 1 turns a command into an acceleration immediately.

    Parameters
    ----------
    device : a device with any display; only an admittance display and a servo sense force
    hands : the box of hands; without mass the force does not jump

    Returns
    -------
    bool
        Whether the force jumps in some hand of the box.
    """
    filtered = device.sensing.bandwidth_hz is not None
    followed = device.servo is None or device.servo.order == 1
    direct = device.actuator is None and device.structure is None and followed and not filtered
    return direct and device.kind.senses_force and hands.high.mass > 0


def beside_whole_sample(device: Device, hands: Hands) -> tuple[Device, ...]:
    """Return a device whose delay is just below a whole number of samples, and one whose delay is that number.

    The function returns no device if the delay of the given device is not near a whole number of samples.

    Parameters
    ----------
    device : device with plain floats; the function considers the sum of its delay and the force sensor's delay
    hands : the box of hands

    Returns
    -------
    tuple of Device
        The tuple does not include `device` itself. It is also empty if the force does not jump at that number.
    """
    samples = delay_in_samples(device)
    whole = round(samples)
    if whole < 1 or abs(samples - whole) > NEAR * (1 + SNAP) or not sensed_force_jumps(device, hands):
        return ()
    return tuple(_with(device, at) for at in (whole - NEXT_TO, whole) if abs(samples - at) > NEXT_TO / 2)


def reaching_whole_sample(box: DeviceBox, hands: Hands) -> DeviceBox:
    """Return a box with its delay extended to each whole number of samples that is near one of its ends.

    Parameters
    ----------
    box : box of uncertain devices
    hands : the box of hands

    Returns
    -------
    DeviceBox
        The box itself if its delay is known exactly or the sensed force does not jump.
    """
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
    samples.

    To compute a price, the caller compares a device with a slightly better one. A small change of the sample time would
    otherwise move the delay across the jump of the sensed force.

    Parameters
    ----------
    device : the device after a small change of one number
    before : the device before the change

    Returns
    -------
    Device
        `device` itself if the delay of `before` is not next to a whole number of samples.
    """
    samples = delay_in_samples(before)
    near = round(samples) >= 1 and abs(samples - round(samples)) <= 2 * NEXT_TO
    return _with(device, samples) if near else device


def next_to_whole_samples(box: DeviceBox) -> list[Device]:
    """Return the devices of a box on both sides of whole samples, for the delay and for its sum with the sensor's
    delay.

    At whole samples, the sensed force or its slope may jump with the delay. With a fast low-pass, the sensed
    acceleration is greatest at a delay that is shorter by `PEAK` times the lag.

    Parameters
    ----------
    box : box of devices
    """
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
    """Return a device whose delays add up to a given number of samples, in short decimals.

    The function changes the device's own delay, or the force sensor's delay if the device has no other.
    """
    key = key or next((key for key in DELAYS if device.number(key)), device.delay_key)
    other = sum(device.number(name) or 0.0 for name in DELAYS if name != key)
    return device.with_numbers({key: float(f"{samples * device.sample_time - other:.15g}")})
