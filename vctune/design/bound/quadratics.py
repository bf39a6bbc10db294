"""Quadratic functions of the two gains, bounded over many boxes of designs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.design.bound.boxes import K_P, K_V, Boxes
from vctune.proof.enclosures import Floats


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

    def greatest(self, boxes: Boxes) -> Floats:
        """Return the greatest value over each box of gains, at a vertex because it is convex; shape (boxes, points)."""
        if self.cross is None:
            return self.constant + self._greatest_part(K_V, boxes) + self._greatest_part(K_P, boxes)
        vertices = ((K_v[:, None], K_p[:, None]) for K_v in self._ends(K_V, boxes) for K_p in self._ends(K_P, boxes))
        values = (self._part(K_V, K_v) + self._part(K_P, K_p) + K_v * K_p * self.cross for K_v, K_p in vertices)
        return self.constant + np.maximum.reduce(list(values))

    def _greatest_part(self, axis: int, boxes: Boxes) -> Floats:
        low, high = self._ends(axis, boxes)
        return np.maximum(self._part(axis, low[:, None]), self._part(axis, high[:, None]))

    @staticmethod
    def _ends(axis: int, boxes: Boxes) -> tuple[Floats, Floats]:
        return boxes.low[axis], boxes.high[axis]

    def least(self, boxes: Boxes) -> Floats:
        """Return the least value over each box of gains without a cross term, shape (boxes, points)."""
        total = self.constant
        for axis in (K_V, K_P):
            low, high = (edge[axis][:, None] for edge in (boxes.low, boxes.high))
            total = total + self._part(axis, np.clip(-0.5 * self.linear[axis] / self.square[axis], low, high))
        return total

    def _part(self, axis: int, gain: Floats) -> Floats:
        return gain * (self.linear[axis] + gain * self.square[axis])
