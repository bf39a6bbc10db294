"""Tests of boxes by Taylor polynomials, for one margin or for several (proof/README.md, section 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.enclosures.box_minimum import least_over_boxes
from vctune.proof.enclosures.taylor import Taylor
from vctune.proof.enclosures.taylor import variables as polynomials
from vctune.proof.engine.box_tests import (
    FROM_ZERO,
    Margin,
    Margins,
    nearest,
    room_left,
)
from vctune.proof.engine.boxes import Boxes, Integers, Values
from vctune.proof.engine.branching import Decided, Test
from vctune.running import check_time

FEW = 128  # Number of boxes up to which an array of boxes takes about as long as one box
NEAR_ZERO = 1e-3  # Least divisor in the relative width of a row, as a share of the row's range
# Weight of the frequency's relative width if a box has no bound and one of several margins must be positive
FREQUENCY_FIRST = 64.0
WIDER = 0.1  # Exponent of a row's relative width in the weight of the row's cost


def positive_by_polynomials(margin: Margin, fixed: Values, spans: Floats) -> Test:
    """Return the test that a margin is positive, by polynomials that show how the rows of a box act together."""

    def margin_over(boxes: Boxes, varied: Sequence[bool]) -> Number:
        rows = polynomials(boxes.rows(), varied)
        return margin(rows[0], boxes.named(rows, fixed))

    def test(boxes: Boxes) -> Decided:
        check_time()
        varied = boxes.varied()
        least = least_over_boxes(margin_over(boxes, varied))
        proved, width = least.bound > 0, boxes.high - boxes.low
        at, cost = np.zeros_like(width), np.zeros_like(width)
        at[varied], cost[varied] = least.at, least.cost
        point = np.clip(0.5 * (boxes.low + boxes.high + width * at), boxes.low, boxes.high)
        fails = ~proved & (least.estimate < 0)
        if fails.any():
            points = replace(boxes.subset(fails), low=point[:, fails], high=point[:, fails])
            fails[fails] = margin_over(points, points.varied()).enclosed().negative()
        known, relative = np.isfinite(least.bound), _relative(boxes, spans)
        cost = np.where(width > 0, np.where(known, cost * relative**WIDER, relative), 0.0)
        room = np.where(proved, np.inf, least.estimate)
        return Decided(proved, fails, point, cost, known, np.zeros_like(width), room)

    return test


def any_positive(margins: Margins, fixed: Values, spans: Floats) -> Test:
    """Return the test that one of several margins is positive at each point."""

    def margins_over(boxes: Boxes) -> tuple[Number, ...]:
        rows = polynomials(boxes.rows(), boxes.varied())
        return margins(rows[0], boxes.named(rows, fixed))

    def test(boxes: Boxes) -> Decided:
        check_time()
        numbers = margins_over(boxes)
        varied = boxes.varied()
        best = nearest([by_polynomials(number, boxes, varied, spans) for number in numbers])
        best = _with_means(numbers, best, boxes, varied, spans)
        left = np.flatnonzero(~best.proved)
        if left.size:
            points = replace(boxes.subset(left), low=best.point[:, left], high=best.point[:, left])
            best.fails[left] = np.all([number.enclosed().negative() for number in margins_over(points)], axis=0)
        return best

    return test


def by_polynomials(number: Number, boxes: Boxes, varied: Sequence[bool], spans: Floats) -> Decided:
    """Decide boxes by one margin, whose failure need not be a failure of the claim."""
    least, n = least_over_boxes(number), len(boxes)
    width = boxes.high - boxes.low
    at, lost, varies = np.zeros_like(width), np.zeros_like(width), np.zeros_like(width)
    at[varied], lost[varied], varies[varied] = (
        least.at,
        least.cost,
        np.abs(number.coefficients[1 : 1 + number.row_count]),
    )
    varies += lost
    known, positive = np.isfinite(least.bound), least.estimate > 0
    relative = _relative(boxes, spans)
    cost = np.where(positive, lost, varies) * relative**WIDER
    relative[0] *= np.where(boxes.low[0] > 0, FREQUENCY_FIRST, 1.0)  # halving from 0 keeps the relative width
    cost = np.where(known, cost, relative)
    room = room_left(least.estimate, least.estimate - least.bound, varies.sum(axis=0))
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


def _with_means(
    numbers: tuple[Number, ...], best: Decided, boxes: Boxes, varied: Sequence[bool], spans: Floats
) -> Decided:
    """Decide the boxes that no single margin proves, by weighted means of two margins."""
    left = np.flatnonzero(~best.proved)
    if len(numbers) == 1 or not left.size:
        return best
    part, parts = boxes.subset(left), [number.subset(left) for number in numbers]
    means = [by_polynomials(_best_mean(a, b), part, varied, spans) for a, b in combinations(parts, 2)]
    found = nearest([_subset(best, left), *means])
    for name in ("proved", "point", "cost", "known", "room"):
        getattr(best, name)[..., left] = getattr(found, name)
    return best


def _subset(found: Decided, at: Integers) -> Decided:
    """Return the results of some of the boxes."""
    return Decided(*(getattr(found, name)[..., at] for name in Decided.__slots__))


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


def _relative(boxes: Boxes, spans: Floats) -> Floats:
    """Return the width of each row, relative to the row's values or to `NEAR_ZERO` of the row's range, whichever is
    greater."""
    sizes = np.abs(boxes.low) + np.abs(boxes.high)
    sizes[1:] += NEAR_ZERO * spans
    relative = (boxes.high - boxes.low) / sizes
    relative[0] = np.where(boxes.low[0] == 0, FROM_ZERO, relative[0])
    return np.asarray(relative)
