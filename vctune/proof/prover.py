"""The sound core: why every verdict about a continuum is right.

A claim is about all points of some boxes: frequencies, hands, devices, gains. A test bounds the claim's margin over
each box from below (`bounded`) and evaluates it at a point (`negative_at`), both with every rounding enclosed. Then

- *proved*: a box leaves the list only with a bound above 0, or because it contains no point of the claim (`narrowed`),
  or for halves that cover it. When the list is empty, the margin is positive at every point of the first boxes. An
  owner is unproved until then, and one without boxes for ever;
- *refuted*: the margin is certainly negative at one point of a box;
- everything else is undecided: a box that is left when the effort ends is never counted as proved.

`halving` says where to look on and `box_tests` combines tests. No verdict depends on what `halving` returns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.proof import halving
from vctune.proof.boxes import Boxes, Integers, chunks
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.proof.enclosures.taylor import Taylor, least_over_boxes
from vctune.proof.halving import Effort, Guide
from vctune.running import most_boxes, report_progress


@dataclass(frozen=True, slots=True)
class Decided:
    """The result of a test of n boxes."""

    proved: Flags  # whether the claim holds throughout the box
    fails: Flags  # whether the claim fails at `guide.point`
    guide: Guide  # where to look on


Test = Callable[[Boxes], Decided]


@dataclass(frozen=True, slots=True)
class Proofs:
    """The result of a claim for each owner of boxes."""

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
    effort: Effort,
    measure: Callable[[Boxes], Floats] | None = None,
    *,
    later: Test | None = None,
    halved: Sequence[bool] | None = None,
    only_whole: bool = False,
) -> Proofs:
    """Test boxes and halve those that stay open, until each owner is proved or fails, or the effort ends.

    After `effort.easy` boxes the test is `later`. `halved` says across which rows. With `only_whole`, an owner of which
    one box stays open is given up.
    """
    may = np.ones(len(boxes.names), bool) if halved is None else np.asarray(halved)
    failing, open_ = np.full((2, len(boxes.names), owners), np.nan)
    unproved = boxes.count(owners) == 0
    fails = np.zeros(owners, bool)
    count, total, covered = np.zeros(owners, np.intp), np.zeros(owners), float(len(boxes))
    for again in range(effort.max_halvings + 1):
        if not len(boxes):
            break
        report_progress(partial("{} boxes, {:.1%} proved".format, count.sum(), 1 - len(boxes) / covered))
        count += boxes.count(owners)
        found = tested_in_chunks(test if later is None or count.sum() <= effort.easy else later, boxes)
        failing[:, boxes.owner[found.fails]] = found.guide.point[:, found.fails]
        fails[boxes.owner[found.fails]] = True
        if measure is not None and found.proved.any():
            np.add.at(total, boxes.owner[found.proved], measure(boxes.subset(found.proved)))
        hopeful = ~fails & (count < min(effort.max_boxes, most_boxes())) & (again < effort.max_halvings)
        goes_on = ~found.proved & hopeful[boxes.owner] & halving.may_help(boxes, found.guide, may)
        stays = ~found.proved & ~goes_on
        unproved[boxes.owner[stays]] = True
        open_[:, boxes.owner[stays]] = found.guide.point[:, stays]
        if only_whole:
            goes_on &= ~unproved[boxes.owner]
        kept = boxes = boxes.subset(goes_on)
        for row in halving.rows_to_halve(found.guide.cost[:, goes_on], may, effort.few):
            boxes = boxes.halved(row)
        covered *= len(boxes) / max(len(kept), 1)
    return Proofs(boxes.names, ~unproved & ~fails, failing=failing, open=open_, boxes=count, total=total)


def bounded(number: Taylor, boxes: Boxes, *, alone: bool) -> Decided:
    """Prove the boxes over which a margin has a positive lower bound; it may be the only margin of the claim."""
    least = least_over_boxes(number)
    guide = halving.guide_of(number, boxes, least, alone=alone)
    within = replace(guide, point=np.clip(guide.point, boxes.low, boxes.high))
    return Decided(least.bound > 0, np.zeros(len(boxes), bool), within)


def narrowed(test: Test, narrow: Callable[[Boxes], tuple[Boxes, Flags]]) -> Test:
    """Return the test of a claim about some points of the boxes.

    `narrow` returns the boxes without some of the other points, and which of them contain no point of the claim; these
    are proved.
    """

    def without_points(boxes: Boxes) -> Decided:
        holds, rows = np.ones(len(boxes), bool), np.zeros_like(boxes.low)
        return Decided(holds, ~holds, Guide(rows, rows, holds, np.full(len(boxes), np.inf)))

    def decided(boxes: Boxes) -> Decided:
        left, empty = narrow(boxes)
        return by_kind(empty, without_points, test, left)

    return decided


def by_kind(kind: Flags, test: Test, other: Test, boxes: Boxes) -> Decided:
    """Test the boxes of one kind by one test, and those of the other kind by another."""
    if kind.all() or not kind.any():
        return (test if kind.any() else other)(boxes)
    some, rest = np.flatnonzero(kind), np.flatnonzero(~kind)
    order = np.argsort(np.concatenate((some, rest)))
    both = [test(boxes.subset(some)), other(boxes.subset(rest))]
    return each_column(lambda columns: np.concatenate(columns, axis=-1)[..., order], both)


def negative_at(numbers: Sequence[Taylor]) -> Flags:
    """Return whether all margins of a claim, each over a box that is one point, are certainly negative there."""
    return np.asarray(np.all([number.enclosed().negative() for number in numbers], axis=0))


def tested_in_chunks(test: Test, boxes: Boxes) -> Decided:
    """Test boxes, a chunk at a time."""
    return each_column(partial(np.concatenate, axis=-1), [test(chunk) for chunk in chunks(boxes)])


def each_column(f: Callable[[Sequence[NDArray[Any]]], NDArray[Any]], found: Sequence[Decided]) -> Decided:
    """Apply a function to each array of several results."""
    guide = Guide(*(f([getattr(each.guide, name) for each in found]) for name in Guide.__slots__))
    return Decided(f([each.proved for each in found]), f([each.fails for each in found]), guide)
