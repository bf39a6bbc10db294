"""Matrices over boxes that are called positive definite are so at every point, and more of them than norms prove."""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np

from vctune.proof.enclosures.taylor import Taylor
from vctune.proof.storage.definite import surely_definite

ROWS, SIZE, BOXES = 3, 4, 300


def random_boxes(rng):
    """Return coefficients of symmetric matrices over boxes, around ones of any scale, and their remainders."""
    pairs = len(list(combinations_with_replacement(range(ROWS), 2)))
    poly = rng.normal(size=(1 + ROWS + pairs, SIZE, SIZE, BOXES)) * rng.uniform(0, 0.5, BOXES)
    poly[1 + ROWS :] *= 0.2
    poly[0] = 0.3 * poly[0] + np.eye(SIZE)[..., None]
    rest = np.abs(rng.normal(size=(ROWS + 1, SIZE, SIZE, BOXES))) * 0.005
    scale = 10.0 ** rng.uniform(-4, 4, SIZE)
    across = np.outer(scale, scale)[..., None]
    return (poly + poly.swapaxes(1, 2)) / 2 * across, (rest + rest.swapaxes(1, 2)) / 2 * across, scale


def members(rng, poly, rest):
    """Yield matrices of the boxes: at vertices and inside, with the remainder that some direction dislikes."""
    for at in [*product((-1.0, 1.0), repeat=ROWS), *rng.uniform(-1, 1, (40, ROWS))]:
        shares = [1.0, *at, *(at[i] * at[j] for i, j in combinations_with_replacement(range(ROWS), 2))]
        signs = rng.choice([-1.0, 1.0], SIZE)
        yield np.tensordot(shares, poly, axes=1) - np.outer(signs, signs)[..., None] * rest.sum(axis=0)


def test_what_is_proved_is_definite_and_more_is_than_by_norms():
    rng = np.random.default_rng(0)
    poly, rest, scale = random_boxes(rng)
    found = surely_definite(Taylor(ROWS, poly, rest))
    unit = 1 / np.outer(scale, scale)[..., None]
    for each in members(rng, poly, rest):
        least = np.linalg.eigvalsh(np.moveaxis(each * unit, -1, 0))[:, 0]
        assert (least[found.proved] > 0).all()
    middle = np.linalg.eigvalsh(np.moveaxis(poly[0] * unit, -1, 0))[:, 0]
    assert (found.fails == (middle <= 0)).all()
    sums = np.sqrt((poly[1:] ** 2 * unit**2).sum(axis=(1, 2))).sum(axis=0)
    by_norms = (sums + np.sqrt(((rest.sum(axis=0) * unit) ** 2).sum(axis=(0, 1)))) < middle
    assert found.proved[by_norms].all() and found.proved.sum() > 1.3 * by_norms.sum() > 0


def test_a_matrix_that_is_singular_at_a_vertex_is_left_open():
    poly, rest = np.zeros((1 + ROWS + 6, 2, 2, 2)), np.zeros((ROWS + 1, 2, 2, 2))
    poly[0], poly[1] = np.eye(2)[..., None], np.diag([1.0, 0.0])[..., None]
    poly[1, ..., 1] *= 1 - 1e-12
    assert surely_definite(Taylor(ROWS, poly, rest)).proved.tolist() == [False, True]


def test_rows_that_act_only_together_are_not_left_out():
    poly, rest = np.zeros((1 + ROWS + 6, 2, 2, 1)), np.zeros((ROWS + 1, 2, 2, 1))
    poly[0], poly[1 + ROWS + 1] = np.eye(2)[..., None], 1.5 * np.diag([1.0, 0.0])[..., None]  # e_1 e_2
    assert not surely_definite(Taylor(ROWS, poly, rest)).proved.any()
