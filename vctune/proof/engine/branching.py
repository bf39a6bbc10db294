"""One prover for all claims over boxes. It halves an undecided box across the row that contributes most to the
uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial

import numpy as np

from vctune.proof.enclosures.array_intervals import Flags, Floats
from vctune.proof.engine.boxes import CHUNK, Boxes, Integers, joined
from vctune.running import check_time, report_progress

# Greatest ratio of the uncertainty from the rows that the prover must not halve to the uncertainty from the other rows
BLUR = 2.0
_MOST: ContextVar[float] = ContextVar("most boxes", default=np.inf)


@contextmanager
def boxes_at_most(number: int) -> Iterator[None]:
    """Limit the boxes of each proof within the block: many proofs that may stay open, the same on every machine."""
    token = _MOST.set(number)
    try:
        yield
    finally:
        _MOST.reset(token)


@dataclass(frozen=True, slots=True)
class Decided:
    """The result of a test of boxes."""

    proved: Flags  # whether the claim holds throughout the box
    fails: Flags  # whether the claim fails at `point`
    point: Floats  # a point of each box, shape (rows, n)
    cost: Floats  # contribution of each row to the uncertainty of each box, shape (rows, n)
    known: Flags  # whether the test has slopes or polynomials with a bound
    side: Floats  # end of each row at which the margin is least for all values of the other rows, -1 or 1
    room: Floats  # nearness to a proof, greater than 1 if the test proves the claim


Test = Callable[[Boxes], Decided]


@dataclass(frozen=True, slots=True)
class Proofs:
    """The result of a claim for each owner."""

    names: tuple[str, ...]  # names of the rows of `failing` and `open`
    proved: Flags  # whether the claim holds on all boxes of an owner, shape (owners,)
    failing: Floats  # a point at which the claim fails, shape (rows, owners); nan if the prover found none
    open: Floats  # a point of a box that the prover left open, shape (rows, owners); nan if there is none
    boxes: Integers  # number of boxes that the prover evaluated
    total: Floats  # sum of `measure` over the proved boxes


@np.errstate(all="ignore")
def prove(
    test: Test,
    boxes: Boxes,
    owners: int,
    *,
    halved: Sequence[bool],
    max_halvings: int,
    max_boxes: int,
    measure: Callable[[Boxes], Floats] | None = None,
    at_ends: bool = False,
    few: int = 0,
    only_whole: bool = False,
) -> Proofs:
    """Test boxes and halve those that stay undecided, until each owner is proved or fails, or the effort ends."""
    names, shape, most = boxes.names, (len(boxes.names), owners), min(max_boxes, _MOST.get())
    failing, open_ = np.full(shape, np.nan), np.full(shape, np.nan)
    count, total = np.zeros(owners, np.intp), np.zeros(owners)
    first = float(len(boxes))
    for again in range(max_halvings + 1):
        if not len(boxes):
            break
        report_progress(partial(_stage, count.sum(), len(boxes) / first))
        count += boxes.count(owners)
        decided = _in_chunks(test, boxes)
        failing[:, boxes.owner[decided.fails]] = decided.point[:, decided.fails]
        if measure is not None and decided.proved.any():
            np.add.at(total, boxes.owner[decided.proved], measure(boxes.subset(decided.proved)))
        blurred = _blurred(decided, np.asarray(halved))
        hopeful = np.isnan(failing[0]) & (count < most) & (again < max_halvings)
        left = ~decided.proved
        if at_ends:
            boxes = boxes.ends(decided.side)
            blurred |= ~np.any(boxes.low < boxes.high, axis=0)
        goes_on = left & ~blurred & hopeful[boxes.owner]
        stays = left & ~goes_on
        open_[:, boxes.owner[stays]] = decided.point[:, stays]
        if only_whole:
            goes_on &= np.isnan(open_[0, boxes.owner])
        kept = boxes.subset(goes_on)
        (boxes,) = _halved([kept], decided.cost[:, goes_on], np.asarray(halved), few)
        first *= len(boxes) / max(len(kept), 1)
    proved = np.isnan(open_[0]) & np.isnan(failing[0])
    return Proofs(names, proved, failing=failing, open=open_, boxes=count, total=total)


@np.errstate(all="ignore")
def left_open(
    test: Test, boxes: Boxes, *, max_boxes: int, share: float = 1.0, growth: float = np.inf, few: int = 0
) -> tuple[Boxes, int]:
    """Halve the boxes in which a test does not prove the claim, until the test decides all boxes or further halvings
    promise little."""
    halved, faces, count, settled = np.ones(len(boxes.low), bool), boxes, 0, list[Boxes]()
    whole, any_proved = boxes, False
    most = growth * len(boxes)
    while len(boxes):
        decided = _in_chunks(test, faces)
        count += len(boxes)
        any_proved |= bool(decided.proved.any())
        faces = faces.ends(decided.side)
        single = ~np.any(faces.low < faces.high, axis=0)
        left, lost = ~decided.proved, np.isneginf(decided.room) | single
        settled.append(boxes.subset(left & lost))
        goes_on = left & ~lost
        boxes, faces, enough = boxes.subset(goes_on), faces.subset(goes_on), _share(decided.fails, left) >= share
        if enough or len(boxes) > most or count >= max_boxes:
            break
        boxes, faces = _halved([boxes, faces], decided.cost[:, goes_on], halved, few)
    return (joined(*settled, boxes) if any_proved else whole), count


def _share(some: Flags, among: Flags) -> float:
    return float(some[among].mean()) if among.any() else 1.0


def _blurred(decided: Decided, halved: Flags) -> Flags:
    """Return whether halving a box would not help, because the rows that the prover must not halve blur its margin."""
    cost = _known(decided.cost)
    return np.asarray(decided.known & (cost[~halved].sum(axis=0) > BLUR * cost[halved].max(axis=0)))


def _known(cost: Floats) -> Floats:
    return np.where(np.isnan(cost), np.inf, cost)


def _costliest(cost: Floats, halved: Flags) -> Integers:
    """Return the row that contributes most to each box's uncertainty, among the rows that the prover may halve."""
    return np.asarray(np.flatnonzero(halved)[np.argmax(cost[halved], axis=0)])


def _halved(sets: Sequence[Boxes], cost: Floats, halved: Flags, few: int) -> list[Boxes]:
    """Return the halves of each box of several sets, which the function cuts in the same way."""
    cost, sets = _known(cost), list(sets)
    while True:
        axis, at = _costliest(cost, halved), np.arange(cost.shape[1])
        sets = [boxes.halved(axis) for boxes in sets]
        if not 0 < len(sets[0]) <= few:
            return sets
        cost[axis, at] /= 2
        cost = np.tile(cost, 2)


def _stage(boxes: int, open_: float) -> str:
    """Return the progress of a proof."""
    return f"{boxes} boxes, {1 - open_:.1%} proved"


def _in_chunks(test: Test, boxes: Boxes) -> Decided:
    parts = []
    for i in range(0, len(boxes), CHUNK):
        check_time()
        parts.append(test(boxes.subset(slice(i, i + CHUNK))))
    return Decided(*(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in Decided.__slots__))
