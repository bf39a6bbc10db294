"""Quadratic functions of the two gains, bounded over many boxes of designs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.proof.array_intervals import Flags, Floats


@dataclass(frozen=True, slots=True)
class Quadratic:
    """constant + linear . K + square . K^2 + cross K_v K_p at several points, each coefficient rounded the same way.

    Attributes
    ----------
    constant : shape (points,)
    linear, square : of K_v and of K_p, each of that shape; no square is negative
    cross : of that shape; None where the contributions of K_v and K_p are at right angles to each other
    """

    constant: Floats
    linear: tuple[Floats, Floats]
    square: tuple[Floats, Floats]
    cross: Floats | None = None

    def greatest(self, boxes: DesignBoxes) -> Floats:
        """Return the greatest value over each box of gains, at a vertex because it is convex; shape (boxes, points)."""
        if self.cross is None:
            return self.constant + self._greatest_part(0, boxes) + self._greatest_part(1, boxes)
        vertices = ((K_v[:, None], K_p[:, None]) for K_v in self._ends(0, boxes) for K_p in self._ends(1, boxes))
        values = (self._part(0, K_v) + self._part(1, K_p) + K_v * K_p * self.cross for K_v, K_p in vertices)
        return self.constant + np.maximum.reduce(list(values))

    def _greatest_part(self, axis: int, boxes: DesignBoxes) -> Floats:
        low, high = self._ends(axis, boxes)
        return np.maximum(self._part(axis, low[:, None]), self._part(axis, high[:, None]))

    @staticmethod
    def _ends(axis: int, boxes: DesignBoxes) -> tuple[Floats, Floats]:
        return boxes.low[axis], boxes.high[axis]

    def least(self, boxes: DesignBoxes) -> Floats:
        """Return the least value over each box of gains without a cross term, shape (boxes, points)."""
        total = self.constant
        for axis in (0, 1):
            low, high = (edge[axis][:, None] for edge in (boxes.low, boxes.high))
            total = total + self._part(axis, np.clip(-0.5 * self.linear[axis] / self.square[axis], low, high))
        return total

    def _part(self, axis: int, gain: Floats) -> Floats:
        return gain * (self.linear[axis] + gain * self.square[axis])


@dataclass(frozen=True, slots=True)
class DesignBoxes:
    """Boxes of designs: [low, high] in each of K_v, K_p, tau_c = m_c/b_c and b_0; arrays of shape (4, n)."""

    low: Floats
    high: Floats

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def subset(self, at: NDArray[np.intp] | Flags) -> DesignBoxes:
        """Return some of the boxes."""
        return DesignBoxes(self.low[:, at], self.high[:, at])
