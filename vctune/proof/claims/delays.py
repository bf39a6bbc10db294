"""Delays in whole samples: boxes divided by them, and the delays on both sides of one, where the sensed force jumps."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace
from itertools import pairwise, product
from math import ceil, floor, log

import numpy as np

from vctune.model.device import Device
from vctune.model.hands import Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import DELAYS
from vctune.model.sampled.circle import SNAP
from vctune.model.sampled.plant_in_hand import Delays, delays_of
from vctune.model.servo import latency, with_least_lag
from vctune.proof.boxes import SAMPLES_BEFORE, Boxes
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.proof.prover import Decided, Test, narrowed

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


def may_jump(device: Device, uncertain: Container[str]) -> bool:
    """Return whether the delays beside a whole sample are apart from a device's own, or those of its uncertainty."""
    return device.divided or not any(key in uncertain and device.number(key) for key in DELAYS)


def beside_whole_sample(device: Device, hands: Hands) -> tuple[Device, ...]:
    """Return a device whose delay is just below a whole number of samples, and one whose delay is that number; for a
    servo of which only the latency is known, where the sensed force is greatest at a sample."""
    if device.divided:
        sides = (-NEXT_TO, 0.0) if sensed_force_jumps(device, hands) else _peaks(with_least_lag(device, 0.0)) or (0.0,)
        return tuple(with_least_lag(device, side) for side in sides)
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


# Least and greatest value of each row, by the row's name, for one box or several
Ends = dict[str, tuple[Floats, Floats]]


@dataclass(frozen=True, slots=True)
class DelayPart:
    """The devices and hands of a box whose delays have the same number of whole samples, or for which this number is a
    row."""

    names: tuple[str, ...]  # names of the rows except the angle
    low: Floats  # ends of the numbers, shape (rows, 1), or (rows, n) for n parts
    high: Floats
    delays: Delays  # whole samples of the delays
    sample_time: float  # T, s
    other: float  # delay, s, of the device or the sensor that is not a row
    range: tuple[float, float] | None = None  # least and greatest delay, s, if `SAMPLES_BEFORE` is a row

    def within(self, test: Test) -> Test:
        """Return a test that ignores points at which the sum of both delays has another number of whole samples."""
        rows = [1 + index for index, name in enumerate(self.names) if name in DELAY_ROWS]
        if self.range is not None:
            return _at_whole_samples(test, self.names, self.sample_time, *self.range)
        if not rows:
            return test
        least = self.delays.felt * self.sample_time * (1 - SNAP)
        most = (self.delays.felt + 1) * self.sample_time * (1 + SNAP)

        def total(numbers: Floats) -> Floats:
            return np.asarray(self.other + sum(numbers[row] for row in rows))

        def has_none(boxes: Boxes) -> tuple[Boxes, Flags]:
            return boxes, (total(boxes.low) > most) | (total(boxes.high) < least)

        def tested(boxes: Boxes) -> Decided:
            decided = test(boxes)
            there = (total(decided.guide.point) >= least) & (total(decided.guide.point) <= most)
            return replace(decided, fails=decided.fails & there)

        return narrowed(tested, has_none)


def row_of(key: str) -> str:
    """Return the name of the row for a parameter of the device."""
    return f"device.{key}"


LAGS_AT_ONCE = 1.5  # Greatest factor between the lags of one part
# If a range of delays contains less than this share of its first or last sample, that sample gets separate boxes
OWN_BOXES = 0.5
DELAY_ROWS = tuple(map(row_of, DELAYS))


def parts_of(device: Device, ends: Ends, *, apart: bool = False) -> list[DelayPart]:
    """Divide a box of devices by the whole samples of their delays, and return its parts."""
    names = tuple(ends)
    low, high = (np.array([pair[end] for pair in ends.values()]) if ends else np.empty((0, 1)) for end in (0, 1))
    known, T = delays_of(device), device.sample_time
    own = row_of(device.delay_key)
    others = {row_of(key): number for key in DELAYS if (number := device.number(key)) is not None}
    rows = {name: names.index(name) for name in DELAY_ROWS if name in names}
    if not rows:
        return [DelayPart(names, low, high, known, T, 0.0)]
    if apart and (together := _with_samples_apart(device, ends)) is not None:
        return [together]
    other = sum(delay for name, delay in others.items() if name not in rows)
    if device.servo is not None and device.servo.stiffness is None and len(rows) == 1:
        return _parts_of_sum(names, rows.popitem()[1], low, high, known, device, other)
    parts, row = [], rows.get(own)
    loops = [known.loop] if row is None else _whole(low[row, 0], high[row, 0], T, last=True)
    for loop in loops:
        least, most = low.copy(), high.copy()
        if row is not None:
            least[row], most[row] = max(low[row, 0], loop * T), min(high[row, 0], (loop + 1) * T)
        shortest, longest = (other + sum(end[at, 0] for at in rows.values()) for end in (least, most))
        for felt in _whole(shortest, longest, T, last=loop == loops[-1]):
            delays = Delays(loop, row is not None or known.loop_fractional, felt, felt_fractional=True)
            parts.append(DelayPart(names, least, most, delays, T, other))
    return parts


def _at_whole_samples(test: Test, names: tuple[str, ...], T: float, shortest: float, longest: float) -> Test:
    """Return a test that ignores points between whole samples and delays outside a range."""
    (rest,) = (1 + index for index, name in enumerate(names) if name in DELAY_ROWS)
    whole, blur = 1 + names.index(SAMPLES_BEFORE), SNAP * longest

    def within_range(boxes: Boxes) -> tuple[Boxes, Flags]:
        low, high = boxes.low.copy(), boxes.high.copy()
        low[rest] = np.maximum(low[rest], shortest - blur - high[whole] * T)
        high[rest] = np.minimum(high[rest], longest + blur - low[whole] * T)
        return replace(boxes, low=low, high=high), low[rest] > high[rest]

    def tested(boxes: Boxes) -> Decided:
        decided = test(boxes)
        guide = decided.guide
        at, total = guide.point[whole], guide.point[whole] * T + guide.point[rest]
        had = (at == np.round(at)) & (total >= shortest - blur) & (total <= longest + blur)
        cost = guide.cost.copy()
        cost[whole, decided.fails & ~had & (boxes.low[whole] < boxes.high[whole])] = np.inf
        return replace(decided, fails=decided.fails & had, guide=replace(guide, cost=cost))

    return narrowed(tested, within_range)


def _with_samples_apart(device: Device, ends: Ends) -> DelayPart | None:
    """Return one part for all delays of a box, with the whole samples of the delay as one more row."""
    own, T = row_of(device.delay_key), device.sample_time
    late = any(device.number(key) for key in DELAYS if row_of(key) != own)
    if own not in ends or device.servo is not None or late:
        return None
    (low, *_), (high, *_) = ends[own]
    whole = _whole(low, high, T, last=True)
    if len(whole) == 1:
        return None
    first, last, blur = float(whole[0]), float(whole[-1]), SNAP * high
    shortest, longest = max(low - first * T - blur, 0.0), min(max(high - last * T + blur, 0.0), T)
    columns = []
    if T - shortest < OWN_BOXES * T:
        columns.append(((first, shortest), (first, T)))
        first += 1
    if longest < OWN_BOXES * T:
        columns.append(((last, 0.0), (last, longest)))
        last -= 1
    if first <= last:
        columns.append(((first, 0.0), (last, T)))
    least, most = (
        np.concatenate([_at_delay(ends, own, *pair[end], end) for pair in columns], axis=1) for end in (0, 1)
    )
    return DelayPart((*ends, SAMPLES_BEFORE), least, most, Delays(0, True, 0, True), T, 0.0, (float(low), float(high)))


def _at_delay(ends: Ends, row: str, whole: float, rest: float, end: int) -> Floats:
    """Return one end of all rows. The row of the delay holds only the rest of the delay after its whole samples."""
    numbers = [np.full_like(pair[end], rest) if name == row else pair[end] for name, pair in ends.items()]
    return np.array([*numbers, np.full_like(numbers[0], whole)])


def _parts_of_sum(
    names: tuple[str, ...], row: int, low: Floats, high: Floats, known: Delays, device: Device, other: float
) -> list[DelayPart]:
    """Return the parts of a box of servos. Only the sum of the two delays matters, and one of them is a row."""
    assert device.servo is not None
    parts, T, latency = [], device.sample_time, device.servo.latency
    for felt in _whole(low[row, 0] + other, high[row, 0] + other, T, last=True):
        shortest, longest = max(low[row, 0], felt * T - other), min(high[row, 0], (felt + 1) * T - other)
        delays = replace(known, felt=felt, felt_fractional=True)
        for ends in pairwise(_in_lags(shortest, max(shortest, longest), latency)):
            least, most = low.copy(), high.copy()
            least[row], most[row] = ends
            parts.append(DelayPart(names, least, most, delays, T, other))
    return parts


def _in_lags(shortest: float, longest: float, latency: float | None) -> list[float]:
    """Return a range of delays, divided where the rest of a latency is the lag and would vary by a great factor."""
    if latency is None:
        return [shortest, longest]
    first, last = latency - shortest, latency - longest
    lags = np.geomspace(first, last, 2 + int(log(first / last) / log(LAGS_AT_ONCE)))
    return [shortest, *(latency - lags[1:-1]).tolist(), longest]


def _whole(low: float, high: float, T: float, *, last: bool) -> range:
    """Return the numbers of whole samples of the delays in a range."""
    first, end = floor(low / T * (1 + SNAP)), high / T
    return range(first, max(first + 1, floor(end * (1 + SNAP)) + 1 if last else ceil(end * (1 - SNAP))))
