"""Numbers with which symmetric matrices that are affine in them are all positive definite: the analytic centre.

In floats. A storage function has some dozen numbers and some hundred small matrices, for which Newton's method on the
logarithms of the determinants takes a second; a solver of semidefinite programs would be one more dependency.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, Flags, Floats
from vctune.running import check_time

CENTRED = 0.05
"""Newton decrement, squared, at which a centre is near enough. Half and twice it: the same proofs."""
MAX_STEPS = 250
"""Steps after which nothing is found. Feasible problems take 30 to 190."""
LESS = 0.25
"""Factor of the weight of the barrier in each round. Its square and its root take as many steps within a third."""
GIVE_UP = 0.2
"""Weight of the barrier, relative to the shortfall, at which there is no solution: the least shortfall is smaller than
the present one by no more than that weight. Half and twice it: the same proofs."""
INSIDE = 0.9
"""Share of the way to the border of the feasible numbers that a shortened step goes. Half of it takes twice as long."""


class Family(NamedTuple):
    """Matrices w_t U_u, the part of the number y_tu, for p sums of matrices.

    Attributes
    ----------
    weights : w, shape (p, t)
    units : U, symmetric, shape (p, u, n, n)
    """

    weights: Floats
    units: Floats


def analytic_centre(constant: Floats, families: Sequence[Family], free: Flags) -> Floats | None:
    """Return numbers y with which all matrices constant + sum w_t U_u y_tu are positive definite, well inside.

    Parameters
    ----------
    constant : p symmetric matrices, shape (p, n, n)
    families : the sum runs over all of them; all have the same numbers t and u
    free : whether a number may be other than 0, shape (t, u)

    Returns
    -------
    array of float or None
        Shape (t, u), 0 where it is not free; None if none are found.
    """
    sums = _Sums(constant, families, np.append(free.ravel(), True))
    at = np.zeros(free.size + 1)
    at[-1] = 1 - np.linalg.eigvalsh(constant).min()  # how much of the identity is added: 0 is to suffice
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
    """Sums of matrices, and which of their numbers are free; the last number is that of the identity."""

    constant: Floats
    families: Sequence[Family]
    free: Flags

    def at(self, numbers: Floats) -> Floats:
        """Return the matrices."""
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
    """Return Newton's step for price times the last number less all logarithms, and the squared decrement."""
    turn = np.linalg.inv(np.linalg.cholesky(sums.at(at)))
    rows, columns = np.triu_indices(turn.shape[-1])
    twice = np.where(rows == columns, 1.0, np.sqrt(2.0))

    def halved(units: Floats) -> Floats:
        """Return half of each unit, in coordinates in which the matrices are 1; scalar products stay as they are."""
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
    """Return the scalar products of the parts of two families."""
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
    """Return the numbers after a step that stays inside."""
    share = 1.0 if decrement < 0.25 else 1 / (1 + np.sqrt(decrement))
    share = min(1.0, 4 * share)
    while _roots(sums.at(at + share / INSIDE * direction)) is None or _roots(sums.at(at + share * direction)) is None:
        share /= 2
        if share < 1e-12:
            return at
    return np.asarray(at + share * direction)
