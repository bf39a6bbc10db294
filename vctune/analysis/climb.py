"""Climb to the maxima of a function of several coordinates near given starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations, product
from math import inf

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.running import check_time

ROUNDS = 22  # Greatest number of stencils of a climb
LEAST_STEP = 1e-4  # Step at which a climb ends, relative to its first step
SHRINK = 8.0  # Greatest factor by which a leap reduces the steps
LEAP = 4.0  # Greatest length of a leap, in steps
TRIALS = 3  # Number of failed leaps after which a climb only moves and halves its steps
# Relative difference of values that a climb ignores when it examines a leap, because this difference is as small as the
# effect of `LEAST_STEP`
RESOLVED = 1e-8
FLATTEST = 1e-6  # Least curvature of a parabola in any direction, relative to its greatest curvature
CONSIDERED = 0.75  # Share of the greatest value below which a climb may end early


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
    """Climb from each start to a maximum near it."""
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
    """Return the place near the middle node at which the parabola through each stencil is greatest."""
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
    along each pair of coordinates."""
    index, pairs = np.arange(3**count).reshape((3,) * count), combinations(range(count), 2)
    lines = np.array([np.moveaxis(index, i, -1)[(1,) * (count - 1)] for i in range(count)])
    planes = [np.moveaxis(index, pair, (-2, -1))[(1,) * (count - 2)] for pair in pairs]
    return lines, np.array(planes, np.intp).reshape(-1, 3, 3)
