"""Boxes of a frequency and of other parameters of a claim, such as designs or uncertain devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from math import inf, nextafter, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.hands import HAND, Hands, PlacesInHands
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import KEYS, SPRING_KEYS, keys_of
from vctune.proof.enclosures.elementary import UNIT
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats, between
from vctune.proof.enclosures.taylor import Taylor

Integers = NDArray[np.intp]

FREQUENCY = "frequency"  # The name of the row of the frequency
HALF_TURN = nextafter(pi, inf)  # theta = omega T at the Nyquist frequency, rounded upwards
WHOLE_SAMPLES = "whole samples of device.delay"
# The name of the row for the whole samples of a delay, if the row of the delay holds only the rest of the delay
SAMPLES_BEFORE = "whole samples before device.delay"
WIDE = 2.0  # Ratio of the ends of an interval above which the prover halves it at the mean of the logarithms
COEFFICIENTS_AT_ONCE = 2**16  # Number of coefficients of a Taylor form that the prover evaluates together

Values = Mapping[str, Number]  # Values of a claim by name


def gains_of(values: Values) -> Gains:
    """Return the gains that a mapping of values contains."""
    return Gains(values[KEYS[0]], values[KEYS[1]])


def coupling_of(values: Values) -> AnyCoupling:
    """Return the coupling that a mapping of values contains."""
    if SPRING_KEYS[3] in values:
        return SpringDamper(values[SPRING_KEYS[2]], values[SPRING_KEYS[3]])
    return Coupling(values[KEYS[2]], values[KEYS[3]], values[KEYS[4]])


@dataclass(frozen=True, slots=True)
class Cells:
    """Boxes of designs, [low, high] in each number of a design, as arrays of shape (numbers, cells)."""

    low: Floats
    high: Floats

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of the design's parameters, `KEYS` or `SPRING_KEYS`."""
        return keys_of(len(self.low))

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def subset(self, at: Integers | Flags) -> Cells:
        """Return some of the cells."""
        return Cells(self.low[:, at], self.high[:, at])

    def centres(self) -> Cells:
        """Return the design at the centre of each cell."""
        middle = 0.5 * (self.low + self.high)
        return Cells(middle, middle)

    @property
    def extended(self) -> bool:
        """Whether a cell contains more than a single design."""
        return bool(np.any(self.low < self.high))


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes of a frequency and of other parameters."""

    names: tuple[str, ...]  # names of the rows, `FREQUENCY` first
    low: Floats  # edges, shape (rows, n)
    high: Floats
    owner: Integers  # number of the proof to which each box belongs, shape (n,)
    whole_samples: Integers  # number N of whole samples in the delay of each box, shape (n,); 0 if the delay is known
    spans: Floats  # range of each row in the box with which the prover began, shape (rows, n)

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def subset(self, at: Any) -> Boxes:
        """Return some of the boxes."""
        return Boxes(
            names=self.names,
            low=self.low[:, at],
            high=self.high[:, at],
            owner=self.owner[at],
            whole_samples=self.whole_samples[at],
            spans=self.spans[:, at],
        )

    def count(self, owners: int) -> Integers:
        """Return the number of boxes of each owner."""
        return np.bincount(self.owner, minlength=owners)

    def rows(self) -> list[Number]:
        """Return the rows as enclosures. The edges of all rows except the frequency are decimals, not doubles."""
        endless: Flags = np.asarray(np.isinf(self.low).all(axis=1))
        low, high = (np.where(endless[:, None], 0.0, edge) for edge in (self.low, self.high))
        value = between(low, high)
        value.rad[1:] += 4 * UNIT * np.abs(high[1:])
        found = [Enclosure(mid, rad) for mid, rad in zip(value.mid, value.rad, strict=True)]
        return [inf if infinite else row for row, infinite in zip(found, endless.tolist(), strict=True)]

    def named(self, rows: Sequence[Number], fixed: Values) -> Values:
        """Return the values of a claim by name: the values of the rows and the fixed values."""
        return {**fixed, **dict(zip(self.names[1:], rows[1:], strict=True)), WHOLE_SAMPLES: self.whole_samples}

    def varied(self) -> list[bool]:
        """Return for each row whether some box has a width in this row. For the frequency, the result is always
        true."""
        return [True, *np.any(self.low[1:] < self.high[1:], axis=1).tolist()]

    def divided(self, name: str, ratio: float, beside: float = 0.0) -> Boxes:
        """Return the boxes, cut across a row of numbers into parts whose edges, each plus `beside`, have
        at most a given ratio."""
        row = self.names.index(name)
        low, high = self.low[row] + beside, self.high[row] + beside
        parts = np.maximum(np.ceil(np.log(high / low) / np.log(ratio)), 1).astype(np.intp)
        found = self.subset(np.repeat(np.arange(len(self)), parts))
        first = np.repeat(np.cumsum(parts) - parts, parts)
        number, whole = np.arange(parts.sum()) - first, np.repeat(parts, parts)
        least, most = found.low[row].copy(), found.high[row].copy()
        edge = (least + beside) * ((most + beside) / (least + beside)) ** (number / whole) - beside
        found.low[row] = np.where(number > 0, edge, least)
        found.high[row] = np.where(number < whole - 1, np.append(edge[1:], 0.0), most)
        return found

    def halved(self, axis: Integers) -> Boxes:
        """Return both halves of each box, cut across the row that `axis` names for the box."""
        at = np.arange(len(self))
        low, high = self.low[axis, at], self.high[axis, at]
        # roots, because low times high may overflow; 0 has no logarithm, so the cut is at a sixteenth of high
        wide = np.where(low > 0, np.sqrt(low) * np.sqrt(high), high / 16)
        middle = np.where(high > WIDE * low, wide, (low + high) / 2)
        left, right = self.high.copy(), self.low.copy()
        left[axis, at] = right[axis, at] = middle
        if SAMPLES_BEFORE in self.names:
            row = self.names.index(SAMPLES_BEFORE)
            whole = at[axis == row]
            left[row, whole] = np.floor(middle[whole])
            right[row, whole] = np.minimum(left[row, whole] + 1, self.high[row, whole])
        return joined(replace(self, high=left), replace(self, low=right))


def joined(*parts: Boxes) -> Boxes:
    """Return several sets of boxes with the same rows as one set."""
    fields = ([getattr(part, name) for part in parts] for name in Boxes.__slots__[1:])
    return Boxes(parts[0].names, *(np.concatenate(each, axis=-1) for each in fields))


def first_boxes(names: tuple[str, ...], low: Floats, high: Floats, owner: Integers, whole_samples: Integers) -> Boxes:
    """Return the boxes with which a proof begins."""
    with np.errstate(invalid="ignore"):  # a rigid coupling's damping is inf at both ends
        return Boxes(names, low, high, owner, whole_samples, np.nan_to_num(high - low))


def band_of(low: float, high: float, ratio: float) -> tuple[Floats, Floats]:
    """Divide a band into intervals of equal ratio."""
    start = low if low > 0 else high * 1e-3
    edges = np.geomspace(start, high, 2 + int(np.log(high / start) / np.log(ratio)))
    edges[0], edges[-1] = start, high
    edges = edges if low > 0 else np.concatenate(([0.0], edges))
    return edges[:-1], edges[1:]


def over_band(
    names: Sequence[str], low: Floats, high: Floats, band: tuple[Floats, Floats], whole_samples: int = 0
) -> Boxes:
    """Return a box for every pair of an interval of a band and an owner."""
    owners, intervals = low.shape[1], len(band[0])
    left, right = (
        np.vstack((np.tile(frequency, owners), np.repeat(edge, intervals, axis=1)))
        for frequency, edge in zip(band, (low, high), strict=True)
    )
    owner = np.repeat(np.arange(owners), intervals)
    return first_boxes((FREQUENCY, *names), left, right, owner, np.full(owner.size, whole_samples))


def over_cells(cells: Cells, band: tuple[Floats, Floats]) -> Boxes:
    """Return a box for every pair of an interval of a band and a cell."""
    return over_band(cells.keys, cells.low, cells.high, band)


def over_hands(cells: Cells, hands: Hands, band: tuple[Floats, Floats]) -> Boxes:
    """Return a box for every pair of an interval of a band and a cell, each with all hands."""
    low, high = (
        np.vstack((np.tile(np.array([*hand.by_key.values()], float)[:, None], len(cells)), edge))
        for hand, edge in ((hands.low, cells.low), (hands.high, cells.high))
    )
    return over_band((*HAND, *cells.keys), low, high, band)


def over_each(cells: Cells, at: Floats | PlacesInHands) -> Boxes:
    """Return each cell as a box at a single frequency, or at a single frequency in a single hand."""
    places = {FREQUENCY: at.at, **at.hands.by_key} if isinstance(at, PlacesInHands) else {FREQUENCY: at}
    low, high = (np.vstack((*places.values(), edge)) for edge in (cells.low, cells.high))
    owner = np.arange(len(cells))
    return first_boxes((*places, *cells.keys), low, high, owner, np.zeros_like(owner))


def chunks(boxes: Boxes) -> Iterator[Boxes]:
    """Yield the boxes in chunks that are small enough for the processor's cache, and for a time limit between them."""
    rows = len(boxes.names)
    size = COEFFICIENTS_AT_ONCE // ((rows + 1) * (rows + 2) // 2)
    for start in range(0, max(len(boxes), 1), size):
        yield boxes.subset(slice(start, start + size))


def in_chunks(f: Callable[[Boxes], Any], boxes: Boxes) -> Any:
    """Evaluate a function on all boxes, a chunk at a time."""
    return np.concatenate([f(chunk) for chunk in chunks(boxes)], axis=-1)


def shared(f: Callable[..., Any], rows: Sequence[Number]) -> Any:
    """Evaluate f on the rows of boxes, once for each set of boxes that have equal rows."""
    plain = [_values(row) for row in rows]
    n = max(np.size(row.mid) for row in plain)
    columns = np.stack([np.broadcast_to(part, n) for row in plain for part in (row.mid, row.rad)], axis=1)
    as_bytes = np.ascontiguousarray(columns).view(np.dtype((np.void, columns.itemsize * columns.shape[1]))).ravel()
    _, first, inverse = np.unique(as_bytes, return_index=True, return_inverse=True)
    found = f(*(_selected(row, first) for row in rows))
    return _mapped(lambda number: _selected(number, inverse), found)


def _values(row: Number) -> Enclosure:
    """Return an enclosure of all values of a row."""
    if isinstance(row, Taylor):
        return row.enclosed()
    return row


def _selected(number: Number, at: Any) -> Number:
    """Return some of a number's elements. A number with a single element stays as it is."""
    if isinstance(number, Taylor):
        return number.subset(at)
    if np.size(number.mid) > 1:
        return number.subset(at)
    return (
        number
        if np.size(number.rad) == 1
        else Enclosure(np.broadcast_to(number.mid, number.rad.shape), number.rad).subset(at)
    )


def _mapped(f: Callable[[Number], Number], tree: Any) -> Any:
    """Apply f to the numbers of a tree."""
    if isinstance(tree, Enclosure | Taylor):
        return f(tree)
    if isinstance(tree, tuple):
        return tuple(_mapped(f, part) for part in tree)
    if is_dataclass(tree) and not isinstance(tree, type):
        return replace(tree, **{field.name: _mapped(f, getattr(tree, field.name)) for field in fields(tree)})
    return tree


def with_row(boxes: Boxes, name: str, low: float, high: float) -> Boxes:
    """Return boxes with a row added whose range is the same in all."""
    one = np.ones((1, len(boxes)))
    ends = np.vstack((boxes.low, low * one)), np.vstack((boxes.high, high * one))
    return first_boxes((*boxes.names, name), *ends, boxes.owner, boxes.whole_samples)
