"""Numbers with which symmetric matrices that are affine in them are all positive definite: the analytic centre.

In floats. A storage function has some dozen numbers and some hundred small matrices, for which Newton's method on the
logarithms of the determinants takes a second; a solver of semidefinite programs would be one more dependency.
"""

from __future__ import annotations

import numpy as np

from vctune.proof.enclosures.array_intervals import TINY, Floats
from vctune.running import check_time

CENTRED = 0.05
"""Newton decrement, squared, at which a centre is near enough. Half and twice it: the same proofs."""
MAX_STEPS = 400
"""Steps after which nothing is found. Feasible problems take 30 to 150."""
LESS = 0.25
"""Factor of the weight of the barrier in each round. Its square and its root take as many steps within a third."""
GIVE_UP = 1e-3
"""Weight of the barrier, relative to the shortfall, at which there is no solution but by rounding."""
INSIDE = 0.9
"""Share of the way to the border of the feasible numbers that a shortened step goes. Half of it takes twice as long."""


def analytic_centre(constant: Floats, linear: Floats) -> Floats | None:
    """Return numbers y with which all matrices constant + sum y_j linear_j are positive definite, well inside.

    Parameters
    ----------
    constant : p symmetric matrices, shape (p, n, n)
    linear : the part of each number, shape (p, j, n, n)

    Returns
    -------
    array of float or None
        Shape (j,); None if none are found.
    """
    count, size = linear.shape[0], linear.shape[-1]
    size_of = np.sqrt((linear**2).sum(axis=(0, 2, 3)))
    scale = np.where(size_of > 0, size_of, 1.0)
    identity = np.broadcast_to(np.eye(size), (count, 1, size, size))
    parts = np.concatenate([linear / scale[:, None, None], identity], axis=1)
    at = np.zeros(parts.shape[1])
    at[-1] = 1 - np.linalg.eigvalsh(constant).min()  # how much of the identity is added: 0 is to suffice
    weight = 1.0
    for _ in range(MAX_STEPS):
        check_time()
        direction, decrement = _newton(constant, parts, at, count * size / weight)
        at = _moved(constant, parts, at, direction, decrement)
        if at[-1] < 0:
            found = _centred(constant, parts[:, :-1], at[:-1])
            return found / scale
        if decrement < CENTRED:
            if weight < GIVE_UP * at[-1]:
                return None
            weight *= LESS
    return None


def _centred(constant: Floats, parts: Floats, at: Floats) -> Floats:
    for _ in range(MAX_STEPS):
        check_time()
        direction, decrement = _newton(constant, parts, at, 0.0)
        at = _moved(constant, parts, at, direction, decrement)
        if decrement < CENTRED:
            break
    return at


def _newton(constant: Floats, parts: Floats, at: Floats, price: float) -> tuple[Floats, float]:
    """Return Newton's step for price times the last number less all logarithms, and the squared decrement."""
    inverse = np.linalg.inv(_matrices(constant, parts, at))
    over = inverse[:, None] @ parts
    slope = -np.einsum("pjaa->j", over)
    slope[-1] += price
    rows = over.reshape(*over.shape[:2], -1)
    columns = over.swapaxes(2, 3).reshape(*over.shape[:2], -1)
    curvature = np.tensordot(rows, columns, axes=((0, 2), (0, 2)))
    unit = 1 / np.sqrt(np.maximum(np.diagonal(curvature), TINY))
    direction = unit * np.linalg.lstsq(unit[:, None] * curvature * unit, -unit * slope, rcond=1e-15)[0]
    return direction, float(-slope @ direction)


def _moved(constant: Floats, parts: Floats, at: Floats, direction: Floats, decrement: float) -> Floats:
    """Return the numbers after a step that stays inside."""
    share = 1.0 if decrement < 0.25 else 1 / (1 + np.sqrt(decrement))
    share = min(1.0, 4 * share)
    while np.linalg.eigvalsh(_matrices(constant, parts, at + share / INSIDE * direction)).min() <= 0:
        share /= 2
        if share < 1e-12:
            return at
    return np.asarray(at + share * direction)


def _matrices(constant: Floats, parts: Floats, at: Floats) -> Floats:
    return np.asarray(constant + np.tensordot(parts, at, axes=((1,), (0,))))
