"""The prover: prove margins positive over boxes and curves clear of 0, and halve what stays open."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.proof.boxes import FREQUENCY, HALF_TURN, Boxes, Integers, Values, chunks, in_chunks
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats, selected
from vctune.proof.enclosures.taylor import LowerBound, Taylor, least_over_boxes, stacked, variables
from vctune.running import check_time, report_progress

# Functions of a frequency and of numbers by name
Margin = Callable[[Number, Values], Number]  # must be positive; of a tuple of numbers, one at each point
Curve = Callable[[Number, Values], Pair]  # must not be 0

LOST = -1.0  # Least nearness to a proof: a margin that would not be positive even if it rose by its whole variation
# Least relative width of an interval from frequency 0 or up to angle pi, whose distances from there no halving brings
# nearer in ratio. It is 1 at first, and falls with the fourth root of the interval
FROM_ZERO = 0.1
NEAR_ZERO = 1e-3  # Least divisor in the relative width of a row, as a share of the row's range
FREQUENCY_FIRST = 64.0  # Weight of the frequency's relative width where one of several margins has no bound
WIDER = 0.1  # Exponent of a row's relative width in the weight of the row's cost
BLUR = 2.0  # Greatest ratio of the uncertainty from the rows that must not be halved to that from the other rows
FEW = 128  # Number of boxes up to which an array of boxes takes about as long as one box

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
    """The result of a test of n boxes."""

    proved: Flags  # whether the claim holds throughout the box
    fails: Flags  # whether the claim fails at `point`
    point: Floats  # a point of each box, shape (rows, n)
    cost: Floats  # contribution of each row to the uncertainty of each box, shape (rows, n)
    known: Flags  # whether the margin has a bound over the box
    room: Floats  # nearness to a proof, greater than 1 if the test proves the claim


Test = Callable[[Boxes], Decided]


@dataclass(frozen=True, slots=True)
class Effort:
    """How long a proof goes on."""

    max_halvings: int  # greatest number of halvings of a box
    max_boxes: int  # number of boxes of an owner after which it stays open
    few: int = FEW  # number of boxes up to which the halves are halved again before they are evaluated


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
    effort: Effort,
    measure: Callable[[Boxes], Floats] | None = None,
    *,
    halved: Sequence[bool] | None = None,
    only_whole: bool = False,
) -> Proofs:
    """Test boxes and halve those that stay undecided, until each owner is proved or fails, or the effort ends."""
    names, shape, most = boxes.names, (len(boxes.names), owners), min(effort.max_boxes, _MOST.get())
    may = np.ones(len(names), bool) if halved is None else np.asarray(halved)
    failing, open_ = np.full(shape, np.nan), np.full(shape, np.nan)
    count, total = np.zeros(owners, np.intp), np.zeros(owners)
    first = float(len(boxes))
    for again in range(effort.max_halvings + 1):
        if not len(boxes):
            break
        report_progress(partial(_stage, count.sum(), len(boxes) / first))
        count += boxes.count(owners)
        decided = _in_chunks(test, boxes)
        failing[:, boxes.owner[decided.fails]] = decided.point[:, decided.fails]
        if measure is not None and decided.proved.any():
            np.add.at(total, boxes.owner[decided.proved], measure(boxes.subset(decided.proved)))
        blurred = _blurred(decided, may) | ~np.any(boxes.low < boxes.high, axis=0)
        hopeful = np.isnan(failing[0]) & (count < most) & (again < effort.max_halvings)
        left = ~decided.proved
        goes_on = left & ~blurred & hopeful[boxes.owner]
        stays = left & ~goes_on
        open_[:, boxes.owner[stays]] = decided.point[:, stays]
        if only_whole:
            goes_on &= np.isnan(open_[0, boxes.owner])
        kept = boxes.subset(goes_on)
        boxes = _halved(kept, decided.cost[:, goes_on], may, effort.few)
        first *= len(boxes) / max(len(kept), 1)
    proved = np.isnan(open_[0]) & np.isnan(failing[0])
    return Proofs(names, proved, failing=failing, open=open_, boxes=count, total=total)


def positive(margin: Margin, fixed: Values, near: Margin | None = None, rows: Sequence[str] = (FREQUENCY,)) -> Test:
    """Return the test that a margin is positive; in boxes in which all of `rows` begin at 0, `near` suffices."""

    def over(of: Margin, boxes: Boxes) -> list[Taylor]:
        numbers = variables(boxes.rows(), boxes.varied())
        return _polynomials(of(numbers[0], boxes.named(numbers, fixed)), numbers[0])

    def own(boxes: Boxes) -> Decided:
        check_time()
        numbers = over(margin, boxes)
        found = _nearest_of(numbers, boxes)
        tried = np.flatnonzero(~found.proved & (found.room < 0))
        if tried.size:
            points = replace(boxes.subset(tried), low=found.point[:, tried], high=found.point[:, tried])
            found.fails[tried] = np.all([number.enclosed().negative() for number in over(margin, points)], axis=0)
        return found

    def by_place(boxes: Boxes) -> Decided:
        assert near is not None
        at_zero = np.all([boxes.low[boxes.names.index(name)] == 0 for name in rows], axis=0)
        return _by_kind([(at_zero, lambda part: _nearest_of(over(near, part), part)), (~at_zero, own)], boxes)

    return own if near is None else by_place


def either(first: Test, other: Margin, fixed: Values, easy: int = 0) -> Test:
    """Return a test that, after `easy` boxes, also proves boxes away from frequency 0 in which both margins of another
    are positive. With `easy`, its results depend on what was tested before."""
    tested = 0

    def over(part: Boxes) -> list[Taylor]:
        numbers = variables(part.rows(), part.varied())
        return _polynomials(other(*_named(part, numbers, fixed)), numbers[0])

    def another(part: Boxes) -> Decided:
        check_time()
        margin, sign = over(part)
        found = by_polynomial(margin, part, least_over_boxes(margin), alone=True)
        unsure = ~(least_over_boxes(sign).bound > 0)
        found.proved[unsure], found.room[unsure] = False, -np.inf
        # where it is not lost, its rows are better halved than those of a margin that is negative so far
        tried = np.flatnonzero((found.room > -np.inf) & (found.room < 0))
        if tried.size:
            at = found.point[:, tried]
            lost = over(replace(part.subset(tried), low=at, high=at))[0].enclosed().negative()
            found.room[tried] = np.where(lost, -np.inf, 0.0)
        return found

    def decided(boxes: Boxes) -> Decided:
        nonlocal tested
        tested += len(boxes)
        found = first(boxes)
        left = np.flatnonzero(~found.proved & ~found.fails & (boxes.low[0] > 0))
        if tested > easy and left.size:
            _replace(found, left, nearest([_part(found, left), another(boxes.subset(left))]))
        return found

    return decided


def narrowed(test: Test, narrow: Callable[[Boxes], Boxes]) -> Test:
    """Return a test of boxes that are narrowed first. A box that then has low > high contains no point, so it is
    proved."""

    def empty(boxes: Boxes) -> Decided:
        holds, rows = np.ones(len(boxes), bool), np.zeros_like(boxes.low)
        return Decided(holds, ~holds, rows, rows, holds, np.full(len(boxes), np.inf))

    def decided(boxes: Boxes) -> Decided:
        boxes = narrow(boxes)
        crossed = np.any(boxes.low > boxes.high, axis=0)
        return _by_kind([(crossed, empty), (~crossed, test)], boxes)

    return decided


def misses_zero(curve: Curve, fixed: Values, near: Margin | None = None) -> Test:
    """Return the test that a curve misses 0: its component in some direction is positive.

    In boxes from frequency 0, a positive margin `near` suffices.
    """

    def decided(boxes: Boxes, *also: Margin) -> Decided:
        check_time()
        numbers = variables(boxes.rows(), boxes.varied())
        named = _named(boxes, numbers, fixed)
        value = curve(*named)
        re, im = _away_from_zero(value)
        margins = [value.re * re + value.im * im, *(margin(*named) for margin in also)]
        return _nearest_of(_polynomials(margins, numbers[0]), boxes)

    def by_place(boxes: Boxes) -> Decided:
        assert near is not None
        at_zero = boxes.low[0] == 0
        return _by_kind([(at_zero, lambda part: decided(part, near)), (~at_zero, decided)], boxes)

    return decided if near is None else by_place


def turned_angles(curve: Curve, fixed: Values, limit: Margin | None = None) -> Callable[[Boxes], Floats]:
    """Return the function that measures how far a curve turns around 0 over a box's frequencies.

    A curve that has no formula at frequency 0 has there its real limit.
    """

    def turn(boxes: Boxes) -> Floats:
        rows, zero = boxes.rows(), boxes.low[0] == 0
        start, stop = (curve(Enclosure(edge[0]), boxes.named(rows, fixed)) for edge in (boxes.low, boxes.high))
        if limit is not None:
            known = limit(Enclosure(boxes.low[0]), boxes.named(rows, fixed))
            start = Pair(selected(zero, known, start.re), selected(zero, Enclosure(0.0), start.im))
        cross = start.re * stop.im - start.im * stop.re
        dot = start.re * stop.re + start.im * stop.im
        sided = cross.positive() | cross.negative() | dot.positive()
        return np.where(sided, np.arctan2(cross.mid, dot.mid), np.nan)

    return turn


@np.errstate(all="ignore")
def lower_bound_over(margin: Margin, boxes: Boxes, fixed: Values) -> Floats:
    """Return a lower bound of a margin over each box."""

    def least(part: Boxes) -> Floats:
        check_time()
        numbers = variables(part.rows(), part.varied())
        return least_over_boxes(*_polynomials(margin(*_named(part, numbers, fixed)), numbers[0])).bound

    return np.asarray(in_chunks(least, boxes))


def nearest(found: Sequence[Decided]) -> Decided:
    """Return, for each box, the result of the test that is nearest to a proof."""
    if len(found) == 1:
        return found[0]
    room = np.array([each.room for each in found])
    which, at = np.argmax(room, axis=0), np.arange(room.shape[1])

    def taken(name: str) -> Any:
        return np.asarray(np.stack([getattr(each, name) for each in found])[which, ..., at].T)

    return Decided(
        proved=np.any([each.proved for each in found], axis=0),
        fails=np.zeros(len(at), bool),
        point=taken("point"),
        cost=taken("cost"),
        known=taken("known"),
        room=room[which, at],
    )


def by_polynomial(number: Taylor, boxes: Boxes, least: LowerBound, *, alone: bool) -> Decided:
    """Decide boxes by one margin. Its failure need not be a failure of the claim, unless it is alone."""
    varied, width = boxes.varied(), boxes.high - boxes.low
    at, lost = np.zeros_like(width), np.zeros_like(width)
    at[varied], lost[varied] = least.at, least.cost
    varies = lost.copy()
    varies[varied] += np.abs(number.coefficients[1 : 1 + number.row_count])
    known, relative = np.isfinite(least.bound), _relative(boxes)
    cost = np.where(alone | (least.estimate > 0), lost, varies) * relative**WIDER
    if not alone:
        relative[0] *= np.where(boxes.low[0] > 0, FREQUENCY_FIRST, 1.0)
    room = _room_left(least.estimate, least.estimate - least.bound, varies.sum(axis=0))
    room[number.enclosed().negative()] = -np.inf
    return Decided(
        proved=least.bound > 0,
        fails=np.zeros(len(boxes), bool),
        point=np.clip(0.5 * (boxes.low + boxes.high + width * at), boxes.low, boxes.high),
        cost=np.where(width > 0, np.where(known, cost, relative), 0.0),
        known=known,
        room=room,
    )


def _nearest_of(numbers: Sequence[Taylor], boxes: Boxes) -> Decided:
    """Decide boxes by several margins, one of which suffices, and by weighted means of two of them."""
    alone = len(numbers) == 1
    best = nearest([by_polynomial(number, boxes, least_over_boxes(number), alone=alone) for number in numbers])
    left = np.flatnonzero(~best.proved)
    if alone or not left.size:
        return best
    part, parts = boxes.subset(left), [number.subset(left) for number in numbers]
    means = [_best_mean(a, b) for a, b in combinations(parts, 2)]
    means_of = (by_polynomial(mean, part, least_over_boxes(mean), alone=False) for mean in means)
    _replace(best, left, nearest([_part(best, left), *means_of]))
    return best


def _part(decided: Decided, at: Integers) -> Decided:
    """Return the results on some of the boxes."""
    return Decided(*(getattr(decided, name)[..., at] for name in Decided.__slots__))


def _replace(decided: Decided, at: Integers, by: Decided) -> None:
    """Replace the results on some of the boxes, but not their failures."""
    for name in ("proved", "point", "cost", "known", "room"):
        getattr(decided, name)[..., at] = getattr(by, name)


def _best_mean(a: Taylor, b: Taylor) -> Taylor:
    """Return the weighted mean of two numbers whose linear part has the greatest lower bound."""
    one, two = (affine / np.abs(affine).sum(axis=0) for affine in (x.coefficients[: 1 + x.row_count] for x in (a, b)))
    first, other = one[1:], two[1:]
    weights = np.nan_to_num(np.clip(other / (other - first), 0.0, 1.0), nan=0.5)
    mixed = weights[:, None] * one + (1 - weights[:, None]) * two
    least = mixed[:, 0] - np.abs(mixed[:, 1:]).sum(axis=1)
    weight = np.take_along_axis(weights, np.argmax(least, axis=0)[None], axis=0)[0]
    sizes = [np.abs(x.coefficients[: 1 + x.row_count]).sum(axis=0) for x in (a, b)]
    return a * (weight / sizes[0]) + b * ((1 - weight) / sizes[1])


def _named(boxes: Boxes, rows: Sequence[Number], fixed: Values) -> tuple[Number, Values]:
    """Return the frequency and the other values of a claim by name."""
    return rows[0], boxes.named(rows, fixed)


def _away_from_zero(value: Pair) -> Floats:
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


def _polynomials(found: Number | Sequence[Number], like: Any) -> list[Taylor]:
    """Return one number or several as polynomials, also one that depends on no row."""
    numbers = found if isinstance(found, Sequence) else (found,)
    return [number if isinstance(number, Taylor) else stacked([number, like])[0] for number in numbers]


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


def _by_kind(tests: Sequence[tuple[Flags, Test]], boxes: Boxes) -> Decided:
    """Apply to each box the test for its kind."""
    present = [(kind, test) for kind, test in tests if kind.any()]
    if len(present) == 1:
        return present[0][1](boxes)
    none, zeros = np.zeros(len(boxes), bool), np.zeros_like(boxes.low)
    found = Decided(none, none.copy(), zeros, zeros.copy(), none.copy(), np.zeros(len(boxes)))
    for kind, test in present:
        decided = test(boxes.subset(kind))
        for name in Decided.__slots__:
            getattr(found, name)[..., kind] = getattr(decided, name)
    return found


def _blurred(decided: Decided, halved: Flags) -> Flags:
    """Return whether halving a box would not help, because the rows that the prover must not halve blur its margin."""
    cost = _known(decided.cost)
    return np.asarray(decided.known & (cost[~halved].sum(axis=0) > BLUR * cost[halved].max(axis=0)))


def _known(cost: Floats) -> Floats:
    return np.where(np.isnan(cost), np.inf, cost)


def _halved(boxes: Boxes, cost: Floats, halved: Flags, few: int) -> Boxes:
    """Return the halves of each box across its costliest row, and halves of these while they are few."""
    cost = _known(cost)
    while True:
        axis, at = np.flatnonzero(halved)[np.argmax(cost[halved], axis=0)], np.arange(cost.shape[1])
        boxes = boxes.halved(axis)
        if not 0 < len(boxes) <= few:
            return boxes
        cost[axis, at] /= 2
        cost = np.tile(cost, 2)


def _stage(boxes: int, open_: float) -> str:
    """Return the progress of a proof."""
    return f"{boxes} boxes, {1 - open_:.1%} proved"


def _in_chunks(test: Test, boxes: Boxes) -> Decided:
    parts = []
    for chunk in chunks(boxes):
        check_time()
        parts.append(test(chunk))
    return Decided(*(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in Decided.__slots__))
