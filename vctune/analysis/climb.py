"""Climb to the maxima of a function of several coordinates near given starts.

`hardest_hands` uses this climb to find the hands that require the most of a coupling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations, product
from math import inf

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.running import check_time

ROUNDS = 22
"""Greatest number of stencils of a climb. A climb that only halves its steps needs 14 to reach `LEAST_STEP`, and one
more for each move. With half as many stencils, a climb at a kink ends too early, and the prover must find the exact
hand. With twice as many, vctune finds the same designs."""
LEAST_STEP = 1e-4
"""Step at which a climb ends, relative to its first step. At a smooth maximum, the value depends on the square of this
step. With half or twice this step, vctune finds the same designs."""
SHRINK = 8.0
"""Greatest factor by which a leap reduces the steps. The distance of the next centre from the maximum falls with the
square of the step, so that a climb needs about five stencils. With half this factor, a climb needs seven stencils. With
twice this factor, more leaps from the first stencil fail."""
LEAP = 4.0
"""Greatest length of a leap, in steps. With twice this length, more leaps fail. With half this length, climbs along a
ridge are slower."""
TRIALS = 3
"""Number of failed leaps after which a climb only moves and halves its steps. The first leap may fail where the values
are smooth, because the first steps are long. With half or twice this number, vctune finds the same designs."""
RESOLVED = 1e-8
"""Relative difference of values that a climb ignores when it examines a leap, because this difference is as small as
the effect of `LEAST_STEP`."""
FLATTEST = 1e-6
"""Least curvature of a parabola in any direction, relative to its greatest curvature. Along a flatter direction, a leap
would be arbitrarily long before `LEAP` limits it."""
CONSIDERED = 0.75
"""Share of the greatest value below which a climb may end early. A hand that requires less than this share of what
another hand requires limits no design. With half or twice this share (at most 1), vctune finds the same designs."""


@np.errstate(all="ignore")
def climbed(
    values: Callable[[Floats], Floats],
    starts: Floats,
    low: Floats,
    high: Floats,
    steps: Floats,
    groups: Sequence[int],
    owners: Sequence[int],
    *,
    enough: float = inf,
    smooth: bool = True,
) -> tuple[Floats, Floats]:
    """Climb from each start to a maximum near it.

    All climbs run together. In each round, the function evaluates a stencil about the centre of each climb. The stencil
    has three nodes for each coordinate. A parabola through the stencil predicts where the maximum is. If the value
    there exceeds all known values, the climb leaps to this place and makes its steps shorter. Otherwise the climb moves
    to the best node, or halves its steps if the centre is the best node.

    Parameters
    ----------
    values : function that receives the nodes, shape (d, n, 3), and returns the values of the n stencils, shape
        (n, 3^d), with the last coordinate varying fastest
    starts : d coordinates of n starts, shape (d, n)
    low, high : bounds of the coordinates, shape (d, n)
    steps : first step of each coordinate, shape (d,)
    groups : for each coordinate, the number of its group; if a coordinate moves, its group keeps its steps
    owners : for each start, the number of its owner. An owner's climbs end when all climbs of this owner whose value is
        at least `CONSIDERED` times the greatest value have ended; other owners have no influence
    enough : greatest value with which the rule for an owner's climbs compares. A climb with a greater value therefore
        does not end other climbs whose values are near `enough`
    smooth : whether the values are smooth enough for leaps

    Returns
    -------
    greatest : the greatest value of each climb, shape (n,)
    places : coordinates of the greatest value of each climb, shape (d, n)
    """
    count, climbs = starts.shape
    stencil = np.array([*product(range(3), repeat=count)]).T
    middle, every, least = stencil.shape[1] // 2, np.arange(climbs), LEAST_STEP * steps[:, None]
    kin, owned = np.equal.outer(groups, groups), [np.equal(owners, owner) for owner in sorted({*owners})]
    going = np.full(climbs, True)
    centre, place, step = starts, starts, np.repeat(steps[:, None], climbs, axis=1)
    best, leapt_from, moved = np.full(climbs, -inf), step, np.full(starts.shape, False)
    leapt, failures = np.full(climbs, False), np.full(climbs, 0 if smooth else TRIALS)
    for _ in range(ROUNDS):
        check_time()
        nodes = np.clip(centre[..., None] + np.array([-1, 0, 1]) * step[..., None], low[..., None], high[..., None])
        found = np.nan_to_num(values(nodes), nan=-inf, posinf=inf)  # 0/0 is not a value
        at = np.where(found[:, middle] >= found.max(axis=1), middle, np.argmax(found, axis=1))
        there, value = np.take_along_axis(nodes, stencil[:, at, None], axis=2)[..., 0], found[every, at]
        failed, better = leapt & (found[:, middle] < best - RESOLVED * np.abs(best)), going & (value > best)
        again, moved = moved, better & (there != place)
        best, place = np.maximum(best, value), np.where(better, there, place)
        failures += failed
        step = np.where(failed & ~better, leapt_from, step)
        leapt_from, centre = step, place
        longer = np.where(again & moved & smooth, 2 * step, step)
        step = np.where(kin @ moved & ~failed, longer, step / 2)
        hopeful = np.flatnonzero((failures < TRIALS) & ~failed)
        leapt = np.full(climbs, False)
        if hopeful.size:
            before = leapt_from[:, hopeful]
            predicted, shift = _parabola(found[hopeful], nodes[:, hopeful], LEAP * before)
            leapt[hopeful] = leaps = predicted >= best[hopeful]
            which, shift = hopeful[leaps], shift[:, leaps]
            centre, step = centre.copy(), step.copy()
            centre[:, which] = np.clip(nodes[:, which, 1] + shift, low[:, which], high[:, which])
            step[:, which] = np.clip(np.abs(shift) / 2, before[:, leaps] / SHRINK, before[:, leaps])
        for own in owned:
            top = min(float(best[own].max()), enough)
            awaited = own & (best >= (top * CONSIDERED if top > 0 else top / CONSIDERED))
            going[own] &= not np.all(step[:, awaited] < least)
        if not going.any():
            break
    return best, place


def _parabola(found: Floats, nodes: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Return the place near the middle node at which the parabola through each stencil is greatest.

    The function takes the absolute values of the curvatures, so that a leap along an upward curvature also goes uphill.
    A coordinate whose middle node is on a bound keeps its value.

    Parameters
    ----------
    found : values of n stencils, shape (n, 3^d)
    nodes : nodes of d coordinates, shape (d, n, 3)
    reach : greatest distance of each coordinate from the middle node, shape (d, n)

    Returns
    -------
    predicted : value of the parabola there, shape (n,)
    shift : distance of this place from the middle node, shape (d, n)
    """
    count, climbs = nodes.shape[:2]
    axes, (lines, planes) = range(count), _through_middle(count)
    first, second = np.triu_indices(count, 1)
    below, above = (nodes[..., 1] - nodes[..., 0]).T, (nodes[..., 2] - nodes[..., 1]).T  # shape (n, d)
    inside, whole = (below > 0) & (above > 0), below + above
    # first and second derivatives of the parabola through three nodes at unequal distances
    slopes = np.stack([-above / (below * whole), (above - below) / (below * above), below / (above * whole)], axis=-1)
    bends = 2 * np.stack([1 / (below * whole), -1 / (below * above), 1 / (above * whole)], axis=-1)
    gradient = np.where(inside, np.sum(slopes * found[:, lines], axis=-1), 0.0)
    hessian = np.zeros((climbs, count, count))
    hessian[:, axes, axes] = np.where(inside, np.sum(bends * found[:, lines], axis=-1), -1.0)
    if first.size:
        mixed = np.einsum("npab,npa,npb->np", found[:, planes], slopes[:, first], slopes[:, second])
        mixed = np.where(inside[:, first] & inside[:, second], mixed, 0.0)
        hessian[:, first, second] = hessian[:, second, first] = mixed
    finite = np.isfinite(hessian).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    gradient[~finite], hessian[~finite] = 0.0, -np.eye(count)
    unit = reach.T  # in units of the reach, the coordinates are comparable
    curvatures, directions = np.linalg.eigh(hessian * unit[:, :, None] * unit[:, None, :])
    sharpness = np.abs(curvatures)
    rise = np.einsum("nij,ni->nj", directions, gradient * unit)
    leap = rise / np.maximum(sharpness, FLATTEST * sharpness.max(axis=1, keepdims=True))
    shift = np.clip(np.einsum("nij,nj->ni", directions, leap) * unit, -unit, unit)
    gained = np.sum(gradient * shift, axis=1) + np.einsum("ni,nij,nj->n", shift, hessian, shift) / 2
    return found[:, 3**count // 2] + np.where(finite, gained, 0.0), shift.T


@cache
def _through_middle(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the nodes of a stencil on the lines through its middle along each coordinate, and on the planes through it
    along each pair of coordinates.

    Parameters
    ----------
    count : number d of coordinates

    Returns
    -------
    lines : indices of nodes, shape (d, 3)
    planes : indices of nodes, shape (d (d - 1)/2, 3, 3)
    """
    index, pairs = np.arange(3**count).reshape((3,) * count), combinations(range(count), 2)
    lines = np.array([np.moveaxis(index, i, -1)[(1,) * (count - 1)] for i in range(count)])
    planes = [np.moveaxis(index, pair, (-2, -1))[(1,) * (count - 2)] for pair in pairs]
    return lines, np.array(planes, np.intp).reshape(-1, 3, 3)
