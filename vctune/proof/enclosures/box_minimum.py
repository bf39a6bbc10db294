"""Lower bounds of polynomials of order two over their boxes.

For any y, with S positive semidefinite, e'S e >= 2 y'S e - y'S y: the tangent at y bounds a convex polynomial from
below. Over a box a tangent is least at a corner. With the y at the minimum the bound is exact (Boyd and Vandenberghe
2004, section 5). The part of e'H e that is not convex enters with its magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.enclosures.taylor import Taylor

SWEEPS = 4
"""Number of times that each row of y is moved to its best place. Half and twice as many need the same number of boxes
to within a hundredth."""
ROUNDING = 2.0**-43
"""Rounding error of a bound, relative to the magnitudes in its sum: 1024 u with u = 2^-53. For 14 rows, a product of
two matrices or of a matrix and a vector takes 14 roundings, and so does a sum over rows. There are two of the former
and eight of the latter. With the sum of 120 coefficients and a dozen further operations, the count is 272. A remainder
is not among these magnitudes: where it is the greater, nothing is proved. Half this number would suffice; twice it
widens nothing that matters."""


@dataclass(frozen=True, slots=True)
class LowerBound:
    """A lower bound for each of n boxes.

    Attributes
    ----------
    bound : no value in the box is below it; -inf without a bound
    estimate : approximate value at `at`
    at : approximate position of the minimum, each row between -1 and 1, shape (k, n)
    cost : loss of the bound due to each row, shape (k, n)
    """

    bound: Floats
    estimate: Floats
    at: Floats
    cost: Floats


def least_over_boxes(number: Taylor) -> LowerBound:
    """Bound a number from below over each of its boxes.

    Parameters
    ----------
    number : number over n boxes
    """
    k, poly = number.rows, number.poly
    known = np.isfinite(poly).all(axis=0) & np.isfinite(number.rest).all(axis=0)
    poly, rest = np.where(known, poly, 0.0), np.where(known, number.rest, np.inf)
    constant, slopes = poly[0], poly[1 : 1 + k]
    i, j = np.triu_indices(k)
    curved = np.zeros((poly.shape[1], k, k))
    curved[:, i, j] = 0.5 * poly[1 + k :].T
    curved += curved.transpose(0, 2, 1)
    values, vectors = np.linalg.eigh(curved)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    convex = np.moveaxis(roots @ roots.transpose(0, 2, 1), 0, -1)
    others = np.moveaxis(curved, 0, -1) - convex
    at = _nearly_least(slopes, convex)
    moved = np.einsum("ijn,jn->in", convex, at)
    lower = -np.abs(slopes + 2 * moved).sum(axis=0) - (at * moved).sum(axis=0)
    own = np.einsum("iin->in", others)
    lost = np.abs(others).sum(axis=1) - np.abs(own) + np.maximum(-own, 0.0)
    size = np.abs(poly).sum(axis=0) + k * np.einsum("iin->n", convex) + np.abs(others).sum(axis=(0, 1))
    bound = constant + lower - lost.sum(axis=0) - rest.sum(axis=0)
    estimate = constant + (slopes * at).sum(axis=0) + np.einsum("in,ijn,jn->n", at, convex + others, at)
    return LowerBound(np.where(known, bound - ROUNDING * size, -np.inf), estimate, at, lost + rest[:-1])


def _nearly_least(slopes: Floats, convex: Floats) -> Floats:
    """Return the approximate position at which g.e + e'S e is least, found row by row."""
    at, moved = np.zeros_like(slopes), np.zeros_like(slopes)
    for _ in range(SWEEPS):
        for row, own in enumerate(np.einsum("iin->in", convex)):
            pull = 0.5 * slopes[row] + moved[row] - own * at[row]
            with np.errstate(all="ignore"):
                best = np.where(own > 0, -pull / own, -np.sign(pull))
            best = np.clip(np.where(np.isnan(best), 0.0, best), -1.0, 1.0)
            moved = moved + convex[:, row] * (best - at[row])
            at[row] = best
    return at
