"""Find the scales 1/k_c of an impedance display's coupling with which an environment of a box has a pole on the
circle."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import NamedTuple

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import LoopsInHands
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.impedance_display import firmware_filter, offered_by_spring
from vctune.model.sampled.worlds.loop_in_worlds import Seen
from vctune.model.worlds import Worlds, WorldsMet

MOST = 1e100  # Number that replaces infinity in products


@np.errstate(all="ignore")
def least_of_force(
    met: WorldsMet, places: Iterable[LoopsInHands], device: Device, gains: Gains, time_constant: Floats, drags: Floats
) -> Floats:
    """Return the least scale 1/k_c above which no environment of a box forbids a scale, on a grid."""
    rows = []
    for held in places:
        seen = held.seen(Gains(gains.velocity[..., None, None], gains.position[..., None, None]))
        each = seen.lost / seen.size, seen.swing / seen.size
        rows.append((np.tile(held.theta, held.hands.mass.size), *(x.reshape(*seen.size.shape[:-2], -1) for x in each)))
    theta, lost, swing = (np.concatenate(parts, axis=-1) for parts in zip(*rows, strict=True))
    scale = np.empty((*lost.shape[:-1], time_constant.shape[-1], drags.shape[-1]))
    for k in range(time_constant.shape[-1]):
        tau = time_constant[..., k, None, None, None]
        last = forbidden_scale(met.worlds, device, theta, Seen(lost, swing, 1.0), tau)
        scale[..., k, :] = np.minimum(met.factor * last.max(axis=-1, initial=0.0), MOST)[..., None]
    return scale


@np.errstate(all="ignore")
def forbidden_scale(worlds: Worlds, device: Device, theta: Floats, seen: Seen, time_constant: float | Floats) -> Floats:
    """Return the greatest scale 1/k_c that an environment of a box forbids at each place; 0 if it forbids none."""
    T, sin, cos = device.sample_time, np.sin(theta / 2), np.cos(theta / 2)
    R, X = seen.lost / seen.size, seen.swing / seen.size
    inertia, compliance, low_pass = 2 / T * sin**2, T / 2 * cos**2, firmware_filter(device, theta, FLOATS)
    heavy = times(worlds.high.mass, inertia) - worlds.low.stiffness * compliance
    soft = worlds.low.mass * inertia - times(worlds.high.stiffness, compliance)
    at = offered_by_spring(SpringDamper(time_constant, 1.0), T, low_pass, theta, FLOATS)
    a, v = at.above / at.below, at.spring / at.below
    size = _Quadratic(sin**2 * a * a + v * v, -2 * (sin**2 * a * R + v * X), sin**2 * R * R + X * X)
    turned = _Quadratic(0 * v, cos * v, -cos * X)
    forbid = [_Quadratic(0 * a, -a, R).plus(-worlds.low.damping, size)]
    forbid += [turned.times(-1).plus(heavy, size)] if worlds.high.mass < inf else []
    forbid += [turned.plus(-soft, size)] if worlds.high.stiffness < inf else []
    last = np.zeros(np.broadcast_shapes(np.shape(R), np.shape(a)))
    for one in forbid:
        for zero in one.zeros():
            there = np.isfinite(zero) & (zero > 0)
            for other in forbid:
                there &= (other is one) | (other.at(zero) >= 0)
            last = np.fmax(last, np.where(there, zero, 0.0))
    return last


class _Quadratic(NamedTuple):
    """A quadratic of the scale, second x^2 + first x + constant, whose coefficients are arrays."""

    second: Floats
    first: Floats
    constant: Floats

    def times(self, factor: float | Floats) -> _Quadratic:
        """Return the quadratic times a number."""
        return _Quadratic(factor * self.second, factor * self.first, factor * self.constant)

    def plus(self, factor: float | Floats, other: _Quadratic) -> _Quadratic:
        """Return the sum of this quadratic and a multiple of another one."""
        return _Quadratic(*(x + factor * y for x, y in zip(self, other, strict=True)))

    def at(self, x: Floats) -> Floats:
        """Return the value of the quadratic."""
        return (self.second * x + self.first) * x + self.constant

    def zeros(self) -> tuple[Floats, Floats]:
        """Return both zeros; they are not finite if the quadratic has no real zero."""
        root = np.sqrt(self.first**2 - 4 * self.second * self.constant)
        middle = -(self.first + np.where(self.first < 0, -root, root)) / 2
        return middle / self.second, self.constant / middle


def times(limit: float, number: Floats) -> Floats:
    """Return a limit times a number >= 0; without a limit the product is infinite, even if the number is 0."""
    return limit * number if limit < inf else np.full_like(number, inf)
