"""Tests of boxes: that a margin is positive throughout, that a curve misses 0.

A margin is bounded from below by its value at one point of the box: the middle in those rows in which it may both rise
and fall, which costs their slope times their half-width, and the worse end in those in which its slope keeps its sign,
which costs nothing. So a worst device, or a worst design, at a vertex of its box is met exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.proof.enclosures.array_intervals import UNIT, Enclosure, Flags, Floats, raised
from vctune.proof.enclosures.box_minimum import least_over_boxes
from vctune.proof.enclosures.jets import Jet, variables
from vctune.proof.enclosures.taylor import variables as polynomials
from vctune.proof.engine.boxes import Boxes, Values, in_chunks
from vctune.proof.engine.branching import Decided, Test
from vctune.proof.engine.interval import WIDE
from vctune.running import check_time

NARROW = 1.02
"""Ratio of a box's frequencies below which it is worth another margin that needs it narrower. Half and twice its excess
over 1 take as many boxes."""
FROM_ZERO = 0.1
"""As how wide, relative, an interval from frequency 0 counts: halved it is no narrower. Half and twice it take as many
boxes."""

FEW = 128
"""Boxes that take about as long as one. Half and twice it: as long for random devices in hands; four times: a third
more."""

NEAR_ZERO = 1e-3
"""Share of its range below which a number that may be 0 counts as that, where nothing else is known of a box. A tenth
takes a fifth more boxes, ten times as much as many; 0 would halve such a row again and again."""

FREQUENCY_FIRST = 64.0
"""How many times its width the frequency counts where nothing is known of a box and one of several margins is to be
positive: what vanishes in a denominator does so at single frequencies. An eighth leaves servos with a stiff coupling
open, eight times takes as many boxes."""

WIDER = 0.1
"""Power of its relative width by which what a row loses counts: of two that lose it together the wider is halved. Half
takes as many boxes, without an integrator up to five times as many; two and a half times a fifth more; 0 leaves some of
the latter open."""

LOST = -1.0
"""How near a margin counts as to being proved that all that it varies by would not make positive."""

Margin = Callable[[Number, Values], Number]
"""What must be positive, of a frequency and of numbers by name, over enclosures and jets."""
Margins = Callable[[Number, Values], tuple[Number, ...]]
"""Of which one must be positive."""
Curve = Callable[[Number, Values], Pair]
"""What must not be 0."""
Rows = Sequence[Number]
OfRows = Callable[[Rows], Number]


def positive(margin: Margin, fixed: Values, sufficient: Margin | None = None, below: float = 0.0) -> Test:
    """Return the test that a margin is positive, by slopes.

    Parameters
    ----------
    margin : function of a frequency and of values by name
    fixed : values that are no rows of the boxes
    sufficient : another margin that proves as much and is regular at frequency 0; tried there and on wide intervals
    below : frequency below which `sufficient` is tried on narrow intervals too, because a margin that vanishes at 0 may
        vary little relative to itself

    Returns
    -------
    Test
        Of boxes of frequency and values.
    """

    def test(boxes: Boxes) -> Decided:
        def of(margin: Margin) -> OfRows:
            return lambda rows: margin(rows[0], boxes.named(rows, fixed))

        near, rows = of(sufficient or margin), boxes.rows()
        if _from_zero(boxes):
            decided = _by_slopes(near, boxes, rows).decided
            return decided if sufficient is None else _without_failures(decided)
        if _wide(boxes):
            proved = of(margin)(rows).positive()
            return _to_halve_in_frequency(boxes, proved if sufficient is None else proved | near(rows).positive())
        decided = _by_slopes(of(margin), boxes, rows).decided
        narrow = boxes.high[0] < np.minimum(boxes.low[0] * NARROW, below)
        left = np.flatnonzero(~decided.proved & ~decided.fails & narrow)
        if left.size:
            part = boxes.subset(left)
            other = _by_slopes(lambda rows: (sufficient or margin)(rows[0], part.named(rows, fixed)), part, part.rows())
            decided.proved[left] = other.decided.proved
            decided.cost[:, left] = np.where(other.decided.fails, decided.cost[:, left], other.decided.cost)
        return decided

    return partial(_kind_by_kind, test)


def positive_by_polynomials(margin: Margin, fixed: Values, spans: Floats, by_slopes: Test) -> Test:
    """Return the test that a margin is positive, by polynomials that know how the rows of a box act together.

    If more than `FEW` boxes stay open, the test evaluates the slopes of these too. Slopes tell at which end of a row
    the margin is least, so that the prover can reduce a box to that face. Polynomials cannot tell, since their
    remainder has no slope.

    Parameters
    ----------
    margin : function of a frequency and of values by name, over `vctune.proof.enclosures.taylor`
    fixed : values that are no rows of the boxes
    spans : whole range of each row but the frequency, shape (rows - 1, 1)
    by_slopes : the test of the same margin by slopes

    Returns
    -------
    Test
        Of boxes of frequency and values.
    """

    def of(boxes: Boxes, varied: Sequence[bool]) -> Number:
        rows = polynomials(boxes.rows(), varied)
        return margin(rows[0], boxes.named(rows, fixed))

    def test(boxes: Boxes) -> Decided:
        check_time()
        varied = boxes.varied()
        least = least_over_boxes(of(boxes, varied))
        proved, width = least.bound > 0, boxes.high - boxes.low
        at, cost = np.zeros_like(width), np.zeros_like(width)
        at[varied], cost[varied] = least.at, least.cost
        point = np.clip(0.5 * (boxes.low + boxes.high + width * at), boxes.low, boxes.high)
        fails = ~proved & (least.estimate < 0)
        if fails.any():
            there = replace(boxes.subset(fails), low=point[:, fails], high=point[:, fails])
            fails[fails] = of(there, there.varied()).enclosed().negative()
        known, side = np.isfinite(least.bound), np.zeros_like(width)
        left = np.flatnonzero(~proved & ~fails)
        if left.size > FEW:
            sloping = by_slopes(boxes.subset(left))
            proved[left], fails[left], side[:, left] = sloping.proved, sloping.fails, sloping.side
            point[:, left] = np.where(sloping.fails, sloping.point, point[:, left])
        relative = _relative(boxes, spans)
        cost = np.where((width > 0) & (side == 0), np.where(known, cost * relative**WIDER, relative), 0.0)
        return Decided(proved, fails, point, cost, known, side, np.where(proved, np.inf, least.estimate))

    return test


def misses_zero(curve: Curve, fixed: Values, sufficient: Margin | None = None) -> Test:
    """Return the test that a curve misses 0.

    It does where the rectangle around its image does not contain 0, where `sufficient` is positive, or where its
    component along its own value at the middle of the box is positive.

    Parameters
    ----------
    curve : function of a frequency and of values by name
    fixed : values that are no rows of the boxes
    sufficient : a margin that is positive only where the curve is not 0; None for none

    Returns
    -------
    Test
        It never fails a box: a curve that comes near 0 stays open.
    """

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

        decided = _without_failures(_by_slopes(component, boxes, rows).decided)
        return replace(decided, proved=decided.proved | missed)

    return partial(_kind_by_kind, test)


def turned_angles(curve: Curve, fixed: Values) -> Callable[[Boxes], Floats]:
    """Return the function that measures how far a curve turns around 0 over a box's frequencies.

    The curve must miss 0 on the box, and the box must be a single point in every row but the frequency.

    Parameters
    ----------
    curve : function of a frequency and of values by name
    fixed : values that are no rows of the boxes

    Returns
    -------
    function
        Maps n boxes to angles, rad, shape (n,); nan where rounding leaves open on which side of half a turn a box lies.
    """

    def turn(boxes: Boxes) -> Floats:
        rows = boxes.rows()
        start, stop = (curve(Enclosure(edge[0]), boxes.named(rows, fixed)) for edge in (boxes.low, boxes.high))
        cross = start.re * stop.im - start.im * stop.re
        dot = start.re * stop.re + start.im * stop.im
        sided = cross.positive() | cross.negative() | dot.positive()
        return np.where(sided, np.arctan2(cross.mid, dot.mid), np.nan)

    return turn


def lower_bound_over(margin: Margin, boxes: Boxes, fixed: Values) -> Floats:
    """Return a lower bound of a margin over each box, by its slopes.

    Parameters
    ----------
    margin : function of a frequency and of values by name
    boxes : n boxes
    fixed : values that are no rows of the boxes

    Returns
    -------
    array of float
        Shape (n,), in the margin's unit; nan where no bound is known.
    """

    def least(part: Boxes) -> Floats:
        return _by_slopes(lambda rows: margin(rows[0], part.named(rows, fixed)), part, part.rows()).least

    with np.errstate(all="ignore"):
        return np.asarray(in_chunks(least, boxes))


def next_to_zero(rows: Sequence[int], sufficient: Sequence[Margin], fixed: Values, test: Test) -> Test:
    """Return a test that has other margins where some rows begin at 0 together.

    Parameters
    ----------
    rows : which ones
    sufficient : margins any of which proves as much there, the more so the narrower these rows are; where they are
        negative, or least, says nothing of the claim's
    fixed : the values that are not among a box's rows
    test : of the other boxes
    """
    both = list(rows)

    def there(margin: Margin, boxes: Boxes) -> Decided:
        found = _by_slopes(lambda x: margin(x[0], boxes.named(x, fixed)), boxes, boxes.rows())
        decided = _without_failures(found.decided)
        decided.cost[both] = np.where(decided.known, found.reach[both], decided.cost[both])
        return replace(decided, side=np.zeros_like(decided.side))

    tests = [partial(there, margin) for margin in sufficient]

    def by_place(boxes: Boxes) -> Decided:
        at = (boxes.low[both] == 0).all(axis=0)
        return _by_kind([(at, any_of(tests)), (~at, test)], boxes)

    return by_place


def any_positive(margins: Margins, slopes: Margins, fixed: Values, spans: Floats) -> Test:
    """Return the test that at each point one of several margins is positive.

    A box is proved if one of them is throughout, and fails where all of them are negative at one point. Any other is
    halved as the margin asks that is nearest to being proved. The margins are least at the same end of a row only if
    all are that may be positive at all.

    Parameters
    ----------
    margins : of a frequency and of values, over `vctune.proof.enclosures.taylor`
    slopes : the same over jets
    fixed : the values that are not among a box's rows
    spans : of the whole range of each row but the frequency, shape (rows - 1, 1)
    """

    def of(boxes: Boxes) -> tuple[Number, ...]:
        rows = polynomials(boxes.rows(), boxes.varied())
        return margins(rows[0], boxes.named(rows, fixed))

    def test(boxes: Boxes) -> Decided:
        check_time()
        best = _nearest([_by_polynomials(number, boxes, spans) for number in of(boxes)])
        left = np.flatnonzero(~best.proved)
        if left.size:
            there = replace(boxes.subset(left), low=best.point[:, left], high=best.point[:, left])
            best.fails[left] = np.all([number.enclosed().negative() for number in of(there)], axis=0)
        left = np.flatnonzero(~best.proved & ~best.fails)
        if left.size > FEW:
            part = boxes.subset(left)
            proved, side = _any_by_slopes(lambda rows: slopes(rows[0], part.named(rows, fixed)), part)
            best.proved[left], best.side[:, left] = proved, side
            best.cost[:, left] = np.where(best.side[:, left] == 0, best.cost[:, left], 0.0)
        return best

    return test


def alone(margins: Margins) -> Margin:
    """Return the margin that is the only one."""
    return lambda frequency, values: margins(frequency, values)[0]


def any_of(tests: Sequence[Test]) -> Test:
    """Return the test that at each point one of several sufficient margins is positive.

    Parameters
    ----------
    tests : of one margin each
    """
    return lambda boxes: _nearest([test(boxes) for test in tests])


def _by_polynomials(number: Number, boxes: Boxes, spans: Floats) -> Decided:
    """Decide by one of several margins; where it is negative somewhere, its cost is its variation."""
    least, varied, n = least_over_boxes(number), boxes.varied(), len(boxes)
    width = boxes.high - boxes.low
    at, lost, varies = np.zeros_like(width), np.zeros_like(width), np.zeros_like(width)
    at[varied], lost[varied], varies[varied] = least.at, least.cost, np.abs(number.poly[1 : 1 + number.rows])
    varies += lost
    known, positive = np.isfinite(least.bound), least.estimate > 0
    relative = _relative(boxes, spans)
    cost = np.where(positive, lost, varies) * relative**WIDER
    relative[0] *= np.where(boxes.low[0] > 0, FREQUENCY_FIRST, 1.0)  # halved from 0 it is no narrower
    cost = np.where(known, cost, relative)
    room = _room(least.estimate, least.estimate - least.bound, varies.sum(axis=0))
    room[number.enclosed().negative()] = -np.inf
    return Decided(
        proved=least.bound > 0,
        fails=np.zeros(n, bool),
        point=np.clip(0.5 * (boxes.low + boxes.high + width * at), boxes.low, boxes.high),
        cost=np.where(width > 0, cost, 0.0),
        known=known,
        side=np.zeros_like(width),
        room=room,
    )


def _relative(boxes: Boxes, spans: Floats) -> Floats:
    """Return the width of each row relative to its numbers, which count as `NEAR_ZERO` of their range at least."""
    sizes = np.abs(boxes.low) + np.abs(boxes.high)
    sizes[1:] += NEAR_ZERO * spans
    relative = (boxes.high - boxes.low) / sizes
    relative[0] = np.where(boxes.low[0] == 0, FROM_ZERO, relative[0])
    return np.asarray(relative)


def _nearest(found: Sequence[Decided]) -> Decided:
    """Return the result of the test nearest to a proof, and the boxes that any test proves."""
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


def _any_by_slopes(margins: Callable[[Rows], tuple[Number, ...]], boxes: Boxes) -> tuple[Flags, Floats]:
    """Return which boxes one of several margins is positive throughout, and the end of each row where all are least.

    Each is bounded from its value at the point at these ends, in the middle of the other rows, as by `_by_slopes`.
    """
    rows, varied, n = boxes.rows(), boxes.varied(), len(boxes)
    numbers = margins(variables(rows, varied))
    side = _common_sides(numbers, boxes)
    rad, middle = np.stack([np.broadcast_to(row.rad, n) for row in rows]), np.stack([row.mid for row in rows])
    point = middle + side * rad
    at_point = [
        Enclosure(p, 2 * UNIT * (np.abs(p) + r)) if varies else row
        for p, r, row, varies in zip(point, rad, rows, varied, strict=True)
    ]
    proved = np.zeros(n, bool)
    for number, value in zip(numbers, margins(at_point), strict=True):
        reach, slopes = np.zeros_like(rad), number.slopes if isinstance(number, Jet) else ()
        for row, slope in zip(np.flatnonzero(varied), slopes, strict=False):
            if slope is not None:
                reach[row] = np.where(side[row] == 0, (np.abs(slope.mid) + slope.rad) * rad[row], 0.0)
        direct: Enclosure = number.value if isinstance(number, Jet) else number
        proved |= _lowest(value.mid, raised(value.rad + reach.sum(axis=0), 1 + len(rows))) > 0
        proved |= direct.positive()
    return proved, side


def _common_sides(numbers: Sequence[Number], boxes: Boxes) -> Floats:
    """Return the end of each row at which all margins are least that are not negative throughout, 0 where they differ.

    Where all of them are negative throughout any end will do.
    """
    least, most = np.ones_like(boxes.low), -np.ones_like(boxes.low)
    for number in numbers:
        side = np.zeros_like(boxes.low)
        value: Enclosure = number.value if isinstance(number, Jet) else number
        slopes = number.slopes if isinstance(number, Jet) else ()
        for row, slope in zip(np.flatnonzero(boxes.varied()), slopes, strict=False):
            if slope is not None:
                side[row] = 1.0 * slope.negative() - slope.positive()
        hopeful = ~np.broadcast_to(value.negative(), len(boxes))
        least, most = np.where(hopeful, np.minimum(least, side), least), np.where(hopeful, np.maximum(most, side), most)
    return np.where(least == most, least, 0.0)


def _kind_by_kind(test: Test, boxes: Boxes) -> Decided:
    """Test boxes from frequency 0, those that are wide in frequency, and the others."""
    zero = boxes.low[0] == 0
    wide = (boxes.high[0] > WIDE * boxes.low[0]) & ~zero
    return _by_kind([(kind, test) for kind in (zero, wide, ~(zero | wide))], boxes)


def _by_kind(tests: Sequence[tuple[Flags, Test]], boxes: Boxes) -> Decided:
    """Test each box by the one test that is for its kind."""
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
    return bool(boxes.low[0, 0] == 0)


def _wide(boxes: Boxes) -> bool:
    return bool(boxes.high[0, 0] > WIDE * boxes.low[0, 0])


def _to_halve_in_frequency(boxes: Boxes, proved: Flags) -> Decided:
    cost = np.zeros_like(boxes.low)
    cost[0] = 1.0
    none = np.zeros(len(boxes), bool)
    point = 0.5 * (boxes.low + boxes.high)
    room = np.where(proved, np.inf, 0.0)
    return Decided(proved, none, point, cost, none, np.zeros_like(cost), room)


def _without_failures(decided: Decided) -> Decided:
    """Return the result of a sufficient margin: where it is negative the claim stays open."""
    return replace(decided, fails=np.zeros_like(decided.fails))


@dataclass(frozen=True, slots=True)
class _Bounded:
    """A lower bound of a margin over each box, its verdict, and its variation with each row."""

    least: Floats
    decided: Decided
    reach: Floats


def _by_slopes(margin: OfRows, boxes: Boxes, rows: Sequence[Enclosure]) -> _Bounded:
    """Bound a margin from below by its value at one point of each box and by its slopes.

    Halving a row saves what its slope costs; where the margin is negative at that point, what it varies by; where
    nothing is known of the slopes, the widest row is as good as any.
    """
    check_time()
    varied = boxes.varied()
    over_box = margin(variables(rows, varied))
    n, count = len(boxes), len(rows)
    side, reach = np.zeros((count, n)), np.zeros((count, n))
    direct: Enclosure = over_box.value if isinstance(over_box, Jet) else over_box
    rad = np.stack([np.broadcast_to(row.rad, n) for row in rows])
    middle = np.stack([row.mid for row in rows])
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
    bound = np.zeros(n) + np.fmax(
        _lowest(least.mid, raised(least.rad + loose.sum(axis=0), 1 + count)), _lowest(direct.mid, direct.rad)
    )
    fails, known = np.broadcast_to(least.negative(), n), np.asarray(np.isfinite(reach).all(axis=0))
    width = rad / np.abs(middle)
    width[0] = np.where(rad[0] >= middle[0], FROM_ZERO, width[0])
    cost = np.where(known, np.where(fails, reach, loose), width)
    cost = np.where(np.array(varied)[:, None], cost, 0.0)
    proved = np.asarray(bound > 0)
    value = np.broadcast_to(least.mid, n)
    room = _room(value, value - bound, reach.sum(axis=0))
    return _Bounded(bound, Decided(proved, fails, point, cost, known, side, room), reach)


def _room(value: Floats, uncertain: Floats, reach: Floats) -> Floats:
    """Return how near a margin is to a proof, from its least value, the error of that value, and the margin's reach.

    Where it is negative it is what share of the reach is missing; nan, where nothing is known, counts as that it is 0.
    """
    return np.nan_to_num(np.where(value > 0, value / uncertain, np.maximum(value / reach, LOST)), nan=0.0)


def _lowest(mid: Floats, rad: Floats) -> Floats:
    """Return mid - rad rounded downwards: two differences and a sum, each by a quarter of the total rounding."""
    return np.asarray(mid - rad - 2 * UNIT * (np.abs(mid) + rad))
