"""Symmetric matrices over boxes, polynomials in the boxes' rows, that are surely positive definite.

W A W' is positive definite only if A is, whatever W. W is chosen so that the product is nearly 1 in the middle of a
box. It is positive definite throughout if the norms of its difference from 1 and of its other coefficients add up to
less than 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, UNIT, Flags, Floats
from vctune.proof.enclosures.taylor import SWOLLEN, Taylor


class Definite(NamedTuple):
    """What is known of a matrix over n boxes.

    Attributes
    ----------
    proved : where it is positive definite throughout, shape (n,)
    fails : where it is not in the middle, in floats
    losses : by how much each row of the box lowers the bound, shape (rows, n)
    """

    proved: Flags
    fails: Flags
    losses: Floats


def surely_definite(matrix: Taylor) -> Definite:
    """Return where a matrix is positive definite for all values of a box's rows.

    Parameters
    ----------
    matrix : of shape (m, m, n)
    """
    k, m = matrix.rows, matrix.poly.shape[1]
    poly, rest = (np.moveaxis(part, -1, 1) for part in (matrix.poly, matrix.rest))  # (coefficients, n, m, m)
    with np.errstate(all="ignore"):
        middle = 0.5 * (poly[0] + poly[0].swapaxes(-1, -2))
        known = np.asarray(np.isfinite(poly).all(axis=(0, 2, 3)) & np.isfinite(rest).all(axis=(0, 2, 3)))
        middle = np.where(known[:, None, None], middle, np.eye(m))
        unit = 1 / np.sqrt(np.abs(np.diagonal(middle, axis1=-2, axis2=-1)) + TINY)  # states of any size
        values, vectors = np.linalg.eigh(unit[:, :, None] * middle * unit[:, None, :])
        fails: Flags = known & (values[:, 0] <= 0)
        usable: Flags = known & ~fails
        by = np.where(usable[:, None, None], vectors.swapaxes(-1, -2), 0.0) / np.sqrt(np.abs(values) + TINY)[..., None]
        by *= unit[:, None, :]
        across, size = by.swapaxes(-1, -2), np.abs(by)
        turned = by @ poly @ across
        turned[0] -= np.eye(m)
        # a product of three m x m matrices, and the difference: fewer than 4 m + 8 roundings of the sizes' product
        rounding = (4 * m + 8) * UNIT * (np.abs(poly).sum(axis=0) + TINY)
        rests = size @ np.concatenate([rest, rounding[None]]) @ size.swapaxes(-1, -2)
        norms, left = (np.sqrt((each**2).sum(axis=(-1, -2))) for each in (turned, rests))
        total = (norms.sum(axis=0) + left.sum(axis=0) + 4 * UNIT * m) * SWOLLEN
        proved = usable & (total < 1)
        parts = norms[1 : 1 + k] + left[:k]
        for norm, (i, j) in zip(norms[1 + k :], zip(*np.triu_indices(k), strict=True), strict=True):
            parts[i] += 0.5 * norm
            parts[j] += 0.5 * norm
    return Definite(proved, fails, np.where(usable, parts, np.inf))
