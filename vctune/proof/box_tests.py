"""The tests of boxes: a margin is positive, one of several is, a curve misses 0; and how one test serves some boxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from itertools import combinations
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.proof import halving
from vctune.proof.boxes import FREQUENCY, Boxes, Integers, Values, in_chunks
from vctune.proof.enclosures.intervals import Enclosure, Floats, selected
from vctune.proof.enclosures.taylor import Taylor, least_over_boxes, stacked, variables
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.halving import Guide
from vctune.proof.prover import Decided, Test, bounded, by_kind, each_column, negative_at
from vctune.running import check_time

# Functions of a frequency and of numbers by name
Margin = Callable[[Number, Values], Number]  # must be positive; of a tuple of numbers, one at each point
Curve = Callable[[Number, Values], Pair]  # must not be 0


def positive(margin: Margin, fixed: Values) -> Test:
    """Return the test that one of a claim's margins is positive at each point."""

    def decided(boxes: Boxes) -> Decided:
        found = _one_positive(_over(margin, boxes, fixed), boxes)
        tried = np.flatnonzero(~found.proved & (found.guide.room < 0))
        if not tried.size:
            return found
        at, fails = found.guide.point[:, tried], found.fails.copy()
        fails[tried] = negative_at(_over(margin, replace(boxes.subset(tried), low=at, high=at), fixed))
        return replace(found, fails=fails)

    return decided


def sufficient(margin: Margin, fixed: Values) -> Test:
    """Return the test of a margin from which the claim follows, and which may be negative where the claim holds."""
    return lambda boxes: _one_positive(_over(margin, boxes, fixed), boxes)


def either(test: Test, other: Margin, fixed: Values) -> Test:
    """Return a test that also proves boxes away from frequency 0 in which both margins of another are positive."""

    def both(boxes: Boxes) -> Decided:
        margin, sign = _over(other, boxes, fixed)
        found, sure = bounded(margin, boxes, alone=True), least_over_boxes(sign).bound > 0
        room = np.where(sure, found.guide.room, -np.inf)
        # where it is not lost, its rows are better halved than those of a margin that is negative so far
        tried = np.flatnonzero((room > -np.inf) & (room < 0))
        if tried.size:
            at = found.guide.point[:, tried]
            first, _ = _over(other, replace(boxes.subset(tried), low=at, high=at), fixed)
            room[tried] = np.where(negative_at([first]), -np.inf, 0.0)
        return replace(found, proved=found.proved & sure, guide=replace(found.guide, room=room))

    def decided(boxes: Boxes) -> Decided:
        found = test(boxes)
        left = np.flatnonzero(~found.proved & ~found.fails & (boxes.low[0] > 0))
        if not left.size:
            return found
        return _put_in(found, left, _one_of([_part(found, left), both(boxes.subset(left))]))

    return decided


def misses_zero(curve: Curve, fixed: Values, near: Margin | None = None) -> Test:
    """Return the test that a curve misses 0: its component in some direction is positive.

    In boxes from frequency 0, a positive margin `near` suffices. If that is a component of the curve as well, the curve
    stays in a half-plane over every proved box, because a mean of two components is a third.
    """

    def decided(boxes: Boxes, *also: Margin) -> Decided:
        def margins(frequency: Number, values: Values) -> list[Number]:
            value = curve(frequency, values)
            re, im = halving.direction(value)
            return [value.re * re + value.im * im, *(margin(frequency, values) for margin in also)]

        return _one_positive(_over(margins, boxes, fixed), boxes)

    return decided if near is None else beside_zero(lambda boxes: decided(boxes, near), decided)


def turned_angles(curve: Curve, fixed: Values, limit: Margin | None = None) -> Callable[[Boxes], Floats]:
    """Return the function that measures how far a curve turns around 0 over a box's frequencies.

    In a box that `misses_zero` proved the curve stays in a half-plane. It turns by less than pi there, so its turn is
    the principal argument of the quotient of its ends. At frequency 0, where a curve may have no formula, it has the
    real value `limit`. The result is nan where the ends do not tell the sign of the turn.
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
    return np.asarray(in_chunks(lambda part: least_over_boxes(*_over(margin, part, fixed)).bound, boxes))


def beside_zero(near: Test, elsewhere: Test, rows: Sequence[str] = (FREQUENCY,)) -> Test:
    """Return a test that gives the boxes in which all of some rows begin at 0 to a test of their own."""

    def decided(boxes: Boxes) -> Decided:
        begin = [boxes.low[boxes.names.index(name)] == 0 for name in rows]
        return by_kind(np.all(begin, axis=0), near, elsewhere, boxes)

    return decided


def _one_positive(numbers: Sequence[Taylor], boxes: Boxes) -> Decided:
    """Prove the boxes in which one of several margins, or a mean of two, has a positive bound.

    Where no margin is positive, no mean is.
    """
    found = _one_of([bounded(number, boxes, alone=len(numbers) == 1) for number in numbers])
    left = np.flatnonzero(~found.proved)
    if len(numbers) == 1 or not left.size:
        return found
    part, tried = boxes.subset(left), [_part(found, left)]
    for a, b in combinations([number.subset(left) for number in numbers], 2):
        of_a, of_b = (np.maximum(weight, 0.0) for weight in halving.weights_of_mean(a, b))
        tried.append(bounded(a * of_a + b * of_b, part, alone=False))
    return _put_in(found, left, _one_of(tried))


def _one_of(found: Sequence[Decided]) -> Decided:
    """Return the results of several tests, of which each may prove a box and none refutes it."""
    if len(found) == 1:
        return found[0]
    guide = Guide.nearest([each.guide for each in found])
    return Decided(np.any([each.proved for each in found], axis=0), np.zeros(len(guide.room), bool), guide)


def _part(found: Decided, at: Integers) -> Decided:
    """Return the results on some of the boxes."""
    return each_column(lambda columns: columns[0][..., at], [found])


def _put_in(found: Decided, at: Integers, part: Decided) -> Decided:
    """Return the results with those on some of the boxes replaced."""

    def column(columns: Sequence[NDArray[Any]]) -> NDArray[Any]:
        whole = columns[0].copy()
        whole[..., at] = columns[1]
        return whole

    return each_column(column, [found, part])


def _over(margin: Margin, boxes: Boxes, fixed: Values) -> list[Taylor]:
    """Return the numbers of a margin as polynomials over boxes, also one that depends on no row."""
    check_time()
    rows = variables(boxes.rows(), boxes.varied())
    found = margin(rows[0], boxes.named(rows, fixed))
    numbers = found if isinstance(found, Sequence) else (found,)
    return [number if isinstance(number, Taylor) else stacked([number, rows[0]])[0] for number in numbers]


def spans_miss_zero(parts: Callable[[Number, Values], Any], fixed: Values) -> Test:
    """Return the test that no number of `AtRest.spanned` is 0, nor one of them plus positive multiples of the rays: in
    some direction all of them are positive. Of several `AtRest`, all are positive in one direction.

    Any direction proves; the best one by the linear parts is taken.
    """

    def decided(boxes: Boxes) -> Decided:
        check_time()
        rows = variables(boxes.rows(), boxes.varied())
        found = parts(rows[0], boxes.named(rows, fixed))
        each = [(*one.spanned, _with_endless(*one)) for one in (found if isinstance(found, list) else [found])]
        direction = _best_direction(each, len(boxes))

        def along(number: Any) -> Number:
            return _number(number.re * direction[0] + number.im * direction[1], rows[0])

        tests = list[Decided]()
        for first, spans, rays in each:
            least = along(first)
            for span in spans:
                least = least + _least(along(span.of), span.low, span.high)
            tests += [bounded(number, boxes, alone=True) for number in (least, *map(along, rays))]
        return reduce(_both, tests)

    return decided


def _with_endless(spanned: Any, rays: Sequence[Any]) -> list[Any]:
    """Return rays, and those of spans without an end."""
    return [*rays, *(span.of for span in spanned.spans if span.high is inf or span.high == inf)]


def _number(number: Any, row: Number) -> Taylor:
    return number if isinstance(number, Taylor) else stacked([number, row])[0]


def _least(x: Taylor, low: Number, high: Number) -> Number:
    """Return a lower bound of t x for every t between two limits."""
    if high is inf or high == inf:
        return x * low
    half, middle = (high - low) * 0.5, (high + low) * 0.5

    def any_sign() -> Number:
        return x * middle - TAYLOR.modulus(x, x * 0.0) * half

    return TAYLOR.where_positive(x, lambda: x * low, lambda: TAYLOR.where_positive(-x, lambda: x * high, any_sign))


def _both(one: Decided, other: Decided) -> Decided:
    """Return the result of two tests that must both hold: where the first does, that of the second."""
    return each_column(lambda columns: np.where(one.proved, *columns), [other, one])


# Directions that are compared at first, and in each of some rounds around the best one, a step of the last to each side
FIRST_DIRECTIONS, DIRECTIONS, NARROWED = 48, np.linspace(-1.0, 1.0, 17), 2


def _best_direction(each: Sequence[tuple[Any, Sequence[Any], Sequence[Any]]], n: int) -> Floats:
    """Return for each box a direction, shape (2, n), in which all numbers are farthest from 0 by their linear parts, in
    units of their real and imaginary parts."""
    used = [of for fixed, spans, rays in each for of in (fixed, *(span.of for span in spans), *rays)]
    numbers = [part for of in used for part in (of.re, of.im)]
    rows = max((number.row_count for number in numbers if isinstance(number, Taylor)), default=0)

    def linear(part: Any) -> Floats:
        if isinstance(part, Taylor):
            return np.broadcast_to(part.coefficients[: 1 + rows], (1 + rows, n))
        value = np.zeros((1 + rows, n))
        value[0] = getattr(part, "mid", part)
        return value

    def ends(span: Any) -> tuple[float, float]:
        low, high = (float(getattr(end, "mid", end)) for end in (span.low, span.high))
        return low, low if high == np.inf else high

    def size(part: str) -> Floats:
        terms = [term for fixed, spans, _ in each for term in ((fixed, 1.0), *((s.of, ends(s)[1]) for s in spans))]
        total = sum(most * np.abs(linear(getattr(of, part))).sum(axis=0) for of, most in terms)
        return np.where(total > 0, total, 1.0)

    unit = size("re"), size("im")

    def scaled(of: Any) -> NDArray[np.complex128]:
        return linear(of.re) / unit[0] + 1j * (linear(of.im) / unit[1])

    def room(directions: NDArray[np.complex128]) -> Floats:
        """Return a lower bound of the least component in each of some directions, shape (directions, n)."""

        def components(of: Any) -> Floats:
            return np.real(np.conj(directions)[:, None] * scaled(of))

        least = np.full(directions.shape, inf)
        for fixed, spans, rays in each:
            total = components(fixed)
            for span in spans:
                x, (low, high) = components(span.of), ends(span)
                reach = np.abs(x).sum(axis=1)
                either = 2 * np.abs(x[:, 0]) <= reach  # of either sign, so that `_least` takes its modulus
                one = np.where(x[:, 0] > 0, low, high)
                total = total + np.where(either, 0.5 * (low + high), one)[:, None] * x
                total[:, 0] -= np.where(either, 0.5 * (high - low) * reach, 0.0)
            least = np.minimum(least, total[:, 0] - np.abs(total[:, 1:]).sum(axis=1))
            for ray in rays:
                least = np.minimum(least, components(ray)[:, 0] / np.maximum(np.abs(scaled(ray)[0]), 1e-300))
        return np.nan_to_num(least, nan=-np.inf)

    step, first = 2 * np.pi / FIRST_DIRECTIONS, 2 * np.pi * np.arange(FIRST_DIRECTIONS) / FIRST_DIRECTIONS
    angles = np.broadcast_to(first[:, None], (FIRST_DIRECTIONS, n))
    for again in range(NARROWED + 1):
        best = np.take_along_axis(angles, np.argmax(room(np.exp(1j * angles)), axis=0)[None], axis=0)
        if again < NARROWED:
            angles, step = best + step * DIRECTIONS[:, None], step * (DIRECTIONS[1] - DIRECTIONS[0])
    return np.stack((np.cos(best[0]) / unit[0], np.sin(best[0]) / unit[1]))
