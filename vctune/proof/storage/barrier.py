"""Find coefficients with which symmetric matrices, affine in the coefficients, are positive definite, by an interior
point method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, Flags, Floats
from vctune.running import check_time

CENTRED = 0.5  # Squared Newton decrement at which the search accepts a centre
MAX_STEPS = 250  # Number of steps after which the search stops
LESS = 0.1  # Factor of the weight of the barrier from one round to the next
# Weight of the barrier, relative to the shortfall, at which the search concludes that there is no solution
GIVE_UP = 0.2
BETTER = 1.1  # Factor by which the least eigenvalue must grow in a round before the search starts another round
LONGEST = 16.0  # Greatest length of a step, in Newton decrements
INSIDE = 0.9  # Greatest share of the way to the border of the feasible coefficients that a step covers
# Multiple of the identity that the search adds to the curvature, after scaling the curvature to a diagonal of 1
RIDGE = 1e-13


class Family(NamedTuple):
    """The terms sum_tu w_t U_u y_tu of p sums of matrices; y_tu are the coefficients."""

    weights: Floats  # w_t for each of the p sums, shape (p, t)
    units: Floats  # U_u for each of the p sums, symmetric matrices, shape (p, u, n, n)


class Sums(NamedTuple):
    """Sums of matrices, constant + sum w_t U_u y_tu."""

    constant: Floats  # p symmetric matrices, shape (p, n, n)
    families: Sequence[Family]  # families of terms over which the sum runs
    free: Flags  # whether a coefficient may differ from 0, shape (t, u)

    def at(self, numbers: Floats, added: float = 0.0) -> Floats:
        """Return the matrices plus a multiple of the identity."""
        found = self.constant + added * np.eye(self.constant.shape[-1])
        for weights, units in self.families:
            mixed = (weights @ numbers)[:, None] @ units.reshape(*units.shape[:2], -1)
            found = found + mixed.reshape(found.shape)
        return np.asarray(found)


def well_inside(sums: Sums) -> Floats | None:
    """Return coefficients that make all matrices positive definite, with nearly the greatest possible least
    eigenvalue."""
    numbers, weight, least = np.zeros(sums.free.shape), 1.0, 0.0
    added = 1 - float(np.linalg.eigvalsh(sums.constant).min())  # multiple of the identity; the search makes it negative
    count = sums.constant.shape[0] * sums.constant.shape[-1]
    for _ in range(MAX_STEPS):
        check_time()
        step, more, decrement = _newton(sums, numbers, added, count / weight)
        share = 1.0 if decrement < 0.25 else min(1.0, LONGEST / (1 + np.sqrt(decrement)))
        while not all(_definite(sums.at(numbers + far * step, added + far * more)) for far in (share, share / INSIDE)):
            share /= 2
            if share < 1e-12:
                return numbers if added < 0 else None
        numbers, added = numbers + share * step, added + share * more
        if decrement >= CENTRED:
            continue
        if added < 0 and -added < BETTER * least:
            return numbers
        if weight < GIVE_UP * added:
            return None
        least, weight = max(least, -added), weight * LESS
    return numbers if added < 0 else None


def _newton(sums: Sums, numbers: Floats, added: float, price: float) -> tuple[Floats, float, float]:
    """Return Newton's step in the coefficients and in `added`, and its squared decrement."""
    matrices = sums.at(numbers, added)
    turn = np.linalg.inv(np.linalg.cholesky(matrices))
    rows, columns = np.triu_indices(turn.shape[-1])
    twice = np.where(rows == columns, 1.0, np.sqrt(2.0))

    def halved(units: Floats) -> Floats:
        """Return the upper triangle of each unit, in coordinates in which the sums are 1."""
        seen = turn[:, None] @ units @ turn[:, None].swapaxes(-1, -2)
        return np.asarray(seen[..., rows, columns] * twice)

    seen = [(weights, halved(units)) for weights, units in sums.families]
    unit = halved(np.eye(turn.shape[-1])[None, None])[:, 0]
    one = halved(matrices[:, None])[:, 0]
    size = numbers.size + 1
    slope, curvature = np.zeros(size), np.zeros((size, size))
    slope[-1], curvature[-1, -1] = price - (unit * one).sum(), (unit**2).sum()
    for place, (weights, units) in enumerate(seen):
        slope[:-1] -= (weights.T @ (units @ one[..., None])[..., 0]).ravel()
        curvature[-1, :-1] += (weights.T @ (units @ unit[..., None])[..., 0]).ravel()
        for others, more in seen[place:]:
            crossed = _crossed(weights, units, others, more)
            curvature[:-1, :-1] += crossed if more is units else crossed + crossed.T
    curvature[:-1, -1] = curvature[-1, :-1]
    free = np.append(sums.free.ravel(), True)
    slope, curvature = slope[free], curvature[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(curvature), TINY))
    found = np.linalg.solve(scale[:, None] * curvature * scale + RIDGE * np.eye(scale.size), -scale * slope) * scale
    step = np.zeros(size)
    step[free] = found
    return step[:-1].reshape(numbers.shape), float(step[-1]), float(-slope @ found)


def _crossed(weights: Floats, units: Floats, others: Floats, more: Floats) -> Floats:
    """Return the scalar products of the terms of two families."""
    gram = units @ more.swapaxes(-1, -2)  # (p, u, u)
    outer = weights[:, :, None] * others[:, None, :]
    terms, count = weights.shape[1], units.shape[1]
    mixed = np.tensordot(outer, gram, axes=((0,), (0,)))  # (t, t, u, u)
    return np.asarray(mixed.transpose(0, 2, 1, 3).reshape(terms * count, terms * count))


def _definite(matrices: Floats) -> bool:
    """Return whether all matrices are positive definite, computed in floats."""
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return False
    return True
