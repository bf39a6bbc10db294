"""Quadratics in two variables, usually the gains, and their quotients: bounds of them over many boxes at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vctune.model.loop.loop import Affine
from vctune.model.numbers.arithmetic import Number
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import Enclosure, Floats, stacked

# Allowance for the rounding of a quadratic in the gains and of the operations after it, relative to their moduli
GUARD = 1e-14
K_V, K_P, TAU_C, B_0 = range(4)  # Rows of the boxes; tau_c is m_c/b_c, or b_c/k_c of an impedance display


def products(of: Callable[..., Number], a: Affine, b: Affine, *, crossed: bool = True) -> list[Number]:
    """Return a real product of two numbers that are affine in the gains: the coefficients of 1, K_v, K_p, K_v^2, K_p^2
    and K_v K_p. A coefficient that vanishes is the float 0, as is the last one unless `crossed`."""

    def product(*pairs: tuple[Number, Number]) -> Number:
        found = [of(x, y) for x, y in pairs if x is not None and y is not None]
        return sum(found[1:], start=found[0]) if found else 0.0

    return [
        product((a.constant, b.constant)),
        product((a.constant, b.velocity), (a.velocity, b.constant)),
        product((a.constant, b.position), (a.position, b.constant)),
        product((a.velocity, b.velocity)),
        product((a.position, b.position)),
        product((a.velocity, b.position), (a.position, b.velocity)) if crossed else 0.0,
    ]


def concatenated(parts: Sequence[Enclosure]) -> Enclosure:
    """Return the rows of several devices as longer rows, one device after another."""
    return Enclosure(*(np.concatenate(each, axis=-1) for each in zip(*((x.mid, x.rad) for x in parts), strict=True)))


# Coefficients in the order of `products`, of shape (points,) or (boxes, points); the float 0 where all vanish
Coefficients = list[Any]


@dataclass(frozen=True, slots=True)
class Quadratic:
    """Enclosed quadratics at several points."""

    low: Coefficients  # each below the enclosed numbers by `GUARD`
    high: Coefficients  # each above the enclosed numbers by `GUARD`

    def least(self, boxes: Cells) -> Floats:
        """Return a lower bound of the values over each box of gains, shape (boxes, points)."""
        return least(self.low, boxes)

    def greatest(self, boxes: Cells) -> Floats:
        """Return an upper bound of the values over each box of gains, shape (boxes, points)."""
        c, v, p, vv, pp, vp = self.high
        of_v, of_p = _ends(boxes, K_V), _ends(boxes, K_P)
        if np.any(vp) and np.all(vv >= 0) and np.all(pp >= 0):  # convex along each axis
            return np.maximum.reduce([_value(self.high, K_v, K_p) for K_v in of_v for K_p in of_p])
        most = c + np.maximum.reduce(_extremes(v, vv, of_v)) + np.maximum.reduce(_extremes(p, pp, of_p))
        return most + np.maximum(of_v[0] * of_p[0] * vp, of_v[1] * of_p[1] * vp) if np.any(vp) else most


def quadratic(coefficients: Enclosure | Sequence[Number]) -> Quadratic:
    """Return quadratics with enclosed coefficients."""
    x = coefficients if isinstance(coefficients, Enclosure) else stacked(coefficients)
    guard = GUARD * (np.abs(x.mid) + x.rad)
    low, high = x.mid - x.rad - guard, x.mid + x.rad + guard
    return Quadratic(*([side[0], *(row if np.any(row) else 0.0 for row in side[1:])] for side in (low, high)))


def least(coefficients: Coefficients, boxes: Cells) -> Floats:
    """Return the least value of quadratics over each box of gains."""
    c, v, p, vv, pp, vp = coefficients
    of_v, of_p = _ends(boxes, K_V), _ends(boxes, K_P)
    if not np.any(vp):
        return c + np.minimum.reduce(_extremes(v, vv, of_v)) + np.minimum.reduce(_extremes(p, pp, of_p))
    edges = [c + _part(v, vv, K_v) + x for K_v in of_v for x in _extremes(p + vp * K_v, pp, of_p)]
    edges += [c + _part(p, pp, K_p) + x for K_p in of_p for x in _extremes(v + vp * K_p, vv, of_v)]
    bent = 4 * vv * pp - vp * vp  # > 0 with vv > 0: a minimum where both partial derivatives are 0
    K_v, K_p = (vp * p - 2 * pp * v) / bent, (vp * v - 2 * vv * p) / bent
    inside = (bent > 0) & (vv > 0) & (of_v[0] <= K_v) & (K_v <= of_v[1]) & (of_p[0] <= K_p) & (K_p <= of_p[1])
    return np.minimum(np.minimum.reduce(edges), np.where(inside, _value(coefficients, K_v, K_p), np.inf))


def _value(coefficients: Coefficients, K_v: Floats, K_p: Floats) -> Floats:
    c, v, p, vv, pp, vp = coefficients
    return np.asarray(c + _part(v, vv, K_v) + _part(p, pp, K_p) + K_v * K_p * vp)


def _part(linear: Any, square: Any, gain: Floats) -> Floats:
    return gain * (linear + gain * square)


def _ends(boxes: Cells, row: int) -> tuple[Floats, Floats]:
    return boxes.low[row][:, None], boxes.high[row][:, None]


def _extremes(linear: Any, square: Any, ends: tuple[Floats, Floats]) -> list[Floats]:
    """Return the part of one gain at both ends, and at the point of the box nearest to where its derivative is 0."""
    found = [_part(linear, square, end) for end in ends]
    if np.any(square):
        found.append(_part(linear, square, np.clip(np.nan_to_num(-0.5 * linear / square), *ends)))
    return found


def less(a: Quadratic, factor: Floats, b: Quadratic) -> Coefficients:
    """Return the coefficients of quadratics that are at most a - factor b for all gains >= 0."""
    taken = [factor * y if np.ndim(y) else 0.0 for y in b.high]
    return [x - y - GUARD * (np.abs(x) + np.abs(y)) for x, y in zip(a.low, taken, strict=True)]


@dataclass(frozen=True, slots=True)
class Quotient:
    """Quotients of quadratics at several points."""

    above: Quadratic
    below: Quadratic

    def of_bounds(self, boxes: Cells) -> Floats:
        """Return a lower bound over each box of a quotient whose two parts are >= 0, from the bounds of the parts."""
        return np.asarray(np.maximum(self.above.least(boxes), 0.0) * (1 - GUARD) / self.below.greatest(boxes))

    def least(self, boxes: Cells, at: tuple[Floats, Floats] | None = None) -> Floats:
        """Return a closer lower bound, at least 0, over boxes where the denominator is positive; it begins with the
        value at some gains of each box, by default those in the middle."""
        most, least_below = self.below.greatest(boxes), np.maximum(self.below.least(boxes), 0.0)
        gains = at or tuple(0.5 * (boxes.low[row] + boxes.high[row])[:, None] for row in (K_V, K_P))

        def from_guess(r: Floats) -> Floats:
            slack = least(less(self.above, r, self.below), boxes)
            more = slack / np.where(slack >= 0, most, least_below)
            return r + more - GUARD * (r + np.abs(more))

        first = np.fmax(_value(self.above.low, *gains) / _value(self.below.high, *gains), 0.0)
        found = np.fmax(np.fmax(from_guess(0.0 * first), from_guess(first)), 0.0)
        return np.asarray(np.fmax(from_guess(found), found))
