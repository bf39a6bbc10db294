"""Proofs for many cells at once: a cell is a box of gains and couplings, a point where its edges meet.

A claim f > 0 over a cell and a band is held as open pairs (cell, interval of frequency). A pair is evaluated in
enclosures, directly where the interval is wide and by the mean value form where it is narrow (`vctune.proof.interval`
does the same with Arb for a single design), then closed, halved, or left open until the cell is split.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.arithmetic import Number
from vctune.proof.enclosures import SWELL, UNIT, Enclosure, Flags, Floats, between, selected
from vctune.proof.interval import WIDE
from vctune.proof.jets import Jet, variables

Integers = NDArray[np.intp]

CHUNK = 4096
"""Pairs evaluated together: their arrays stay in the processor's cache."""
MOST = 4_000
"""Pairs of a cell that are looked at for one claim before it is left open; most take some hundred."""
BLUR = 2.0
"""A pair is not halved when the cell's size contributes this much more to its uncertainty than the interval's."""

Values = Sequence[Number]
"""K_v, K_p, b_c, m_c, b_0."""
Margin = Callable[[Number, Values], Number]
"""What must be positive, of a frequency and a design, over enclosures and jets."""


@dataclass(frozen=True, slots=True)
class Cells:
    """Boxes of designs, [low, high] in each of K_v, K_p, b_c, m_c, b_0; arrays of shape (5, number of cells)."""

    low: Floats
    high: Floats

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def taken(self, at: Integers | Flags) -> Cells:
        """Return some of the cells."""
        return Cells(self.low[:, at], self.high[:, at])

    def centres(self) -> Cells:
        """Return the middle of each cell."""
        middle = 0.5 * (self.low + self.high)
        return Cells(middle, middle)

    def values(self) -> list[Enclosure]:
        """Return the five numbers enclosed, their edges as the decimals that they are written as."""
        value = between(self.low, self.high)
        rad = value.rad + UNIT * np.abs(self.high)
        return [Enclosure(value.mid[i], rad[i]) for i in range(5)]

    def moving(self) -> list[bool]:
        """Return which of the five numbers differ within some cell."""
        return [bool(np.any(self.low[i] < self.high[i])) for i in range(5)]


@dataclass(frozen=True, slots=True)
class Pairs:
    """What is still open: a cell's number and an interval of frequency, each."""

    cell: Integers
    low: Floats
    high: Floats

    def __len__(self) -> int:
        return len(self.cell)

    def taken(self, at: Integers | Flags) -> Pairs:
        """Return some of the pairs."""
        return Pairs(self.cell[at], self.low[at], self.high[at])

    def count(self, cells: int) -> Integers:
        """Return how many pairs each cell has."""
        return np.bincount(self.cell, minlength=cells)

    def halved(self) -> Pairs:
        """Return both halves of each interval."""
        middle = _middle(self.low, self.high)
        return joined(Pairs(self.cell, self.low, middle), Pairs(self.cell, middle, self.high))


def joined(*parts: Pairs) -> Pairs:
    """Return several sets of pairs as one."""
    return Pairs(*(np.concatenate([getattr(part, name) for part in parts]) for name in Pairs.__slots__))


def all_pairs(cells: int, low: float, high: float, ratio: float) -> Pairs:
    """Return the band [low, high] for each cell, in equal logarithmic steps of at most `ratio`; low may be 0."""
    start = low if low > 0 else high * 1e-3
    edges = np.geomspace(start, high, 2 + int(np.log(high / start) / np.log(ratio)))
    edges[0], edges[-1] = start, high
    edges = edges if low > 0 else np.concatenate(([0.0], edges))
    return Pairs(np.repeat(np.arange(cells), len(edges) - 1), np.tile(edges[:-1], cells), np.tile(edges[1:], cells))


def _middle(low: Floats, high: Floats) -> Floats:
    """Return where to halve: in the logarithm for wide intervals, near 0 for those that start there."""
    wide = np.where(low > 0, np.sqrt(low) * np.sqrt(high), high / 16)
    return np.where(high > WIDE * low, wide, (low + high) / 2)


@dataclass(frozen=True, slots=True)
class Sifted:
    """What is left of a claim.

    Attributes
    ----------
    open : pairs that are not proved
    witness : for each cell a frequency at which its centre fails, nan where none was met
    boxes : for each cell the pairs looked at
    """

    open: Pairs
    witness: Floats
    boxes: Integers


@np.errstate(all="ignore")
def sift(margin: Margin, cells: Cells, pairs: Pairs, rounds: int, floor: Margin | None = None) -> Sifted:
    """Close the pairs on which a margin is proved positive, halving their intervals for some rounds.

    A pair is not halved when its cell's centre fails in it, or when the cell's size blurs the margin more than the
    interval's does.

    Parameters
    ----------
    margin : evaluated on enclosures and jets
    cells, pairs : what is to be proved
    rounds : how often to halve
    floor : another margin that proves as much, tried on wide intervals
    """
    kept: list[Pairs] = []
    witness, boxes = np.full(len(cells), np.nan), np.zeros(len(cells), np.intp)
    for again in range(rounds + 1):
        if not len(pairs):
            break
        boxes += pairs.count(len(cells))
        closed, blurred, fails = _decided(margin, cells, pairs, floor)
        witness[pairs.cell[fails]] = ((pairs.low + pairs.high) / 2)[fails]
        hopeful = np.isnan(witness) & (boxes < MOST) & (again < rounds)
        halve = ~(closed | blurred) & hopeful[pairs.cell]
        kept.append(pairs.taken(~(closed | halve)))
        pairs = pairs.taken(halve).halved()
    return Sifted(joined(*kept) if kept else pairs, witness, boxes)


def _decided(margin: Margin, cells: Cells, pairs: Pairs, floor: Margin | None) -> Flags:
    """Return for each pair whether it is proved, whether the cell blurs it, whether its centre fails: shape (3, n)."""
    values, moving = cells.values(), cells.moving()

    def directly(part: Pairs) -> Flags:
        omega, here = located(values, part)
        proved = margin(omega, here).positive()
        if floor is not None:
            proved |= floor(omega, here).positive()
        return np.stack((proved, np.zeros_like(proved), np.zeros_like(proved)))

    wide = pairs.high > WIDE * pairs.low
    decided = np.zeros((3, len(pairs)), bool)
    decided[:, wide] = in_chunks(directly, pairs.taken(wide))
    decided[:, ~wide] = in_chunks(
        lambda part: _by_mean_value(margin, *located(values, part), moving), pairs.taken(~wide)
    )
    return decided


def in_chunks(f: Callable[[Pairs], Any], pairs: Pairs) -> Any:
    """Return f of all pairs, `CHUNK` of them at a time, joined along the last axis."""
    starts = range(0, max(len(pairs), 1), CHUNK)
    return np.concatenate([f(pairs.taken(np.arange(i, min(i + CHUNK, len(pairs))))) for i in starts], axis=-1)


def located(values: list[Enclosure], pairs: Pairs) -> tuple[Enclosure, Values]:
    """Return the intervals of frequency and the five numbers of each pair's cell."""
    return between(pairs.low, pairs.high), [value.taken(pairs.cell) for value in values]


def _by_mean_value(margin: Margin, omega: Enclosure, values: Values, moving: list[bool]) -> Flags:
    image, reach, middle = mean_value(margin, omega, values, [True, *moving])
    proved = image.positive()
    blurred = np.broadcast_to(sum(reach[1:], np.zeros(1)) > BLUR * reach[0], proved.shape)
    return np.stack((proved, blurred & ~proved, middle.negative()))


def mean_value(
    f: Margin, omega: Enclosure, values: Values, moving: list[bool]
) -> tuple[Enclosure, list[Floats], Enclosure]:
    """Enclose f by f(centre) + sum f'(box) (box - centre), whose excess shrinks with the square of the size.

    Parameters
    ----------
    f : evaluated on enclosures and jets
    omega, values : the boxes
    moving : which of the frequency and the five numbers are not the same throughout a box

    Returns
    -------
    image : the better of this enclosure and the direct one
    reach : what each moving number contributes to its radius
    middle : f at the centre
    """
    jets = variables([omega, *values], moving)
    direct = f(jets[0], jets[1:])
    centre = [Enclosure(x.mid) if moves else x for x, moves in zip((omega, *values), moving, strict=True)]
    middle: Enclosure = f(centre[0], centre[1:])
    if not isinstance(direct, Jet):
        return direct, [], middle
    reach = [
        np.zeros(1) if slope is None else (np.abs(slope.mid) + slope.rad) * x.value.rad
        for slope, x in zip(direct.slopes, (x for x in jets if isinstance(x, Jet)), strict=True)
    ]
    spread = Enclosure(middle.mid, (middle.rad + sum(reach)) * SWELL)
    return selected(spread.rad < direct.value.rad, spread, direct.value), reach, middle


def image_at(f: Margin, cells: Cells, omega: Floats) -> Enclosure:
    """Return what f takes over each cell at one frequency of its own; omega has the shape (number of cells,)."""
    values, moving = cells.values(), [False, *cells.moving()]

    def part(pairs: Pairs) -> Floats:
        image = mean_value(f, *located(values, pairs), moving)[0]
        return np.stack(np.broadcast_arrays(image.mid, image.rad))

    with np.errstate(all="ignore"):
        mid, rad = in_chunks(part, Pairs(np.arange(len(cells)), omega, omega))
    return Enclosure(mid, rad)
