"""Delays at and near a whole number of samples, where the sensed force jumps with the delay.

Force is sampled just before a new command acts. If the delay is shorter than a whole number of samples by next to
nothing, that command acts before the sample, and the force of a hand's mass differs by a whole step (model/README.md,
section 14). Neither side is the safe one. So a design of a device whose delay lies near a whole number of samples is
proved on both sides of it, besides the stated delay.
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
"""Share of a sample within which a delay is near a whole number of samples: clocks, buses and amplifiers are not known
better. Half and twice it make other promises, not other proofs."""
NEXT_TO = 1e-7
"""Distance from a whole sample, in samples, at which a delay is placed: decimals tell both sides apart. Half and twice
it find the same designs."""
PEAK = 0.75
"""Time, as a share of the lag of a servo and its sensor, at which the sensed acceleration is greatest. Half and 4/3 of
it see three quarters of the greatest."""


def sensed_force_jumps(device: Device, hands: Hands) -> bool:
    """Return whether the sensed force jumps where the delay passes a whole number of samples.

    It jumps if the sensor feels the acceleration of a hand's mass at once: the command moves the handle directly,
    without an actuator's low-pass or a spring, and the sensor has no low-pass. A servo of order 1 turns a command into
    an acceleration at once.

    Parameters
    ----------
    device : a device of any display; only an admittance display senses force
    hands : the box of hands; without mass the force does not jump

    Returns
    -------
    bool
        Whether it jumps for some hand of the box.
    """
    filtered = device.sensing.bandwidth_hz is not None
    followed = device.servo is None or device.servo.order == 1
    direct = device.actuator is None and device.structure is None and followed and not filtered
    return direct and device.kind.senses_force and hands.high.mass > 0


def beside_whole_sample(device: Device, hands: Hands) -> tuple[Device, ...]:
    """Return the devices whose delay is just below and at a whole number of samples, if the device's own is near one.

    Parameters
    ----------
    device : plain floats; the sum of its delay and the force sensor's matters
    hands : the box of hands

    Returns
    -------
    tuple of Device
        Without the device itself; empty if its delay is not near a whole number of samples or the force does not jump
        there.
    """
    samples = delay_in_samples(device)
    whole = round(samples)
    if whole < 1 or abs(samples - whole) > NEAR * (1 + SNAP) or not sensed_force_jumps(device, hands):
        return ()
    return tuple(_with(device, at) for at in (whole - NEXT_TO, whole) if abs(samples - at) > NEXT_TO / 2)


def reaching_whole_sample(box: DeviceBox, hands: Hands) -> DeviceBox:
    """Return the box with its delay widened to each whole number of samples that is near one of its ends.

    Parameters
    ----------
    box : uncertain devices
    hands : the box of hands

    Returns
    -------
    DeviceBox
        The box itself if its delay is certain or the sensed force does not jump.
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
    """Return a device whose delay stays next to the same whole number of samples as another's.

    A price compares a device with one that is a little better. Near a whole number of samples the constraints hold on
    both sides of it for either device.

    Parameters
    ----------
    device : the device after a small change of one number
    before : the device before the change

    Returns
    -------
    Device
        `device` itself if `before` is next to no whole number of samples.
    """
    samples = delay_in_samples(before)
    near = round(samples) >= 1 and abs(samples - round(samples)) <= 2 * NEXT_TO
    return _with(device, samples) if near else device


def next_to_whole_samples(box: DeviceBox) -> list[Device]:
    """Return devices of a box whose delay, or its sum with the force sensor's, is next to whole samples, on both sides.

    There the force that is sensed jumps, or may bend, with the delay. Before a quick low-pass the acceleration has its
    peak a part of its lag below.

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
    """Return where next to a whole sample the sensed acceleration of a quick servo has its peak, in samples."""
    if device.servo is None:
        return ()
    late = latency(device, FLOATS)
    lag = late.lag + late.sensor - device.sensing.delay
    below = PEAK * lag / device.sample_time
    return (-below,) if below < 0.5 else ()


def delay_in_samples(device: Device) -> float:
    """Return delay and sensor's delay together, in samples."""
    return sum(device.number(key) or 0.0 for key in DELAYS) / device.sample_time


def _with(device: Device, samples: float, key: str | None = None) -> Device:
    """Return a device whose delays add up to so many samples, in readable decimals.

    The function changes the device's own delay, or that of its force sensor if it has no other.
    """
    key = key or next((key for key in DELAYS if device.number(key)), device.delay_key)
    other = sum(device.number(name) or 0.0 for name in DELAYS if name != key)
    return device.with_numbers({key: float(f"{samples * device.sample_time - other:.15g}")})
