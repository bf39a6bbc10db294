"""Estimate the least scale of a coupling with which no environment of a box puts a pole on the unit circle."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import LoopsInHands
from vctune.design.search.samples import Samples
from vctune.design.search.shapes import unit_at
from vctune.model.gains import Gains
from vctune.model.worlds import WorldsMet

MOST = 1e100  # Number that replaces infinity in products
LEAPS = 2  # Number of passes over the forbidden intervals


@np.errstate(divide="ignore", invalid="ignore")
def least_scale_in_worlds(
    met: WorldsMet, samples: Samples, gains: Gains, time_constant: Floats, drags: Floats
) -> Floats:
    """Return an estimate of the least b_c that no environment of a box forbids."""
    rows = [_forbidding(met, samples.device.sample_time, there, gains) for there in _places(samples)]
    theta, missing, stiff, soft = (np.concatenate(parts, axis=-1) for parts in zip(*rows, strict=True))
    asked = (missing > 0).any(axis=tuple(range(missing.ndim - 1)))
    theta, missing, stiff, soft = theta[asked], missing[..., asked], stiff[..., asked], soft[..., asked]
    scale = np.empty((*missing.shape[:-1], time_constant.shape[-1], drags.shape[-1]))
    for i in range(time_constant.shape[-1]):
        tau = time_constant[..., i, None, None, None]
        resistance, reactance = unit_at(samples.device, theta, tau)
        first, last = stiff / reactance, soft / reactance
        for k in range(drags.shape[-1]):
            drag = drags[..., k, None, None, None]
            enough = np.minimum(np.where(missing > drag, (missing - drag) / resistance, 0.0), last)
            left = np.zeros(missing.shape[:-1])
            for _ in range(LEAPS):
                left = np.fmax(left, np.where(first <= left[..., None], enough, 0.0).max(axis=-1, initial=0.0))
            scale[..., i, k] = np.minimum(left, MOST)
    return scale


def _times(limit: float, number: Floats) -> Floats:
    """Return a limit times a number >= 0; without a limit the product is infinite, even if the number is 0."""
    return limit * number if limit < inf else np.full_like(number, inf)


def _places(samples: Samples) -> Iterator[LoopsInHands]:
    for there in samples.everywhere:
        yield from (held for held in there.in_hand if isinstance(held, LoopsInHands))


def _forbidding(
    met: WorldsMet, sample_time: float, held: LoopsInHands, gains: Gains
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return angles, and the limits of the forbidden region at each angle."""
    worlds, factor, half = met.worlds, met.factor, held.theta / 2
    inertia, compliance = 2 / sample_time * np.sin(half) ** 2, sample_time / 2 * np.cos(half) ** 2
    seen = held.seen(Gains(gains.velocity[..., None, None], gains.position[..., None, None]))
    swing, R = seen.swing * np.cos(half) / seen.size, seen.lost / seen.size
    stiff = swing - _times(worlds.high.mass, inertia) + worlds.low.stiffness * compliance
    soft = factor * (swing - worlds.low.mass * inertia + _times(worlds.high.stiffness, compliance))
    missing = factor * (R - worlds.low.damping)
    each = ((missing, 0.0), (stiff, -MOST), (soft, MOST))
    known = (np.nan_to_num(number, nan=unknown, posinf=MOST, neginf=-MOST) for number, unknown in each)
    found = (number.reshape(*number.shape[:-2], -1) for number in known)
    return np.tile(held.theta, held.hands.mass.size), *found
