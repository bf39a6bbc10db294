"""Positive definite matrices over boxes: symmetric matrices whose entries are polynomials in the rows of a box.

If W A W' is positive definite, then so is A, for any W. The function chooses W so that the product is nearly the
identity in the middle of a box. The product is positive definite throughout the box if the norms of two parts add up to
less than 1: its difference from the identity in the middle, and its other coefficients.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, UNIT, Flags, Floats
from vctune.proof.enclosures.taylor import SWOLLEN, Taylor


class Definite(NamedTuple):
    """The verdict on a matrix over n boxes.

    Attributes
    ----------
    proved : whether the matrix is positive definite throughout the box, shape (n,)
    fails : whether the matrix is not positive definite in the middle of the box, computed in floats
    losses : amount by which each row of the box lowers the bound, shape (rows, n)
    """

    proved: Flags
    fails: Flags
    losses: Floats


def surely_definite(matrix: Taylor) -> Definite:
    """Return on which boxes a matrix is positive definite for all values of the rows.

    Parameters
    ----------
    matrix : symmetric matrix of polynomials, shape (m, m, n)
    """
    k, m = matrix.rows, matrix.poly.shape[1]
    poly, rest = (np.moveaxis(part, -1, 1) for part in (matrix.poly, matrix.rest))  # (coefficients, n, m, m)
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
        turned[0] -= np.eye(m)
        # a product of three m x m matrices and a difference take fewer than 4 m + 8 roundings of the magnitudes
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
