"""Positive definite matrices over boxes: symmetric matrices whose entries are polynomials in the rows of a box."""

from __future__ import annotations

from itertools import combinations_with_replacement, product
from typing import NamedTuple

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, UNIT, Enclosure, Flags, Floats
from vctune.proof.enclosures.taylor import SWOLLEN, Taylor


class Definite(NamedTuple):
    """The verdict on a matrix over n boxes."""

    proved: Flags  # whether the matrix is positive definite throughout the box, shape (n,)
    fails: Flags  # whether the matrix is not positive definite in the middle of the box, computed in floats
    losses: Floats  # amount by which each row of the box lowers the bound, shape (rows, n)


def surely_definite(matrix: Taylor) -> Definite:
    """Return on which boxes a matrix is positive definite for all values of the rows."""
    k, m = matrix.row_count, matrix.coefficients.shape[1]
    poly, rest = (np.moveaxis(part, -1, 1) for part in (matrix.coefficients, matrix.radii))  # (coefficients, n, m, m)
    with np.errstate(all="ignore"):
        middle = 0.5 * (poly[0] + poly[0].swapaxes(-1, -2))
        known = np.asarray(np.isfinite(poly).all(axis=(0, 2, 3)) & np.isfinite(rest).all(axis=(0, 2, 3)))
        middle = np.where(known[:, None, None], middle, np.eye(m))
        unit = 1 / np.sqrt(np.abs(np.diagonal(middle, axis1=-2, axis2=-1)) + TINY)  # scales the states
        values, vectors = np.linalg.eigh(unit[:, :, None] * middle * unit[:, None, :])
        fails: Flags = known & (values[:, 0] <= 0)
        usable: Flags = known & ~fails
        by = np.where(usable[:, None, None], vectors.swapaxes(-1, -2), 0.0) / np.sqrt(np.abs(values) + TINY)[..., None]
        by *= unit[:, None, :]
        across, size = by.swapaxes(-1, -2), np.abs(by)
        turned = by @ poly @ across
        # a product of three m x m matrices takes fewer than 4 m + 8 roundings of the magnitudes
        rounding = (4 * m + 8) * UNIT * (np.abs(poly).sum(axis=0) + TINY)
        rests = size @ np.concatenate([rest, rounding[None]]) @ size.swapaxes(-1, -2)
        proved: Flags = usable & _at_vertices(turned, rests.sum(axis=0), k)
        losses = _losses(turned, rests, k)
    return Definite(proved, fails, np.where(usable, losses, np.inf))


def _at_vertices(turned: Floats, rest: Floats, rows: int) -> Flags:
    """Return which matrices are positive definite at each vertex, for all values of the squares and of the
    remainder."""
    pairs = list(combinations_with_replacement(range(rows), 2))
    named = [*((row,) for row in range(rows)), *pairs]
    used = {row for at, names in enumerate(named, 1) if turned[at].any() for row in names}
    squares = turned[[1 + rows + at for at, (i, j) in enumerate(pairs) if i == j]]
    shares = [
        [1.0, *signs, *(0.5 if i == j else signs[i] * signs[j] for i, j in pairs)]
        for signs in product(*((-1.0, 1.0) if row in used else (0.0,) for row in range(rows)))
    ]
    mid = np.tensordot(np.array(shares), turned, axes=1)
    rounding = 2 * len(turned) * UNIT * np.abs(turned).sum(axis=0)
    left = Enclosure(mid, np.broadcast_to((0.5 * np.abs(squares).sum(axis=0) + rest + rounding) * SWOLLEN, mid.shape))
    positive: Flags = np.ones(mid.shape[:2], bool)
    for _ in range(mid.shape[-1]):  # LDL'
        pivot = left[..., :1, :1]
        positive = positive & pivot.positive()[..., 0, 0]
        left = left[..., 1:, 1:] - left[..., 1:, :1] * (left[..., :1, 1:] / pivot)
    return np.asarray(positive.all(axis=0))


def _losses(turned: Floats, rests: Floats, rows: int) -> Floats:
    norms, left = (np.sqrt((each**2).sum(axis=(-1, -2))) for each in (turned, rests))
    parts = norms[1 : 1 + rows] + left[:rows]
    for norm, (i, j) in zip(norms[1 + rows :], zip(*np.triu_indices(rows), strict=True), strict=True):
        parts[i] += 0.5 * norm
        parts[j] += 0.5 * norm
    return np.asarray(parts)
