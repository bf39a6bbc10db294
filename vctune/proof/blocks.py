"""Proofs over a frequency and the uncertain numbers of a device together, by blocks that are halved until decided.

A margin is bounded from below by its value at one point of the block: the middle in those variables in which it may
both rise and fall, which costs their slope times their half-width, and the worse end in those in which its slope keeps
its sign, which costs nothing. So a worst device at a vertex of its box is met exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vctune.model.arithmetic import Number
from vctune.model.pair import Pair
from vctune.proof.cells import CHUNK, Integers, Margin, Pairs, Values
from vctune.proof.enclosures import SWELL, UNIT, Enclosure, Flags, Floats, between
from vctune.proof.exclusion import Curve, missing_zero
from vctune.proof.interval import WIDE, Verdict
from vctune.proof.jets import variables

GENERATIONS = 80
"""How often a block is halved at most."""
NARROW = 1.02
"""Ratio of a block's frequencies below which it should be another margin that needs it narrower."""
FROM_ZERO = 0.1
"""As how wide, relative, an interval from frequency 0 counts: halved it is no narrower."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Boxes of a frequency and the uncertain numbers.

    Attributes
    ----------
    low, high : of frequency and of each number, shape (1 + numbers, n)
    whole : whole samples of the delay of each block's devices, shape (n,)
    """

    low: Floats
    high: Floats
    whole: Integers

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def taken(self, at: Integers | Flags) -> Blocks:
        """Return some of the blocks."""
        return Blocks(self.low[:, at], self.high[:, at], self.whole[at])

    def rows(self) -> list[Enclosure]:
        """Return frequency and numbers, the numbers' edges as the decimals that they stand for."""
        value = between(self.low, self.high)
        value.rad[1:] += 4 * UNIT * self.high[1:]
        return [Enclosure(mid, rad) for mid, rad in zip(value.mid, value.rad, strict=True)]

    def halved(self, axis: Integers) -> Blocks:
        """Return both halves of each block along an axis of its own."""
        at = np.arange(len(self))
        low, high = self.low[axis, at], self.high[axis, at]
        wide = np.where(low > 0, np.sqrt(low) * np.sqrt(high), high / 16)
        middle = np.where(high > WIDE * low, wide, (low + high) / 2)
        left, right = self.high.copy(), self.low.copy()
        left[axis, at] = right[axis, at] = middle
        return Blocks(np.hstack((self.low, right)), np.hstack((left, self.high)), np.tile(self.whole, 2))


def over_band(pairs: Pairs, low: Floats, high: Floats, whole: int = 0) -> Blocks:
    """Return the intervals of a band, each with the whole box of numbers from low to high."""
    rows = [np.repeat(end[:, None], len(pairs), axis=1) for end in (low, high)]
    return Blocks(np.vstack((pairs.low, rows[0])), np.vstack((pairs.high, rows[1])), np.full(len(pairs), whole))


def together(parts: Sequence[Blocks]) -> Blocks:
    """Return several sets of blocks as one."""
    return Blocks(*(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in Blocks.__slots__))


@dataclass(frozen=True, slots=True)
class Looked:
    """What is known of blocks: whether proved, whether a point of it fails, that point, and where to halve."""

    proved: Flags
    fails: Flags
    point: Floats
    axis: Integers


Rows = Sequence[Number]
"""Frequency and uncertain numbers, enclosures or jets."""
OfRows = Callable[[Rows], Number]
Look = Callable[[Blocks], Looked]


@dataclass(frozen=True, slots=True)
class Found:
    """What became of a claim over blocks.

    Attributes
    ----------
    verdict : proved everywhere, refuted at a point, or undecided
    boxes : blocks looked at
    point : frequency and numbers where it is refuted, or the middle of a block that stays open
    """

    verdict: Verdict
    boxes: int
    point: Floats | None


@np.errstate(all="ignore")
def prove_blocks(look: Look, blocks: Blocks, most: int) -> Found:
    """Halve blocks until each is proved, one is refuted, or so many have been looked at."""
    boxes = 0
    for _ in range(GENERATIONS):
        boxes += len(blocks)
        seen = _in_chunks(look, blocks)
        if seen.fails.any():
            return Found(Verdict.REFUTED, boxes, seen.point[:, int(np.argmax(seen.fails))])
        left = np.flatnonzero(~seen.proved)
        if not len(left):
            return Found(Verdict.PROVED, boxes, None)
        if boxes > most:
            break
        blocks = blocks.taken(left).halved(seen.axis[left])
    return Found(Verdict.UNDECIDED, boxes, seen.point[:, left[0]])


def _in_chunks(look: Look, blocks: Blocks) -> Looked:
    parts = [look(blocks.taken(np.arange(i, min(i + CHUNK, len(blocks))))) for i in range(0, len(blocks), CHUNK)]
    joined = [np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in Looked.__slots__]
    return Looked(*joined)


def positive(margin: Margin, design: Values, at_zero: Margin | None = None, below: float = 0.0) -> Look:
    """Return the look that proves a margin positive.

    Parameters
    ----------
    margin : of a frequency and of values: those of the design, the uncertain numbers, the whole samples of the delay
    design : the five numbers enclosed
    at_zero : another margin that proves as much and is regular at frequency 0; the same one if it is
    below : frequency below which that is looked at too, as what vanishes towards 0 may hardly vary relative to itself
    """

    def look(blocks: Blocks) -> Looked:
        def of(margin: Margin) -> OfRows:
            return lambda rows: margin(rows[0], [*design, *rows[1:], blocks.whole])

        near, rows = of(at_zero or margin), blocks.rows()
        if _from_zero(blocks):
            seen = _by_slopes(near, rows)
            return replace(seen, fails=np.zeros_like(seen.fails))
        if _wide(blocks):
            return _halved_in_frequency(blocks, of(margin)(rows).positive() | near(rows).positive())
        seen = _by_slopes(of(margin), rows)
        narrow = blocks.high[0] < np.minimum(blocks.low[0] * NARROW, below)
        left = np.flatnonzero(~seen.proved & ~seen.fails & narrow)
        if len(left):
            other = _by_slopes(near, blocks.taken(left).rows())
            seen.proved[left] = other.proved
            seen.axis[left] = np.where(other.fails, seen.axis[left], other.axis)
        return seen

    return partial(_kind_by_kind, look)


def missing(curve: Curve, design: Values, floor: Margin) -> Look:
    """Return the look that proves that a curve misses 0: where a margin `floor` is positive, it does.

    It misses 0 where its component along its own value at the middle of a block is positive.
    """

    def look(blocks: Blocks) -> Looked:
        def at(rows: Rows) -> Pair:
            return curve(rows[0], [*design, *rows[1:], blocks.whole])

        rows = blocks.rows()
        missed = missing_zero(curve)(rows[0], [*design, *rows[1:], blocks.whole])
        missed |= floor(rows[0], [*design, *rows[1:], blocks.whole]).positive()
        if _wide(blocks) and not _from_zero(blocks):
            return _halved_in_frequency(blocks, missed)
        middle = at([Enclosure(row.mid) for row in rows])
        size = np.hypot(middle.re.mid, middle.im.mid)
        re, im = middle.re.mid / size, middle.im.mid / size

        def component(rows: Rows) -> Number:
            value = at(rows)
            return value.re * re + value.im * im

        seen = _by_slopes(component, rows)
        return replace(seen, proved=seen.proved | missed, fails=np.zeros_like(seen.fails))

    return partial(_kind_by_kind, look)


def _from_zero(blocks: Blocks) -> bool:
    return bool(np.all(blocks.low[0] == 0))


def _wide(blocks: Blocks) -> bool:
    return bool(np.all(blocks.high[0] > WIDE * blocks.low[0]))


def _kind_by_kind(look: Look, blocks: Blocks) -> Looked:
    """Look at blocks from frequency 0, at those that are wide in frequency, and at the others."""
    zero = blocks.low[0] == 0
    wide = (blocks.high[0] > WIDE * blocks.low[0]) & ~zero
    count = len(blocks)
    found = Looked(np.zeros(count, bool), np.zeros(count, bool), np.zeros_like(blocks.low), np.zeros(count, np.intp))
    for kind in (zero, wide, ~(zero | wide)):
        if kind.any():
            seen = look(blocks.taken(kind))
            for name in Looked.__slots__:
                getattr(found, name)[..., kind] = getattr(seen, name)
    return found


def _halved_in_frequency(blocks: Blocks, proved: Flags) -> Looked:
    point, count = 0.5 * (blocks.low + blocks.high), len(blocks)
    return Looked(proved, np.zeros(count, bool), point, np.zeros(count, np.intp))


def _by_slopes(margin: OfRows, rows: Rows) -> Looked:
    """Bound a margin from below by its value at one point of each block and by its slopes.

    A block is halved where that costs most; where the margin varies most if it is negative at that point; where the
    block is widest while nothing is known of the slopes.
    """
    whole = margin(variables(rows, [True] * len(rows)))
    slopes = [slope or Enclosure(0.0) for slope in whole.slopes]
    slopes += [Enclosure(0.0)] * (len(rows) - len(slopes))
    rad = np.stack([row.rad for row in rows])
    side = np.stack([np.broadcast_to(1.0 * slope.negative() - slope.positive(), rad.shape[1]) for slope in slopes])
    steep = np.stack([np.broadcast_to(np.abs(slope.mid) + slope.rad, rad.shape[1]) for slope in slopes])
    middle = np.stack([row.mid for row in rows])
    point = middle + side * rad
    least = margin([Enclosure(at, 2 * UNIT * (np.abs(at) + r)) for at, r in zip(point, rad, strict=True)])
    reach = steep * rad
    loose = np.where(side == 0, reach, 0.0)
    spread = Enclosure(least.mid, (least.rad + loose.sum(axis=0)) * SWELL)
    proved, fails = spread.positive() | whole.value.positive(), least.negative()
    known = np.isfinite(reach).all(axis=0)
    width = rad / middle
    width[0] = np.where(rad[0] >= middle[0], FROM_ZERO, width[0])
    axis = np.argmax(np.where(known, np.where(fails, reach, loose), width), axis=0)
    return Looked(proved, fails, point, axis)
