"""Coefficients that make symmetric matrices, affine in them, positive definite: the analytic centre.

The search runs in floats. A storage function has some dozen coefficients and some hundred small matrices. Newton's
method on the logarithms of the determinants takes a second for them. A solver of semidefinite programs would be one
more dependency.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, Flags, Floats
from vctune.running import check_time

CENTRED = 0.05
"""Squared Newton decrement at which the search accepts a centre. Half or twice this value leads to the same proofs."""
MAX_STEPS = 250
"""Number of steps after which the search returns nothing. Feasible problems take 30 to 190 steps."""
LESS = 0.25
"""Factor of the weight of the barrier from one round to the next. With its square or its root, the search takes the
same number of steps within a third."""
GIVE_UP = 0.2
"""Weight of the barrier, relative to the shortfall, at which the search concludes that there is no solution. The least
possible shortfall is smaller than the present one by at most that weight. Half or twice this value leads to the same
proofs."""
INSIDE = 0.9
"""Share of the way to the border of the feasible coefficients that a shortened step covers. With half this share, the
search takes twice as long."""


class Family(NamedTuple):
    """The terms sum_tu w_t U_u y_tu of p sums of matrices; y_tu are the coefficients.

    Attributes
    ----------
    weights : w_t for each of the p sums, shape (p, t)
    units : U_u for each of the p sums, symmetric matrices, shape (p, u, n, n)
    """

    weights: Floats
    units: Floats


def analytic_centre(constant: Floats, families: Sequence[Family], free: Flags) -> Floats | None:
    """Return coefficients y that make all matrices constant + sum w_t U_u y_tu positive definite by a wide margin.

    Parameters
    ----------
    constant : p symmetric matrices, shape (p, n, n)
    families : families of terms over which the sum runs; the coefficients y_tu are the same for all of them
    free : whether a coefficient may differ from 0, shape (t, u)

    Returns
    -------
    array of float or None
        Shape (t, u), 0 for coefficients that are not free; None if the search finds none.
    """
    sums = _Sums(constant, families, np.append(free.ravel(), True))
    at = np.zeros(free.size + 1)
    at[-1] = 1 - np.linalg.eigvalsh(constant).min()  # multiple of the identity that is added; the search lowers it to 0
    weight, count = 1.0, constant.shape[0] * constant.shape[-1]
    for _ in range(MAX_STEPS):
        check_time()
        direction, decrement = _newton(sums, at, count / weight)
        at = _moved(sums, at, direction, decrement)
        if at[-1] < 0:
            return _centred(sums, at).reshape(free.shape)
        if decrement < CENTRED:
            if weight < GIVE_UP * at[-1]:
                return None
            weight *= LESS
    return None


class _Sums(NamedTuple):
    """Sums of matrices, and which coefficients are free; the last coefficient is that of the identity."""

    constant: Floats
    families: Sequence[Family]
    free: Flags

    def at(self, numbers: Floats) -> Floats:
        """Return the sums for given coefficients."""
        found = self.constant + numbers[-1] * np.eye(self.constant.shape[-1])
        for weights, units in self.families:
            mixed = weights @ numbers[:-1].reshape(weights.shape[1], -1)
            found = found + np.einsum("pu,puij->pij", mixed, units, optimize=True)
        return np.asarray(found)


def _centred(sums: _Sums, at: Floats) -> Floats:
    sums, at = sums._replace(free=np.append(sums.free[:-1], False)), np.append(at[:-1], 0.0)
    for _ in range(MAX_STEPS):
        check_time()
        direction, decrement = _newton(sums, at, 0.0)
        at = _moved(sums, at, direction, decrement)
        if decrement < CENTRED:
            break
    return at[:-1]


def _newton(sums: _Sums, at: Floats, price: float) -> tuple[Floats, float]:
    """Return Newton's step and its squared decrement.

    The objective is price times the last coefficient minus the logarithms of all determinants.
    """
    turn = np.linalg.inv(np.linalg.cholesky(sums.at(at)))
    rows, columns = np.triu_indices(turn.shape[-1])
    twice = np.where(rows == columns, 1.0, np.sqrt(2.0))

    def halved(units: Floats) -> Floats:
        """Return half of each unit in coordinates in which the sums are 1. Scalar products do not change."""
        seen = turn[:, None] @ units @ turn[:, None].swapaxes(-1, -2)
        return np.asarray(seen[..., rows, columns] * twice)

    seen = [(weights, halved(units)) for weights, units in sums.families]
    added = halved(np.eye(turn.shape[-1])[None, None])[:, 0]
    one = halved(sums.at(at)[:, None])[:, 0]
    size = at.size
    slope, curvature = np.zeros(size), np.zeros((size, size))
    slope[-1], curvature[-1, -1] = price - (added * one).sum(), (added**2).sum()
    for weights, units in seen:
        slope[:-1] -= (weights.T @ np.einsum("puk,pk->pu", units, one)).ravel()
        curvature[-1, :-1] += (weights.T @ np.einsum("puk,pk->pu", units, added)).ravel()
        for others, more in seen:
            curvature[:-1, :-1] += _crossed(weights, units, others, more)
    curvature[:-1, -1] = curvature[-1, :-1]
    slope, curvature = slope[sums.free], curvature[np.ix_(sums.free, sums.free)]
    unit = 1 / np.sqrt(np.maximum(np.diagonal(curvature), TINY))
    found = np.linalg.lstsq(unit[:, None] * curvature * unit, -unit * slope, rcond=1e-15)[0]
    direction = np.zeros(size)
    direction[sums.free] = unit * found
    return direction, float(-slope @ (unit * found))


def _crossed(weights: Floats, units: Floats, others: Floats, more: Floats) -> Floats:
    """Return the scalar products of the terms of two families."""
    gram = units @ more.swapaxes(-1, -2)  # (p, u, u)
    outer = weights[:, :, None] * others[:, None, :]
    terms, count = weights.shape[1], units.shape[1]
    mixed = np.tensordot(outer, gram, axes=((0,), (0,)))  # (t, t, u, u)
    return np.asarray(mixed.transpose(0, 2, 1, 3).reshape(terms * count, terms * count))


def _roots(matrices: Floats) -> Floats | None:
    """Return the Cholesky factors of matrices; None if one is not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        return None


def _moved(sums: _Sums, at: Floats, direction: Floats, decrement: float) -> Floats:
    """Return the coefficients after a step, shortened so that all sums stay positive definite."""
    share = 1.0 if decrement < 0.25 else 1 / (1 + np.sqrt(decrement))
    share = min(1.0, 4 * share)
    while _roots(sums.at(at + share / INSIDE * direction)) is None or _roots(sums.at(at + share * direction)) is None:
        share /= 2
        if share < 1e-12:
            return at
    return np.asarray(at + share * direction)
