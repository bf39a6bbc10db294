"""Bound quadratic functions of two variables, usually the gains, and quotients of these functions, over many boxes at
once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.design.bound.design_boxes import K_P, K_V, DesignBoxes
from vctune.design.bound.quadratic_coefficients import Coefficients
from vctune.proof.enclosures.intervals import Enclosure, Floats

# Allowance for the rounding of a quadratic in the gains and of the operations after it, relative to their moduli
GUARD = 1e-14


@dataclass(frozen=True, slots=True)
class Quadratic:
    """constant + linear . K + square . K^2 + cross K_v K_p at several points, with all coefficients rounded in one
    direction."""

    constant: Floats  # shape (points,)
    linear: tuple[Floats, Floats] | None = None  # coefficients of K_v and of K_p, each of shape (points,); None for 0
    square: tuple[Floats, Floats] | None = None
    cross: Floats | None = None  # mixed coefficient, shape (points,)

    def at(self, K_v: Floats, K_p: Floats) -> Floats:
        """Return the value for given gains. The rounding error of the sum may have either sign."""
        crossed = 0.0 if self.cross is None else K_v * K_p * self.cross
        return np.asarray(self.constant + self._part(K_V, K_v) + self._part(K_P, K_p) + crossed)

    def greatest(self, boxes: DesignBoxes) -> Floats:
        """Return an upper bound of the values over each box of gains, shape (boxes, points)."""
        if self.cross is not None and self.square is not None and all(np.all(square >= 0) for square in self.square):
            vertices = [(K_v, K_p) for K_v in self._ends(K_V, boxes) for K_p in self._ends(K_P, boxes)]
            values = (self._part(K_V, K_v) + self._part(K_P, K_p) + K_v * K_p * self.cross for K_v, K_p in vertices)
            return self.constant + np.maximum.reduce(list(values))
        total = self.constant + sum(np.maximum.reduce(self._extremes(axis, boxes)) for axis in (K_V, K_P))
        return total if self.cross is None else total + np.maximum(*self._crossed(boxes))

    def least(self, boxes: DesignBoxes) -> Floats:
        """Return the least value over each box of gains, shape (boxes, points)."""
        if self.cross is not None:
            return np.minimum(self._least_on_edges(boxes), self._least_inside(boxes))
        return self.constant + sum(np.minimum.reduce(self._extremes(axis, boxes)) for axis in (K_V, K_P))

    def _least_on_edges(self, boxes: DesignBoxes) -> Floats:
        zero = 0.0 * self.constant
        linear, square, least = self.linear or (zero, zero), self.square or (zero, zero), []
        cross = zero if self.cross is None else self.cross
        for axis, other in ((K_V, K_P), (K_P, K_V)):
            for end in self._ends(axis, boxes):
                slope = linear[other] + cross * end
                edge = Quadratic(self.constant + self._part(axis, end), (slope, slope), (square[other], square[other]))
                least += [edge.constant + part for part in edge._extremes(other, boxes)]
        return np.minimum.reduce(least)

    def _least_inside(self, boxes: DesignBoxes) -> Floats:
        """Return the value at the point with both partial derivatives 0, if it is a minimum inside the box; else
        inf."""
        if self.square is None or self.linear is None or self.cross is None:
            return np.full((1, 1), np.inf)
        (v, p), (vv, pp), cross = self.linear, self.square, self.cross
        bent = 4 * vv * pp - cross * cross
        K_v, K_p = (cross * p - 2 * pp * v) / bent, (cross * v - 2 * vv * p) / bent
        inside = (bent > 0) & (vv > 0)
        for gain, axis in ((K_v, K_V), (K_p, K_P)):
            low, high = self._ends(axis, boxes)
            inside = inside & (low <= gain) & (gain <= high)
        value = self.constant + self._part(K_V, K_v) + self._part(K_P, K_p) + K_v * K_p * cross
        return np.where(inside, value, np.inf)

    @staticmethod
    def _ends(axis: int, boxes: DesignBoxes) -> tuple[Floats, Floats]:
        return boxes.low[axis][:, None], boxes.high[axis][:, None]

    def _extremes(self, axis: int, boxes: DesignBoxes) -> list[Floats]:
        """Return the contribution of a gain at both ends of the boxes, and at the point at which its derivative is
        0."""
        low, high = self._ends(axis, boxes)
        ends = [self._part(axis, low), self._part(axis, high)]
        if self.square is None or self.linear is None or not np.any(self.square[axis]):
            return ends
        stationary = -0.5 * self.linear[axis] / self.square[axis]
        return [*ends, self._part(axis, np.clip(np.where(np.isnan(stationary), low, stationary), low, high))]

    def _crossed(self, boxes: DesignBoxes) -> tuple[Floats, Floats]:
        (K_v, most_v), (K_p, most_p) = self._ends(K_V, boxes), self._ends(K_P, boxes)
        cross = self.cross if self.cross is not None else 0.0
        return K_v * K_p * cross, most_v * most_p * cross

    def _part(self, axis: int, gain: Floats) -> Floats:
        part = 0.0 if self.linear is None else self.linear[axis]
        return gain * (part if self.square is None else part + gain * self.square[axis])


def less(a: Quadratic, factor: Floats, b: Quadratic) -> Quadratic:
    """Return a quadratic that is at most a - factor b for all gains >= 0."""

    def difference(x: Floats | float, y: Floats | float) -> Floats:
        taken = factor * y
        return x - taken - GUARD * (np.abs(x) + np.abs(taken))

    def both(x: tuple[Floats, Floats] | None, y: tuple[Floats, Floats] | None) -> tuple[Floats, Floats] | None:
        if x is None and y is None:
            return None
        (x_v, x_p), (y_v, y_p) = x or (0.0, 0.0), y or (0.0, 0.0)
        return difference(x_v, y_v), difference(x_p, y_p)

    cross = None
    if a.cross is not None or b.cross is not None:
        cross = difference(0.0 if a.cross is None else a.cross, 0.0 if b.cross is None else b.cross)
    return Quadratic(difference(a.constant, b.constant), both(a.linear, b.linear), both(a.square, b.square), cross)


@dataclass(frozen=True, slots=True)
class BoundedQuotient:
    """A quotient of quadratics in the gains at several points: a term of the squared error, or |S|^2."""

    above: Quadratic  # numerator, rounded down
    below: Quadratic  # denominator, rounded up
    scale: float = 1.0  # factor of the quotient, rounded down

    def least(self, boxes: DesignBoxes) -> Floats:
        """Return a lower bound over each box of gains, shape (boxes, points)."""
        above = np.maximum(self.above.least(boxes), 0.0)
        bound: Floats = above * (self.scale * (1 - GUARD)) / self.below.greatest(boxes)
        return bound


@dataclass(frozen=True, slots=True)
class LeastQuotient:
    """A quotient of quadratics, bounded from below over boxes where its denominator is positive."""

    above: Quadratic  # numerator, rounded down
    below: Quadratic  # denominator, rounded up and rounded down
    below_low: Quadratic

    def least(self, boxes: DesignBoxes, guess: Floats) -> Floats:
        """Return a lower bound of the quotient over each box, at least 0."""
        most, least = self.below.greatest(boxes), np.maximum(self.below_low.least(boxes), 0.0)

        def from_guess(r: Floats) -> Floats:
            slack = less(self.above, r, self.below).least(boxes)
            more = slack / np.where(slack >= 0, most, least)
            return r + more - GUARD * (r + np.abs(more))

        first = np.fmax(guess, 0.0)
        found = np.fmax(np.fmax(from_guess(0.0 * first), from_guess(first)), 0.0)
        return np.asarray(np.fmax(from_guess(found), found))


def upper(coefficients: Coefficients, factor: int = 1) -> Quadratic:
    """Return a quadratic whose coefficients are upper bounds of the enclosed ones."""
    constant, linear, square, cross = coefficients

    def up(x: Enclosure) -> Floats:
        return factor * rounded_up(x)

    return Quadratic(
        up(constant),
        None if linear is None else (up(linear[0]), up(linear[1])),
        None if square is None else (up(square[0]), up(square[1])),
        None if cross is None else up(cross),
    )


def lower(coefficients: Coefficients) -> Quadratic:
    """Return a quadratic whose coefficients are lower bounds of the enclosed ones."""
    constant, linear, square, cross = coefficients
    return Quadratic(
        rounded_down(constant),
        None if linear is None else (rounded_down(linear[0]), rounded_down(linear[1])),
        None if square is None else (rounded_down(square[0]), rounded_down(square[1])),
        None if cross is None else rounded_down(cross),
    )


def rounded_up(x: Enclosure) -> Floats:
    """Return coefficients that exceed every enclosed number by `GUARD`."""
    return np.asarray(x.mid + x.rad + GUARD * (np.abs(x.mid) + x.rad))


def rounded_down(x: Enclosure) -> Floats:
    """Return coefficients that are below every enclosed number by `GUARD`."""
    return np.asarray(x.mid - x.rad - GUARD * (np.abs(x.mid) + x.rad))
