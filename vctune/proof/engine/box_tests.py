"""Tests of boxes: that a margin is positive throughout, or that a curve misses 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.proof.enclosures.array_intervals import UNIT, Enclosure, Flags, Floats, raised
from vctune.proof.enclosures.jets import Jet, variables
from vctune.proof.engine.boxes import Boxes, Values, in_chunks
from vctune.proof.engine.branching import Decided, Test
from vctune.proof.engine.interval import WIDE
from vctune.running import check_time

# Ratio of the highest to the lowest frequency of a box below which the test tries a second margin, because this margin
# needs narrow boxes
NARROW = 1.02
# Relative width that the test assumes for an interval that begins at frequency 0, because halving never reduces its
# relative width
FROM_ZERO = 0.1


LOST = -1.0  # Value of `room` for a margin that would not be positive even if it rose by its whole variation

# A function on enclosures and jets that must be positive; its arguments are a frequency and numbers by name
Margin = Callable[[Number, Values], Number]
# A function that returns several margins; at each point one of them must be positive
Margins = Callable[[Number, Values], tuple[Number, ...]]
Curve = Callable[[Number, Values], Pair]  # A function that must not be 0
# The rows of boxes: the frequency and the uncertain numbers, one enclosure or jet over all boxes for each row
Rows = Sequence[Number]
OfRows = Callable[[Rows], Number]  # A margin as a function of the rows only; the other values are fixed


def positive(margin: Margin, fixed: Values, sufficient: Margin | None = None, below: float = 0.0) -> Test:
    """Return the test that a margin is positive, by slopes."""

    def test(boxes: Boxes) -> Decided:
        def of(margin: Margin) -> OfRows:
            return lambda rows: margin(rows[0], boxes.named(rows, fixed))

        near, rows = of(sufficient or margin), boxes.rows()
        if _from_zero(boxes):
            decided = _by_slopes(near, boxes, rows).decided
            return decided if sufficient is None else _by_sufficient(decided)
        if _wide(boxes):
            proved = of(margin)(rows).positive()
            return _to_halve_in_frequency(boxes, proved if sufficient is None else proved | near(rows).positive())
        decided = _by_slopes(of(margin), boxes, rows).decided
        narrow = boxes.high[0] < np.minimum(boxes.low[0] * NARROW, below)
        left = np.flatnonzero(~decided.proved & ~decided.fails & narrow)
        if left.size:
            part = boxes.subset(left)
            other = _by_slopes(lambda rows: (sufficient or margin)(rows[0], part.named(rows, fixed)), part, part.rows())
            # `room` stays the room of the first margin: no caller compares the rooms of this test
            decided.proved[left] = other.decided.proved
            decided.cost[:, left] = np.where(other.decided.fails, decided.cost[:, left], other.decided.cost)
        return decided

    return partial(_kind_by_kind, test)


def misses_zero(curve: Curve, fixed: Values, sufficient: Margin | None = None) -> Test:
    """Return the test that a curve misses 0."""

    def test(boxes: Boxes) -> Decided:
        def image_of(rows: Rows) -> Pair:
            return curve(rows[0], boxes.named(rows, fixed))

        rows = boxes.rows()
        image = image_of(rows)
        missed = image.re.positive() | image.re.negative() | image.im.positive() | image.im.negative()
        if sufficient is not None:
            missed |= sufficient(rows[0], boxes.named(rows, fixed)).positive()
        if missed.all() or (_wide(boxes) and not _from_zero(boxes)):
            return _to_halve_in_frequency(boxes, missed)
        middle = image_of([Enclosure(row.mid) for row in rows])
        size = np.hypot(middle.re.mid, middle.im.mid)
        re, im = middle.re.mid / size, middle.im.mid / size

        def component(rows: Rows) -> Number:
            value = image_of(rows)
            return value.re * re + value.im * im

        decided = _by_sufficient(_by_slopes(component, boxes, rows).decided)
        return replace(decided, proved=decided.proved | missed)

    return partial(_kind_by_kind, test)


def turned_angles(curve: Curve, fixed: Values) -> Callable[[Boxes], Floats]:
    """Return the function that measures how far a curve turns around 0 over a box's frequencies."""

    def turn(boxes: Boxes) -> Floats:
        rows = boxes.rows()
        start, stop = (curve(Enclosure(edge[0]), boxes.named(rows, fixed)) for edge in (boxes.low, boxes.high))
        cross = start.re * stop.im - start.im * stop.re
        dot = start.re * stop.re + start.im * stop.im
        sided = cross.positive() | cross.negative() | dot.positive()
        return np.where(sided, np.arctan2(cross.mid, dot.mid), np.nan)

    return turn


def lower_bound_over(margin: Margin, boxes: Boxes, fixed: Values) -> Floats:
    """Return a lower bound of a margin over each box."""

    def least(part: Boxes) -> Floats:
        return _by_slopes(lambda rows: margin(rows[0], part.named(rows, fixed)), part, part.rows()).least

    with np.errstate(all="ignore"):
        return np.asarray(in_chunks(least, boxes))


def next_to_zero(rows: Sequence[str], sufficient: Sequence[Margin], fixed: Values, test: Test) -> Test:
    """Return a test that uses other margins in the boxes in which all of `rows` begin at 0."""

    def there(margin: Margin, boxes: Boxes) -> Decided:
        both = [boxes.names.index(name) for name in rows]
        found = _by_slopes(lambda x: margin(x[0], boxes.named(x, fixed)), boxes, boxes.rows())
        decided = _by_sufficient(found.decided)
        decided.cost[both] = np.where(decided.known, found.reach[both], decided.cost[both])
        return decided

    tests = [partial(there, margin) for margin in sufficient]

    def by_place(boxes: Boxes) -> Decided:
        at = np.all([boxes.low[boxes.names.index(name)] == 0 for name in rows], axis=0)
        return _by_kind([(at, any_of(tests)), (~at, test)], boxes)

    return by_place


def alone(margins: Margins) -> Margin:
    """Return the single margin of a function that returns a tuple of one margin."""
    return lambda frequency, values: margins(frequency, values)[0]


def any_of(tests: Sequence[Test]) -> Test:
    """Return the test that one of several sufficient margins is positive throughout a box."""
    return lambda boxes: nearest([test(boxes) for test in tests])


def nearest(found: Sequence[Decided]) -> Decided:
    """Return, for each box, the result of the test that is nearest to a proof."""
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
        side=np.zeros_like(found[0].side),
        room=room[which, at],
    )


def _kind_by_kind(test: Test, boxes: Boxes) -> Decided:
    """Test three kinds of boxes separately: boxes from frequency 0, boxes that are wide in frequency, and others."""
    zero = boxes.low[0] == 0
    wide = (boxes.high[0] > WIDE * boxes.low[0]) & ~zero
    return _by_kind([(kind, test) for kind in (zero, wide, ~(zero | wide))], boxes)


def _by_kind(tests: Sequence[tuple[Flags, Test]], boxes: Boxes) -> Decided:
    """Apply to each box the test for its kind."""
    present = [(kind, test) for kind, test in tests if kind.any()]
    if len(present) == 1:
        return present[0][1](boxes)
    n = len(boxes)
    found = Decided(
        proved=np.zeros(n, bool),
        fails=np.zeros(n, bool),
        point=np.zeros_like(boxes.low),
        cost=np.zeros_like(boxes.low),
        known=np.zeros(n, bool),
        side=np.zeros_like(boxes.low),
        room=np.zeros(n),
    )
    for kind, test in present:
        decided = test(boxes.subset(kind))
        for name in Decided.__slots__:
            getattr(found, name)[..., kind] = getattr(decided, name)
    return found


def _from_zero(boxes: Boxes) -> bool:
    """Return whether boxes begin at frequency 0. All boxes must be of one kind (`_kind_by_kind`)."""
    return bool(boxes.low[0, 0] == 0)


def _wide(boxes: Boxes) -> bool:
    """Return whether boxes are wide in frequency. All boxes must be of one kind (`_kind_by_kind`)."""
    return bool(boxes.high[0, 0] > WIDE * boxes.low[0, 0])


def _to_halve_in_frequency(boxes: Boxes, proved: Flags) -> Decided:
    """Return a result after which the prover halves every unproved box in frequency. No box fails."""
    cost = np.zeros_like(boxes.low)
    cost[0] = 1.0
    none = np.zeros(len(boxes), bool)
    point = 0.5 * (boxes.low + boxes.high)
    room = np.where(proved, np.inf, 0.0)
    return Decided(proved, none, point, cost, none, np.zeros_like(cost), room)


def _by_sufficient(decided: Decided) -> Decided:
    """Return the result of a test of `sufficient` without its failing points and sides, which do not apply to the
    claim's own margin."""
    return replace(decided, fails=np.zeros_like(decided.fails), side=np.zeros_like(decided.side))


@dataclass(frozen=True, slots=True)
class _Bounded:
    """A lower bound of a margin over each of n boxes, shape (n,), its verdict, and how much the margin varies with each
    row, shape (rows, n)."""

    least: Floats
    decided: Decided
    reach: Floats


def _by_slopes(margin: OfRows, boxes: Boxes, rows: Sequence[Enclosure]) -> _Bounded:
    """Bound a margin from below by its value at one point of each box and by its slopes, or by its enclosure over the
    box, whichever bound is greater."""
    check_time()
    varied = boxes.varied()
    over_box = margin(variables(rows, varied))
    n, count = len(boxes), len(rows)
    side, reach = np.zeros((count, n)), np.zeros((count, n))
    direct: Enclosure = over_box.value if isinstance(over_box, Jet) else over_box
    rad, middle = halves_and_middles(rows, n)
    for row, slope in zip(np.flatnonzero(varied), over_box.slopes if isinstance(over_box, Jet) else (), strict=False):
        if slope is not None:
            side[row] = 1.0 * slope.negative() - slope.positive()
            reach[row] = (np.abs(slope.mid) + slope.rad) * rad[row]
    point = middle + side * rad
    at_point = [
        Enclosure(p, 2 * UNIT * (np.abs(p) + r)) if varies else row
        for p, r, row, varies in zip(point, rad, rows, varied, strict=True)
    ]
    least = margin(at_point)
    loose = np.where(side == 0, reach, 0.0)
    # 1 + count: the error of the value and the share of each row are summed
    bound = np.zeros(n) + np.fmax(
        lowest(least.mid, raised(least.rad + loose.sum(axis=0), 1 + count)), lowest(direct.mid, direct.rad)
    )
    fails, known = np.broadcast_to(least.negative(), n), np.asarray(np.isfinite(reach).all(axis=0))
    width = rad / np.abs(middle)
    width[0] = np.where(rad[0] >= middle[0], FROM_ZERO, width[0])
    cost = np.where(known, np.where(fails, reach, loose), width)
    cost = np.where(np.array(varied)[:, None], cost, 0.0)
    proved = np.asarray(bound > 0)
    value = np.broadcast_to(least.mid, n)
    room = room_left(value, value - bound, reach.sum(axis=0))
    return _Bounded(bound, Decided(proved, fails, point, cost, known, side, room), reach)


def halves_and_middles(rows: Rows, n: int) -> tuple[Floats, Floats]:
    """Return the half-widths and the middles of n boxes. A row whose numbers are all infinite has width 0."""
    known = [row if isinstance(row, Enclosure) else Enclosure(row) for row in rows]
    half, middle = (
        np.stack([np.broadcast_to(part, n) for part in parts])
        for parts in zip(*((x.rad, x.mid) for x in known), strict=True)
    )
    return half, middle


def room_left(value: Floats, uncertain: Floats, reach: Floats) -> Floats:
    """Return how near a margin is to a proof."""
    return np.nan_to_num(np.where(value > 0, value / uncertain, np.maximum(value / reach, LOST)), nan=0.0)


def lowest(mid: Floats, rad: Floats) -> Floats:
    """Return mid - rad rounded downwards. The two differences and the sum each take a quarter of the rounding
    allowance."""
    return np.asarray(mid - rad - 2 * UNIT * (np.abs(mid) + rad))
