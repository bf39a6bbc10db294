"""Boxes of which one of two margins has to be positive, where the two take turns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from vctune.model.numbers.arithmetic import Number
from vctune.proof.engine.boxes import Boxes, Values
from vctune.proof.engine.branching import Proofs, prove
from vctune.proof.engine.polynomial_tests import any_positive


def proof(reserve: float, bent: Callable[[Number, Number], Number]) -> Proofs:
    """Prove one of bent + reserve and reserve - 3 bent over a square, with at most 40,000 boxes."""

    def margins(x: Number, v: Values) -> tuple[Number, ...]:
        found = bent(x, v["y"])
        return found + reserve, found * -3.0 + reserve

    boxes = Boxes(
        ("frequency", "y"),
        np.array([[1.0], [1.0]]),
        np.array([[2.0], [2.0]]),
        np.zeros(1, np.intp),
        np.zeros(1, np.intp),
    )
    test = any_positive(margins, None, {}, np.array([[1.0]]))
    return prove(test, boxes, 1, halved=[True, True], max_halvings=60, max_boxes=40_000)


@pytest.mark.parametrize("reserve", [1e-2, 1e-4, 1e-6])
def test_a_curve_on_which_two_margins_take_turns_costs_few_boxes(reserve: float) -> None:
    """By the margins alone it costs one over the reserve. Their mean is the reserve everywhere."""
    found = proof(reserve, lambda x, y: x * y - 2.0)
    assert found.proved[0]
    assert found.boxes[0] < 500


def test_without_a_reserve_nothing_is_proved() -> None:
    """Both margins are negative on the curve."""
    found = proof(-1e-3, lambda x, y: x * y - 2.0)
    assert not found.proved[0]
    assert not np.isnan(found.failing[0, 0])
    x, y = found.failing[:, 0]
    assert abs(x * y - 2.0) < 1e-3
