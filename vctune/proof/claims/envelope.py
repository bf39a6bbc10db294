"""A proved upper bound of the resistance that a coupling needs in hands: straight pieces over the angle."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import lru_cache

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import KEYS
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import loop_in_hand, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.boxes import FREQUENCY, Boxes, Cells, Values, band_of, first_boxes, over_cells
from vctune.proof.claims.array_claims import OFFSET, SLOPE, bounded_in_any_hand, bounded_in_hands
from vctune.proof.claims.margins_of_claims import HALF_TURN
from vctune.proof.enclosures.intervals import Floats, decimal
from vctune.proof.prover import Effort, Proofs, positive, prove

STEP = 1.05  # Ratio of the edges of a piece
# Shares of each range of the hands at which the code evaluates R before it proves a piece
SHARES = (0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)
WITHIN = 5  # Number of angles of a piece at which the code evaluates R
# Relative amount by which the first attempt raises a piece above the evaluated hands, and factor of this amount from
# one attempt to the next
SLACK, RAISED = 5e-3, 4.0
SMALL = 1e-4  # Share of the greatest bound
ATTEMPTS = 10  # Number of attempts to prove a piece
# Greatest number of halvings of a box of angle and hand, and number of boxes for a piece in the first attempt
MAX_HALVINGS, MAX_BOXES = 40, 250


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
def envelope(device: Device, hands: Hands | None, gains: Gains) -> Envelope:
    """Bound R from above in all hands, by a straight line over each piece of the angle."""
    low, high = band_of(0.0, HALF_TURN, STEP)
    theta = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, WITHIN)
    some = _some_of(hands) if hands is not None else None
    # where R <= 0, also where R is -inf, a coupling may be arbitrarily small: the bound is 0 there
    asked = np.fmax(_required(device, some, gains, theta.ravel()), 0.0).max(axis=0)
    seen = asked.reshape(theta.shape)
    slope = (seen[:, -1] - seen[:, 0]) / (high - low)
    above, scale = (seen - slope[:, None] * theta).max(axis=1), np.maximum(seen.max(axis=1), SMALL * seen.max())
    offset, left, boxes = np.full(len(low), np.inf), np.flatnonzero(np.isfinite(above)), 0
    for attempt in range(ATTEMPTS):
        if not len(left):
            break
        tried = above + RAISED**attempt * SLACK * scale
        pieces = np.stack((low, high, tried, slope))[:, left]
        found = _proved(device, hands, gains, pieces, 2**attempt * MAX_BOXES)
        boxes += int(found.boxes.sum())
        done = left[found.proved]
        offset[done] = tried[done]
        fails = np.flatnonzero(np.isfinite(found.failing[0]))
        if len(fails):
            there = dict(zip(found.names, found.failing[:, fails], strict=True))
            higher, at = left[fails], there[FREQUENCY]
            asked_there = _required(device, Hand.of(there) if hands is not None else None, gains, at)
            above[higher] = np.fmax(above[higher], np.ravel(asked_there) - slope[higher] * at)
        left = left[~found.proved]
    return Envelope(low, high, offset, slope, boxes)


def _some_of(hands: Hands) -> Hand:
    """Return a sample of the hands of a box, with numbers of shape (h, 1)."""
    places = (np.unique(a + (b - a) * np.array(SHARES)) for a, b in hands.ranges.values())
    return Hand(*(number.reshape(-1, 1) for number in np.meshgrid(*places, indexing="ij")))


def _required(device: Device, hand: Hand | None, gains: Gains, theta: Floats) -> Floats:
    """Return R at angles of shape (n,): shape (h, n) in hands of shape (h, 1), or shape (1, n) in any hand."""
    delays = delays_of(device)
    if hand is None:
        found = any_hand(device, delays.loop, theta[None], FLOATS, fractional=delays.loop_fractional).required(gains)
        return np.asarray(np.where(found.size > 0, found.lost / found.size, np.inf))
    found = required_in_hand(loop_in_hand(plant_in_hand(device, hand, delays, FLOATS), theta, FLOATS), gains)
    return np.asarray(found.lost / found.size)


def _proved(device: Device, hands: Hands | None, gains: Gains, pieces: Floats, max_boxes: int) -> Proofs:
    """Prove the bound of some pieces, given as rows low, high, offset and slope."""
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
    fixed: Values = dict(zip(KEYS[:2], map(decimal, astuple(gains)), strict=True))
    test = positive(bounded_in_any_hand(device) if hands is None else bounded_in_hands(device), fixed)
    halved = [name not in (OFFSET, SLOPE) for name in names]
    return prove(test, boxes, n, Effort(MAX_HALVINGS, max_boxes, few=0), halved=halved)
