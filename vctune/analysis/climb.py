"""Climb to the maxima of a function of several coordinates near given starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.running import check_time

ROUNDS = 22  # Greatest number of stencils of a climb
LEAST_STEP = 1e-4  # Step at which a climb ends, relative to its first step
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
) -> tuple[Floats, Floats]:
    """Climb from each start to a maximum near it: move to the best of the neighbours, or halve the steps.

    The steps of a group of coordinates stay as they are while one of them moves. The climbs of one owner compete.
    """
    count, climbs = starts.shape
    stencil, every = np.array([*product(range(3), repeat=count)]).T, np.arange(climbs)
    middle, least = stencil.shape[1] // 2, LEAST_STEP * steps[:, None]
    kin, owned = np.equal.outer(groups, groups), [np.equal(owners, owner) for owner in sorted({*owners})]
    going, place, step = np.full(climbs, True), starts, np.repeat(steps[:, None], climbs, axis=1)
    best = np.full(climbs, -inf)
    for _ in range(ROUNDS):
        check_time()
        nodes = np.clip(place[..., None] + np.array([-1, 0, 1]) * step[..., None], low[..., None], high[..., None])
        found = np.nan_to_num(values(nodes), nan=-inf, posinf=inf)  # 0/0 is not a value
        at = np.where(found[:, middle] >= found.max(axis=1), middle, np.argmax(found, axis=1))
        there = np.where(going, np.take_along_axis(nodes, stencil[:, at, None], axis=2)[..., 0], place)
        step = np.where(kin @ (there != place), step, step / 2)
        best, place = np.where(going, np.maximum(best, found[every, at]), best), there
        for own in owned:
            top = min(float(best[own].max()), enough)
            awaited = own & (best >= (top * CONSIDERED if top > 0 else top / CONSIDERED))
            going[own] &= not np.all(step[:, awaited] < least)
        if not going.any():
            break
    return best, place
