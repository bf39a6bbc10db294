"""Quadratic functions of the two gains, bounded over many boxes of designs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.design.bound.boxes import K_P, K_V, DesignBoxes
from vctune.proof.array_intervals import Enclosure, Floats

GUARD = 1e-14
"""Covers the rounding of a quadratic in the gains and of the operations after it, relative to their moduli.

It is 90 units of u = 2^-53. A coefficient of such a quadratic is a result of at most 4 operations, and at most 6 more
pass its term on into the value: gain (linear + gain square), and two sums. So the value is off by at most 10 u times
the sum of the moduli of its terms (Higham 2002, section 3.1), and since no gain is negative, coefficients raised by
`GUARD` of their modulus each raise it by more. The minimum of a convex quadratic is attained where its slope is 0, so
that the rounding of that point counts to second order only. In `lower_bounds.py` a factor 1 - 10 `GUARD`
covers 900 u, of some 30 operations, and a logarithm of 8 units in the last place.
Half and twice it change the bound by as many units of its fourteenth digit.
"""


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
            return self.constant + self._greatest_part(K_V, boxes) + self._greatest_part(K_P, boxes)
        vertices = ((K_v[:, None], K_p[:, None]) for K_v in self._ends(K_V, boxes) for K_p in self._ends(K_P, boxes))
        values = (self._part(K_V, K_v) + self._part(K_P, K_p) + K_v * K_p * self.cross for K_v, K_p in vertices)
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
        for axis in (K_V, K_P):
            low, high = (edge[axis][:, None] for edge in (boxes.low, boxes.high))
            total = total + self._part(axis, np.clip(-0.5 * self.linear[axis] / self.square[axis], low, high))
        return total

    def _part(self, axis: int, gain: Floats) -> Floats:
        return gain * (self.linear[axis] + gain * self.square[axis])


def rounded_up(x: Enclosure) -> Floats:
    """Return coefficients that are no less than any number enclosed, and more by `GUARD`."""
    return x.mid + x.rad + GUARD * (np.abs(x.mid) + x.rad)


def rounded_down(x: Enclosure) -> Floats:
    """Return coefficients that are no more than any number enclosed, and less by `GUARD`."""
    return x.mid - x.rad - GUARD * (np.abs(x.mid) + x.rad)


def both_up(x: tuple[Enclosure, Enclosure]) -> tuple[Floats, Floats]:
    """Return the coefficients of K_v and of K_p rounded up."""
    return rounded_up(x[0]), rounded_up(x[1])


def both_down(x: tuple[Enclosure, Enclosure], factor: int = 1) -> tuple[Floats, Floats]:
    """Return the coefficients of K_v and of K_p rounded down, times a power of 2."""
    return factor * rounded_down(x[0]), factor * rounded_down(x[1])
