"""Tests of boxes by Taylor polynomials: what they prove and refute agrees with the margins at random points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from vctune.model.numbers.arithmetic import Number
from vctune.proof.enclosures.taylor import variables
from vctune.proof.engine.box_tests import positive
from vctune.proof.engine.boxes import Boxes, Values
from vctune.proof.engine.branching import Decided
from vctune.proof.engine.polynomial_tests import FEW, any_positive, by_polynomials, positive_by_polynomials

SPANS = np.array([[2.0]])
"""The row y ranges from 0.5 to 2.5."""
COUNTS = [20, 8 * FEW]
"""A few boxes, and so many that slopes are evaluated as well."""


def random_boxes(count: int) -> Boxes:
    """Return boxes. If there are many, they are so wide that polynomials leave more than `FEW` open."""
    rng, widest = np.random.default_rng(count), 0.3 if count < FEW else 3.0
    low = rng.uniform([[1.0], [0.5]], [[2.0], [2.0]], (2, count))
    width = rng.uniform(0.0, widest, (2, count))
    owners = np.zeros(count, np.intp)
    return Boxes(("frequency", "y"), low, low + width, owners, owners)


def bent(x: Number, y: Number) -> Number:
    return x * y * y - x * x * y + 0.3


def sampled(function: Callable[[Number, Number], Number], boxes: Boxes) -> np.ndarray:
    """Return a function at random points of each box, shape (points, boxes)."""
    shares = np.random.default_rng(1).uniform(size=(200, 2, len(boxes)))
    points = boxes.low + shares * (boxes.high - boxes.low)
    return np.asarray(function(points[:, 0], points[:, 1]))


def within(boxes: Boxes, decided: Decided) -> bool:
    return bool(np.all((boxes.low <= decided.point) & (decided.point <= boxes.high)))


@pytest.mark.parametrize("count", COUNTS)
def test_a_margin_is_positive_in_proved_boxes_and_negative_at_failing_points(count: int) -> None:
    def margin(x: Number, v: Values) -> Number:
        return bent(x, v["y"])

    boxes = random_boxes(count)
    decided = positive_by_polynomials(margin, {}, SPANS, positive(margin, {}))(boxes)
    assert 0 < decided.proved.sum() < count and decided.fails.any() and within(boxes, decided)
    assert not (decided.proved & decided.fails).any()
    assert (sampled(bent, boxes)[:, decided.proved] > 0).all()
    assert (bent(*decided.point[:, decided.fails]) < 0).all()


def steep(x: Number, y: Number) -> Number:
    return 1.0 / (x * y) - 0.1


def test_where_polynomials_leave_many_boxes_open_slopes_name_the_worst_ends() -> None:
    """The margin falls with both rows. Over wide boxes, its polynomial has a great remainder."""

    def margin(x: Number, v: Values) -> Number:
        return steep(x, v["y"])

    boxes = random_boxes(8 * FEW)
    decided = positive_by_polynomials(margin, {}, SPANS, positive(margin, {}))(boxes)

    def margins(x: Number, v: Values) -> tuple[Number, ...]:
        return margin(x, v), margin(x, v) - 0.01

    for found in (decided, any_positive(margins, margins, {}, SPANS)(boxes)):
        assert (found.side == 1).any() and not (found.side == -1).any()
        assert found.proved.any() and (steep(*boxes.high[:, found.proved]) > 0).all()
        assert found.fails.any() and (steep(*found.point[:, found.fails]) < 0).all()


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("sloping", [False, True])
def test_one_of_two_margins_is_positive_in_proved_boxes_and_none_at_failing_points(count: int, sloping: bool) -> None:
    def other(x: Number, y: Number) -> Number:
        return y - 2.0 * x + 0.4

    def margins(x: Number, v: Values) -> tuple[Number, ...]:
        return bent(x, v["y"]), other(x, v["y"])

    boxes = random_boxes(count)
    decided = any_positive(margins, margins if sloping else None, {}, SPANS)(boxes)
    assert 0 < decided.proved.sum() < count and decided.fails.any() and within(boxes, decided)
    best = np.maximum(sampled(bent, boxes), sampled(other, boxes))
    assert (best[:, decided.proved] > 0).all()
    for function in (bent, other):
        assert (function(*decided.point[:, decided.fails]) < 0).all()


def test_one_margin_alone_refutes_no_box_and_is_lost_where_it_is_negative() -> None:
    """Another margin may be positive where this one is negative."""
    boxes, varied = random_boxes(20), [True, True]
    rows = variables(boxes.rows(), varied)
    decided = by_polynomials(bent(*rows), boxes, varied, SPANS)
    values = sampled(bent, boxes)
    assert not decided.fails.any() and not decided.side.any()
    assert (values[:, decided.proved] > 0).all() and (decided.room[decided.proved] > 1).all()
    lost = np.isneginf(decided.room)
    assert lost.any() and (values[:, lost] < 0).all()
    # a row without width has no cost
    flat = Boxes(boxes.names, boxes.low, np.stack([boxes.high[0], boxes.low[1]]), boxes.owner, boxes.owner)
    rows = variables(flat.rows(), [True, False])
    assert not by_polynomials(bent(*rows), flat, [True, False], SPANS).cost[1].any()
