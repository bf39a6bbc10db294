"""Quadratic functions of the two gains, bounded over many boxes of designs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.proof.enclosures import Flags, Floats


@dataclass(frozen=True, slots=True)
class Quadratic:
    """constant + linear . K + square . K^2 at several places, each coefficient rounded up, or each rounded down.

    Attributes
    ----------
    constant : shape (places,)
    linear, square : of K_v and of K_p, each of that shape; no square is negative
    """

    constant: Floats
    linear: tuple[Floats, Floats]
    square: tuple[Floats, Floats]

    def greatest(self, boxes: Boxes) -> Floats:
        """Return the greatest value over each box of gains, shape (boxes, places): it lies at a vertex."""
        total = self.constant
        for axis in (0, 1):
            ends = [edge[axis][:, None] for edge in (boxes.low, boxes.high)]
            total = total + np.maximum(*(self._part(axis, end) for end in ends))
        return total

    def least(self, boxes: Boxes) -> Floats:
        """Return the least value over each box of gains, shape (boxes, places)."""
        total = self.constant
        for axis in (0, 1):
            low, high = (edge[axis][:, None] for edge in (boxes.low, boxes.high))
            total = total + self._part(axis, np.clip(-0.5 * self.linear[axis] / self.square[axis], low, high))
        return total

    def _part(self, axis: int, gain: Floats) -> Floats:
        return gain * (self.linear[axis] + gain * self.square[axis])


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes of designs: [low, high] in each of K_v, K_p, tau_c = m_c/b_c and b_0; arrays of shape (4, n)."""

    low: Floats
    high: Floats

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def taken(self, at: NDArray[np.intp] | Flags) -> Boxes:
        """Return some of the boxes."""
        return Boxes(self.low[:, at], self.high[:, at])
