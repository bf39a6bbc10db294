"""Where to look on: which box is worth halving, across which row, and which combination of margins is worth a bound.

No proof depends on this module. Any other choice gives the same verdicts or leaves more undecided, and takes longer:
tests/proof/test_core.py replaces it by a bisection of every row.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from vctune.model.numbers.pair import Pair
from vctune.proof.boxes import HALF_TURN, Boxes, Integers
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.proof.enclosures.taylor import LowerBound, Taylor

LOST = -1.0  # Least nearness to a proof: a margin that would not be positive even if it rose by its whole variation
# Least relative width of an interval from frequency 0 or up to angle pi, whose distances from there no halving brings
# nearer in ratio. It is 1 at first, and falls with the fourth root of the interval
FROM_ZERO = 0.1
NEAR_ZERO = 1e-3  # Least divisor in the relative width of a row, as a share of the row's range
FREQUENCY_FIRST = 64.0  # Weight of the frequency's relative width where a margin has no bound, as next to a notch
WIDER = 0.1  # Exponent of a row's relative width in the weight of the row's cost
BLUR = 2.0  # Greatest ratio of the uncertainty from the rows that must not be halved to that from the other rows
FEW = 128  # Number of boxes up to which an array of boxes takes about as long as one box


@dataclass(frozen=True, slots=True)
class Effort:
    """How long a proof goes on."""

    max_halvings: int  # greatest number of halvings of a box
    max_boxes: int  # number of boxes of an owner after which it stays open
    few: int = FEW  # number of boxes up to which the halves are halved again before they are evaluated
    easy: int = 0  # number of boxes after which a proof changes to its later test


@dataclass(frozen=True, slots=True)
class Guide:
    """Where to look on in each of n boxes."""

    point: Floats  # place of the box where the margin is about least, shape (rows, n)
    cost: Floats  # contribution of each row to the uncertainty of the bound, shape (rows, n)
    known: Flags  # whether the margin has a bound over the box
    room: Floats  # nearness to a proof, greater than 1 if the bound is positive

    @classmethod
    def nearest(cls, guides: Sequence[Guide]) -> Guide:
        """Return, for each box, the guide that is nearest to a proof."""
        room = np.array([guide.room for guide in guides])
        which, at = np.argmax(room, axis=0), np.arange(room.shape[1])
        each = (np.stack([getattr(guide, field.name) for guide in guides]) for field in fields(cls))
        return cls(*(columns[which, ..., at].T for columns in each))


def guide_of(number: Taylor, boxes: Boxes, least: LowerBound, *, alone: bool) -> Guide:
    """Return the guide to boxes over which a margin is bounded, the only one of the claim or one of several."""
    varied, width = boxes.varied(), boxes.high - boxes.low
    at, lost = np.zeros_like(width), np.zeros_like(width)
    at[varied], lost[varied] = least.at, least.cost
    varies = lost.copy()
    varies[varied] += np.abs(number.coefficients[1 : 1 + number.row_count])
    known, relative = np.isfinite(least.bound), _relative(boxes)
    # a margin that is one of several may be negative: where its estimate is, other parts of the box are for the others
    cost = np.where(alone | (least.estimate > 0), lost, varies) * relative**WIDER
    relative[0] *= np.where(boxes.low[0] > 0, FREQUENCY_FIRST, 1.0)
    room = _room_left(least.estimate, least.estimate - least.bound, varies.sum(axis=0))
    room[number.enclosed().negative()] = -np.inf
    return Guide(
        0.5 * (boxes.low + boxes.high + width * at),
        np.where(width > 0, np.where(known, cost, relative), 0.0),
        known,
        room,
    )


def may_help(boxes: Boxes, guide: Guide, may: Flags) -> Flags:
    """Return whether halving may prove a box: its rows have a width, and those that must not be halved do not blur it.

    `may` says which rows may be halved.
    """
    cost = _known(guide.cost)
    blurred = guide.known & (cost[~may].sum(axis=0) > BLUR * cost[may].max(axis=0))
    return np.asarray(~blurred & np.any(boxes.low < boxes.high, axis=0))


def rows_to_halve(cost: Floats, may: Flags, few: int) -> Iterator[Integers]:
    """Yield the row across which to halve each box, the costliest, and again for the halves while they are few."""
    cost = _known(cost)
    while True:
        axis, at = np.flatnonzero(may)[np.argmax(cost[may], axis=0)], np.arange(cost.shape[1])
        yield axis
        if not 0 < 2 * cost.shape[1] <= few:
            return
        cost[axis, at] /= 2
        cost = np.tile(cost, 2)


def weights_of_mean(a: Taylor, b: Taylor) -> tuple[Floats, Floats]:
    """Return the weights, at least 0, of the mean of two margins whose linear part has the greatest lower bound."""
    one, two = (affine / np.abs(affine).sum(axis=0) for affine in (x.coefficients[: 1 + x.row_count] for x in (a, b)))
    first, other = one[1:], two[1:]
    weights = np.nan_to_num(np.clip(other / (other - first), 0.0, 1.0), nan=0.5)
    mixed = weights[:, None] * one + (1 - weights[:, None]) * two
    least = mixed[:, 0] - np.abs(mixed[:, 1:]).sum(axis=1)
    weight = np.take_along_axis(weights, np.argmax(least, axis=0)[None], axis=0)[0]
    sizes = [np.abs(x.coefficients[: 1 + x.row_count]).sum(axis=0) for x in (a, b)]
    return weight / sizes[0], (1 - weight) / sizes[1]


def direction(value: Pair) -> Floats:
    """Return the direction in which the linear part of a curve has the greatest lower bound, shape (2, n).

    It is that of the curve's middle, or it is across the curve's slope in one of the rows.
    """
    re, im = (part.coefficients[: 1 + part.row_count] for part in (value.re, value.im))
    middle, slopes = np.stack((re[0], im[0])), np.stack((re[1:], im[1:]))
    across = np.stack((-slopes[1], slopes[0])) * np.sign(slopes[0] * im[0] - slopes[1] * re[0])
    directions = np.concatenate((middle[:, None], across), axis=1)
    directions = directions / np.hypot(*directions)
    along = (directions * middle[:, None]).sum(axis=0)
    spread = np.abs(np.einsum("din,dkn->ikn", directions, slopes)).sum(axis=1)
    best = np.argmax(np.nan_to_num(along - spread, nan=-np.inf), axis=0)
    return np.asarray(directions[:, best, np.arange(best.size)])


def _room_left(value: Floats, uncertain: Floats, reach: Floats) -> Floats:
    """Return how near a margin is to a proof."""
    return np.nan_to_num(np.where(value > 0, value / uncertain, np.maximum(value / reach, LOST)), nan=0.0)


def _relative(boxes: Boxes) -> Floats:
    """Return the width of each row, relative to the row's values or to `NEAR_ZERO` of its range, the greater one."""
    sizes = np.abs(boxes.low) + np.abs(boxes.high) + NEAR_ZERO * boxes.spans
    sizes[0] = np.abs(boxes.low[0]) + np.abs(boxes.high[0])
    relative, width = (boxes.high - boxes.low) / sizes, boxes.high[0] - boxes.low[0]
    for at_end, whole in ((boxes.low[0] == 0, boxes.spans[0]), (boxes.high[0] == HALF_TURN, HALF_TURN)):
        relative[0] = np.where(at_end, np.maximum((width / whole) ** 0.25, FROM_ZERO), relative[0])
    return np.asarray(relative)


def _known(cost: Floats) -> Floats:
    return np.where(np.isnan(cost), np.inf, cost)
