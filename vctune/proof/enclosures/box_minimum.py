"""Lower bounds of polynomials of order two over their boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.proof.enclosures.intervals import Floats
from vctune.proof.enclosures.taylor import Taylor

SWEEPS = 4  # Number of times that the code moves each row of y to its best position
ROUNDING = 2.0**-43  # Rounding error of a bound, relative to the magnitudes in its sum: 1024 u with u = 2^-53


@dataclass(frozen=True, slots=True)
class LowerBound:
    """A lower bound for each of n boxes."""

    bound: Floats  # lower bound of all values over the box; -inf if no bound is known
    estimate: Floats  # approximate value of the polynomial at `at`
    at: Floats  # approximate position of the minimum, each row between -1 and 1, shape (k, n)
    cost: Floats  # amount by which each row lowers the bound, shape (k, n)


def least_over_boxes(number: Taylor) -> LowerBound:
    """Bound a polynomial from below over each of its boxes."""
    k, poly = number.row_count, number.coefficients
    known = np.isfinite(poly).all(axis=0) & np.isfinite(number.radii).all(axis=0)
    poly, rest = np.where(known, poly, 0.0), np.where(known, number.radii, np.inf)
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
    """Return the approximate position of the minimum of g.e + e'S e. The function moves one row at a time."""
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
