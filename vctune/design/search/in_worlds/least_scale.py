"""Estimate the least scale of a coupling with which no environment of a box puts a pole on the unit circle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import LoopsInHands
from vctune.design.search.in_worlds.force_scale import MOST, least_of_force, times
from vctune.design.search.samples import Samples
from vctune.design.search.shapes import unit_at
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.worlds.late_sides import open_sides
from vctune.model.sampled.worlds.loop_in_late_worlds import HalfPlane
from vctune.model.sampled.worlds.loop_in_worlds import Offered, Seen, offered_at, sum_of
from vctune.model.worlds import WorldsMet

LEAPS = 2  # Number of passes over the forbidden intervals


def least_scale_in_worlds(
    met: WorldsMet, samples: Samples, gains: Gains, time_constant: Floats, drag: Floats
) -> Floats:
    """Return an estimate of the least scale, b_c or 1/k_c, that no environment of a box forbids."""
    if samples.device.kind.inverse:
        return least_of_force(met, _places(samples), samples.device, gains, time_constant, drag)
    if met.worlds.lossless:
        return _least_of_lossless(met, samples, gains, time_constant, drag)
    return _least_in_time(met, samples, gains, time_constant, drag)


@np.errstate(divide="ignore", invalid="ignore")
def _least_of_lossless(met: WorldsMet, samples: Samples, gains: Gains, time_constant: Floats, drags: Floats) -> Floats:
    """Return the least b_c that no environment of a box forbids. The environments run on time by the trapezoidal
    rule."""
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


@np.errstate(divide="ignore", invalid="ignore")
def _least_in_time(met: WorldsMet, samples: Samples, gains: Gains, time_constant: Floats, drags: Floats) -> Floats:
    """Return the least b_c that no environment of a box forbids. The environments run late or by Euler's rules."""
    met = replace(met, worlds=replace(met.worlds, resistive=not met.worlds.ahead))
    T, each = samples.device.sample_time, Gains(gains.velocity[..., None, None], gains.position[..., None, None])
    theta, alone, planes = _asked(met, samples, each)
    scale = np.zeros((*alone[0].shape[:-1], time_constant.shape[-1], drags.shape[-1]))
    for i in range(time_constant.shape[-1]):
        tau = time_constant[..., i, None, None, None]
        unit = offered_at(Coupling(inf, 1.0, 0.0) if np.all(tau == 0) else Coupling(1.0, tau, 0.0), T, theta, FLOATS)
        slopes = [p.resistance * unit.resistance + p.reactance * unit.reactance for p in planes]
        for k in range(drags.shape[-1]):
            drag, first, last = drags[..., k, None, None, None], np.zeros(alone[0].shape), np.full(alone[0].shape, MOST)
            for margin, slope, plane in zip(alone, slopes, planes, strict=True):
                back = np.where(slope == 0, -MOST, -1 / slope)
                moved = drag * plane.resistance * back
                if (slope < 0).any():
                    first = np.fmax(first, margin * np.where(slope < 0, back, 0.0) + np.where(slope < 0, moved, 0.0))
                last = np.fmin(last, margin * np.where(slope < 0, 0.0, back) + np.where(slope < 0, MOST, moved))
            left, beyond = np.zeros(scale.shape[:-2]), np.where(first < last, np.minimum(met.factor * last, MOST), 0.0)
            for _ in range(LEAPS):
                left = np.fmax(left, np.where(first <= left[..., None], beyond, 0.0).max(axis=-1, initial=0.0))
            scale[..., i, k] = left
    return scale


def _asked(met: WorldsMet, samples: Samples, each: Gains) -> tuple[Floats, list[Floats], list[HalfPlane]]:
    """Return the angles at which the loop needs a coupling, and the margins there without a coupling."""
    found = []
    for there in _places(samples):
        theta, seen = np.tile(there.theta, there.hands.mass.size), there.seen(each)
        planes = open_sides(met.worlds, samples.device.sample_time, theta)
        planes = planes[:1] if met.worlds.resistive else planes
        own = Seen(*((x / seen.size).reshape(*seen.size.shape[:-2], -1) for x in seen))
        found.append((theta, [sum_of(plane.terms(Offered(0.0, 0.0), own)) for plane in planes], planes))
    thetas, margins, sides = zip(*found, strict=True)
    theta, alone = np.concatenate(thetas), [np.concatenate(parts, axis=-1) for parts in zip(*margins, strict=True)]
    planes = [HalfPlane(*map(np.concatenate, zip(*parts, strict=True))) for parts in zip(*sides, strict=True)]
    asked = (alone[0] <= 0).any(axis=tuple(range(alone[0].ndim - 1)))
    return theta[asked], [x[..., asked] for x in alone], [HalfPlane(*(x[asked] for x in p)) for p in planes]


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
    stiff = swing - times(worlds.high.mass, inertia) + worlds.low.stiffness * compliance
    soft = factor * (swing - worlds.low.mass * inertia + times(worlds.high.stiffness, compliance))
    missing = factor * (R - worlds.low.damping)
    each = ((missing, 0.0), (stiff, -MOST), (soft, MOST))
    known = (np.nan_to_num(number, nan=unknown, posinf=MOST, neginf=-MOST) for number, unknown in each)
    found = (number.reshape(*number.shape[:-2], -1) for number in known)
    return np.tile(held.theta, held.hands.mass.size), *found
