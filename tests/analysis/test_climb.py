"""Climbs reach the maxima of functions whose maxima are known in closed form."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vctune.analysis import climb
from vctune.analysis.climb import climbed


def stencils(function):
    """Return the function of stencils that `climbed` asks for, and a list that counts its calls."""
    calls = []

    def values(nodes):
        calls.append(nodes.shape)
        chosen = np.array([*product(range(3), repeat=len(nodes))])
        return np.stack([function(np.stack([nodes[i, :, k] for i, k in enumerate(each)])) for each in chosen], axis=1)

    return values, calls


def climb_of(function, starts, low=-np.inf, high=np.inf, step=0.2, owners=None, **options):
    values, calls = stencils(function)
    shape = starts.shape
    bounds = np.broadcast_to(low, shape), np.broadcast_to(high, shape)
    climbs = climbed(
        values,
        starts,
        *bounds,
        np.full(shape[0], step),
        range(shape[0]),
        owners or [0] * shape[1],
        **options,
    )
    return *climbs, len(calls)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 4))
def test_a_parabola_is_climbed_with_few_stencils(seed, count):
    random = np.random.default_rng(seed)
    turned, _ = np.linalg.qr(random.normal(size=(count, count)))
    bend, top = turned @ np.diag(np.geomspace(1, 30, count)) @ turned.T, random.uniform(-0.5, 0.5, (count, 1))
    best, place, calls = climb_of(
        lambda x: 3 - np.einsum("in,ij,jn->n", x - top, bend, x - top) / 2, random.uniform(-0.5, 0.5, (count, 5))
    )
    assert best == pytest.approx(3, abs=1e-9)
    assert place == pytest.approx(np.repeat(top, 5, axis=1), abs=1e-5)
    assert calls <= 10


def test_leaps_come_nearer_to_the_top_of_a_curved_ridge_than_moves():
    missed = {True: 0.0, False: 0.0}
    for seed in range(20):
        random = np.random.default_rng(seed)
        top, starts = random.uniform(0.3, 0.7), random.uniform(0.2, 0.8, (2, 4))
        for smooth in missed:
            best, _, _ = climb_of(
                lambda x, top=top: 1 / (1 + 100 * (x[1] - x[0] ** 2) ** 2 + (x[0] - top) ** 2),
                starts,
                0,
                1,
                smooth=smooth,
            )
            missed[smooth] += 1 - best.max()
    assert 0 <= missed[True] < missed[False] / 3


def test_the_top_is_on_the_bounds_where_the_function_rises_towards_them():
    best, place, _ = climb_of(lambda x: x[0] - 2 * x[1] + 0.5 * x[2] * x[0], np.full((3, 2), 0.4), 0, 1)
    assert place == pytest.approx(np.array([[1, 1], [0, 0], [1, 1]]), abs=1e-9)
    assert best == pytest.approx(1.5)


@pytest.mark.parametrize("smooth", [True, False])
def test_a_kink_is_met_to_the_last_step(smooth):
    at = np.array([[0.31], [0.62]])
    best, _, calls = climb_of(lambda x: -np.abs(x - at).sum(axis=0), np.full((2, 1), 0.5), 0, 1, smooth=smooth)
    assert -5e-3 < best[0] <= 0
    assert calls <= climb.ROUNDS


def test_leaps_and_moves_end_at_one_place():
    starts = np.array([[0.2, 0.5, 0.9]])
    ends = [climb_of(lambda x: np.sin(3 * x[0]), starts, 0, 1, smooth=smooth) for smooth in (True, False)]
    for best, place, _ in ends:
        assert place == pytest.approx(np.pi / 6, abs=1e-4)
        assert best == pytest.approx(1, abs=1e-8)
    assert ends[0][2] < ends[1][2]


def test_a_climb_far_below_the_others_is_not_waited_for():
    def hills(x):
        return np.where(x[0] < 1, 0.1 - np.abs(x[0] - 0.3), 1 - (x[0] - 2) ** 2)

    _, _, both = climb_of(hills, np.array([[0.23, 2.1]]))
    _, _, alone = climb_of(hills, np.array([[2.1]]))
    _, _, apart = climb_of(hills, np.array([[0.23, 2.1]]), owners=[0, 1])
    assert both == alone < apart


def test_what_is_no_number_is_never_the_top():
    best, place, _ = climb_of(lambda x: np.where(x[0] > 0.6, np.nan, x[0]), np.array([[0.5]]), 0, 1)
    assert 0.59 < place[0, 0] <= 0.6
    assert best[0] == place[0, 0]
