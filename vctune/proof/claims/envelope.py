"""Bound R in all hands by straight lines over pieces of the angle, once for all cells of designs with equal gains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from math import inf

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import Number
from vctune.model.sampled.impedance_display import Required
from vctune.proof.box_tests import positive
from vctune.proof.boxes import FREQUENCY, HALF_TURN, Boxes, Cells, band_of, first_boxes, over_cells
from vctune.proof.claims.cases import Case, case_at, over, values_of
from vctune.proof.claims.covered import CELL, Covered
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats
from vctune.proof.halving import Effort
from vctune.proof.prover import Proofs, prove

# The names of the rows of a straight line that bounds R in all hands
OFFSET, SLOPE = "offset of the bound", "slope of the bound"
PIECE_RATIO = 1.05  # Ratio of the edges of a piece
# Shares of each range of the hands at which the code evaluates R before it proves a piece
TRIED_SHARES = (0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)
WITHIN = 5  # Number of angles of a piece at which the code evaluates R
# Relative amount by which the first attempt raises a piece above the evaluated hands, and factor of this amount from
# one attempt to the next
SLACK, RAISED = 5e-3, 4.0
SMALL = 1e-4  # Share of the greatest bound
ATTEMPTS = 10  # Number of attempts to prove a piece
# Greatest number of halvings of a box of angle and hand, and number of boxes for a piece in the first attempt
MAX_HALVINGS, MAX_BOXES = 40, 250


Requires = Callable[[Case, Number], Required]  # what hands require of the coupling


@dataclass(frozen=True, slots=True)
class Envelope:
    """An upper bound of R in all hands of a box, or in any hand: offset + slope theta on each of n pieces."""

    low: Floats  # edges of the pieces, rad, shape (n,)
    high: Floats
    offset: Floats  # N s/m and N s/(m rad), shape (n,)
    slope: Floats
    boxes: int  # number of boxes of the proof

    def over(self, cells: Cells) -> Boxes:
        """Return a box for every pair of a piece and a cell. Two rows for the bound precede the rows of the cell."""
        boxes, rows = over_cells(cells, (self.low, self.high)), np.tile([self.offset, self.slope], len(cells))
        low, high = (np.vstack((edge[:1], rows, edge[1:])) for edge in (boxes.low, boxes.high))
        return first_boxes((FREQUENCY, OFFSET, SLOPE, *cells.keys), low, high, boxes.owner, boxes.whole_samples)


@lru_cache(maxsize=16)
@np.errstate(all="ignore")
def envelope(device: Device, hands: Hands | None, gains: Gains, required: Requires) -> Envelope:
    """Bound R from above in all hands, by a straight line over each piece of the angle."""
    asks = Demands(device, (0.0, inf), 1.0, inf, passive=False, any_hand=hands is None, hands=hands)
    low, high = band_of(0.0, HALF_TURN, PIECE_RATIO)
    theta = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, WITHIN)
    some = _some_of(hands) if hands is not None else None
    # where R <= 0, also where R is -inf, a coupling may be arbitrarily small: the bound is 0 there
    asked = np.fmax(_resistance(required, asks, some, gains, theta.ravel()), 0.0).max(axis=0)
    seen = asked.reshape(theta.shape)
    slope = (seen[:, -1] - seen[:, 0]) / (high - low)
    above, scale = (seen - slope[:, None] * theta).max(axis=1), np.maximum(seen.max(axis=1), SMALL * seen.max())
    offset, left, boxes = np.full(len(low), np.inf), np.flatnonzero(np.isfinite(above)), 0
    for attempt in range(ATTEMPTS):
        if not len(left):
            break
        tried = above + RAISED**attempt * SLACK * scale
        pieces = np.stack((low, high, tried, slope))[:, left]
        found = _below_pieces(required, asks, gains, pieces, 2**attempt * MAX_BOXES)
        boxes += int(found.boxes.sum())
        done = left[found.proved]
        offset[done] = tried[done]
        fails = np.flatnonzero(np.isfinite(found.failing[0]))
        if len(fails):
            there = dict(zip(found.names, found.failing[:, fails], strict=True))
            higher, at = left[fails], there[FREQUENCY]
            asked_there = _resistance(required, asks, Hand.of(there) if hands is not None else None, gains, at)
            above[higher] = np.fmax(above[higher], np.ravel(asked_there) - slope[higher] * at)
        left = left[~found.proved]
    return Envelope(low, high, offset, slope, boxes)


def _some_of(hands: Hands) -> Hand:
    """Return a sample of the hands of a box, with numbers of shape (h, 1)."""
    places = (np.unique(a + (b - a) * np.array(TRIED_SHARES)) for a, b in hands.ranges.values())
    return Hand(*(number.reshape(-1, 1) for number in np.meshgrid(*places, indexing="ij")))


def _resistance(required: Requires, asks: Demands, hand: Hand | None, gains: Gains, theta: Floats) -> Floats:
    """Return R at angles of shape (n,): shape (h, n) in hands of shape (h, 1), or shape (1, n) in any hand."""
    found = required(case_at(Design(asks.device, gains, Coupling(0.0, 0.0, 0.0)), asks, hand), theta)
    R = found.lost / found.size
    return np.atleast_2d(R if hand is not None else np.where(found.size > 0, R, np.inf))


def _below_pieces(required: Requires, asks: Demands, gains: Gains, pieces: Floats, max_boxes: int) -> Proofs:
    """Prove the bound of some pieces, given as rows low, high, offset and slope."""
    hands = asks.hands
    n, ends = pieces.shape[1], ({}, {}) if hands is None else (hands.low.by_key, hands.high.by_key)
    low, high = (np.array([*end.values()], float)[:, None] for end in ends)
    names = (FREQUENCY, *ends[0], OFFSET, SLOPE)
    boxes = first_boxes(
        names=names,
        low=np.vstack((pieces[:1], np.tile(low, n), pieces[2:])),
        high=np.vstack((pieces[1:2], np.tile(high, n), pieces[2:])),
        owner=np.arange(n),
        whole_samples=np.zeros(n, np.intp),
    )
    test = positive(over(partial(_below_bound, required), asks), values_of(gains))
    halved = [name not in (OFFSET, SLOPE) for name in names]
    return prove(test, boxes, n, Effort(MAX_HALVINGS, max_boxes, few=0), halved=halved)


def _below_bound(required: Requires, case: Case, theta: Number) -> Number:
    """Return |F|^2 (offset + slope theta - R), positive where R in a hand, or in any, lies below a straight line."""
    found = required(case, theta)
    return (case.values[OFFSET] + case.values[SLOPE] * theta) * found.size - found.lost


def _above_bound(case: Case, theta: Number) -> Number:
    """Return the margin by which a coupling exceeds a bound of R in all hands."""
    bound = Required(case.values[OFFSET] + case.values[SLOPE] * theta, Enclosure(1.0))
    return case.room(bound, theta)


def have_the_same_gains(cells: Covered) -> bool:
    """Return whether all cells have the same gains and differ only in the coupling."""
    # rows 0 and 1 are the gains
    return cells.extended and not np.ptp((cells.low[:2], cells.high[:2]), axis=(0, 2)).any()


def above_envelope(cells: Covered, hands: Hands | None, required: Requires) -> Flags:
    """Return the cells whose coupling exceeds a bound of R in all hands. The bound is proved once for all cells."""
    bound = envelope(cells.demands.device, hands, Gains(*map(float, cells.low[:2, 0])), required)
    boxes = bound.over(Cells(cells.low, cells.high))
    halved = (True, False, False, *[True] * len(cells.names))
    test = positive(cells.margin(_above_bound), {})
    return prove(test, boxes, cells.owners, CELL, halved=halved, only_whole=True).proved
