"""Divide a box of devices by the whole samples of their delays. Within each part the loop is smooth in the delay."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np

from vctune.model.device import Device
from vctune.model.parts import DELAYS
from vctune.model.sampled.plant_in_hand import Delays, delays_of
from vctune.model.sampled.velocity_loop import SNAP
from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.engine.boxes import Boxes
from vctune.proof.engine.branching import Decided, Test

Ends = dict[str, tuple[Floats, Floats]]
"""Least and greatest number of each row, by its name, for one box or several."""


@dataclass(frozen=True, slots=True)
class Part:
    """The devices and hands of a box whose delays have the same number of whole samples.

    Attributes
    ----------
    low, high : ends of the numbers, shape (rows, 1), or (rows, n) for n parts
    delays : whole samples of the delays
    sample_time, other : T, s; and the delay, s, of the device or the sensor that is not a row
    """

    low: Floats
    high: Floats
    delays: Delays
    sample_time: float
    other: float

    @property
    def spans(self) -> Floats:
        """The range of each number, shape (rows, 1)."""
        return np.asarray((self.high - self.low).max(axis=1, keepdims=True))

    def within(self, test: Test, names: tuple[str, ...]) -> Test:
        """Return a test that ignores points at which the sum of both delays has another number of whole samples.

        Parameters
        ----------
        test : test of boxes with these rows
        names : names of the rows without the frequency
        """
        rows = [1 + index for index, name in enumerate(names) if name in DELAY_ROWS]
        if not rows:
            return test
        least = self.delays.felt * self.sample_time * (1 - SNAP)
        most = (self.delays.felt + 1) * self.sample_time * (1 + SNAP)

        def total(numbers: Floats) -> Floats:
            return np.asarray(self.other + sum(numbers[row] for row in rows))

        def tested(boxes: Boxes) -> Decided:
            decided = test(boxes)
            outside = (total(boxes.low) > most) | (total(boxes.high) < least)
            there = (total(decided.point) >= least) & (total(decided.point) <= most)
            decided.side[rows] = 0.0  # an end outside the part is not a valid point
            return replace(decided, proved=decided.proved | outside, fails=decided.fails & there)

        return tested


def row_of(key: str) -> str:
    """Return the name of the row for a number of the device."""
    return f"device.{key}"


DELAY_ROWS = tuple(map(row_of, DELAYS))


def parts_of(device: Device, ends: Ends) -> list[Part]:
    """Divide a box of devices by the whole samples of their delays, and return its parts.

    If the delays are known exactly, there is one part.

    Parameters
    ----------
    device : device with the delays that are not rows
    ends : least and greatest number of each row, without the angle
    """
    names = tuple(ends)
    low, high = (np.array([pair[end] for pair in ends.values()]) if ends else np.empty((0, 1)) for end in (0, 1))
    known, T = delays_of(device), device.sample_time
    own = row_of(device.delay_key)
    others = {row_of(key): number for key in DELAYS if (number := device.number(key)) is not None}
    rows = {name: names.index(name) for name in DELAY_ROWS if name in names}
    if not rows:
        return [Part(low, high, known, T, 0.0)]
    other = sum(delay for name, delay in others.items() if name not in rows)
    if device.servo is not None and device.servo.stiffness is None and len(rows) == 1:
        return _parts_of_sum(rows.popitem()[1], low, high, known, T, other)
    parts, row = [], rows.get(own)
    loops = [known.loop] if row is None else _whole(low[row, 0], high[row, 0], T, last=True)
    for loop in loops:
        least, most = low.copy(), high.copy()
        if row is not None:
            least[row], most[row] = max(low[row, 0], loop * T), min(high[row, 0], (loop + 1) * T)
        shortest, longest = (other + sum(end[at, 0] for at in rows.values()) for end in (least, most))
        for felt in _whole(shortest, longest, T, last=loop == loops[-1]):
            delays = Delays(loop, row is not None or known.loop_fractional, felt, felt_fractional=True)
            parts.append(Part(least, most, delays, T, other))
    return parts


def _parts_of_sum(row: int, low: Floats, high: Floats, known: Delays, T: float, other: float) -> list[Part]:
    """Return the parts of a box of servos. Only the sum of the two delays matters, and one of them is a row."""
    parts = []
    for felt in _whole(low[row, 0] + other, high[row, 0] + other, T, last=True):
        least, most = low.copy(), high.copy()
        least[row], most[row] = max(low[row, 0], felt * T - other), min(high[row, 0], (felt + 1) * T - other)
        delays = replace(known, felt=felt, felt_fractional=True)
        parts.append(Part(least, np.maximum(least, most), delays, T, other))
    return parts


def _whole(low: float, high: float, T: float, *, last: bool) -> range:
    """Return the numbers of whole samples of the delays in a range.

    For the `last` delays the range includes the whole number at its upper end, because the sensed force at a whole
    number is not the limit from below.
    """
    first, end = floor(low / T * (1 + SNAP)), high / T
    return range(first, max(first + 1, floor(end * (1 + SNAP)) + 1 if last else ceil(end * (1 - SNAP))))
