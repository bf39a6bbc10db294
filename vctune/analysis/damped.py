"""Find how far a coupling is from a damping ratio that is demanded, in double precision (model/README.md, section 21).

In one hand with one environment, a pole lies on the curve of the ratio at an angle where the multiple of the coupling
that puts it there is real.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from itertools import product
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.analysis.multiples import angles_of
from vctune.model.device import Device
from vctune.model.gains import Coupling, SpringDamper, stepped
from vctune.model.hands import NAMES, Hand, Hands, hands_as_one
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.complexes import Complex, as_one
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.damped import ray
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.servo_in_hand import seen_apart
from vctune.model.sampled.servo_plant import sensed_delay, servo_plant
from vctune.model.worlds import World, Worlds

Complexes = NDArray[np.complex128]
APART = 1e-9  # Relative distance from which two multiples are apart
BESIDE_WALL = 1e-3  # Share of a wall within which no multiple of it may have a pole on the curve


def _plain(number: Complex) -> Complexes:
    return np.asarray(number.re) + 1j * np.asarray(number.im)


class _Curve(NamedTuple):
    """The impedances that meet a servo's coupling on the curve of a damping ratio, by what has them, N s/m."""

    w: Complexes  # 1/z, shape (n,)
    fixed: Complexes  # what pulls the servo itself, shape (n,)
    hands: Complexes  # of a hand, for each unit of its parameters, shape (3, n)
    worlds: Complexes  # of an environment, for each unit of mass, damping and stiffness, shape (3, n)


def _curve(device: Device, ratio: float, angles: Floats) -> _Curve:
    along, ops, T = np.union1d(angles, pi), ray(ratio, FLOATS), device.sample_time
    plant, theta = servo_plant(device, sensed_delay(device), FLOATS), ray(ratio, FLOATS).angle(along)
    w = np.exp(-1j * _plain(theta))

    def seen(plant: Any, hand: Hand) -> Complexes:
        regular, spring = (_plain(as_one(part)) for part in seen_apart(plant, hand, theta, ops))
        return regular + spring / (1 - w)

    hands = np.stack([seen(plant, Hand(**{each: float(each == name) for each in NAMES})) for name in NAMES])
    pull = plant.pull
    fixed = np.zeros_like(w) if pull is None else seen(pull.plant, Hand(0.0, 0.0, float(pull.stiffness)))
    s = 2 / T * (1 - w) / (1 + w)
    return _Curve(w, np.broadcast_to(fixed, w.shape), hands, np.stack([s, np.ones_like(w), 1 / s]))


def _offered(device: Device, coupling: Coupling, w: Complexes) -> Complexes:
    jump, decay = stepped(coupling, device.sample_time, device.rule)
    return np.asarray(coupling.drag + jump * (1 - w) / (1 - decay * w))


@dataclass(frozen=True, slots=True)
class BoxOnCurve:
    """What a coupling meets on the curve: of a servo in every hand with every environment of two boxes."""

    device: Device
    w: Complexes  # 1/z, shape (n,)
    low: Complexes  # at the least value of each parameter, N s/m, shape (n,)
    spans: Complexes  # by which it changes up to the greatest value of each that has a range, shape (ranges, n)
    heavy: bool  # whether a mass is behind

    @classmethod
    def of(cls, device: Device, hands: Hands, worlds: Worlds, ratio: float, angles: Floats) -> BoxOnCurve:
        """Return the impedances at angles of the curve of a damping ratio, and at pi."""
        curve = _curve(device, ratio, angles)
        low, high = (np.array([getattr(end, name) for name in NAMES]) for end in (hands.low, hands.high))
        low, high = np.append(low, astuple(worlds.low)), np.append(high, astuple(worlds.high))
        high[len(NAMES) + 1] = low[len(NAMES) + 1]  # a damper of the environment only damps
        units, wide = np.concatenate([curve.hands, curve.worlds]), high > low
        spans = (high - low)[wide, None] * units[wide]
        return cls(device, curve.w, curve.fixed + low @ units, spans, worlds.low.mass > 0)

    @np.errstate(all="ignore")
    def room(self, coupling: Coupling) -> tuple[float, float]:
        """Return two multiples of a coupling between which no pole is outside the curve; inf and 0 without any.

        At each angle the multiples that put a pole there, in some hand with some environment, are an interval. Between
        two such intervals the number of poles outside is that of the middle of the boxes. For a great multiple none is,
        but the one at z = -1 of a mass by the trapezoidal rule, unless the coupling is such a mass itself.
        """
        offered = _offered(self.device, coupling, self.w)
        least, greatest = _real_ranges(-self.low / offered, -self.spans / offered)
        some = greatest > 0
        least, greatest = least[some], greatest[some]
        order = np.argsort(least)
        starts = np.append(least[order], inf)
        ends = np.append(0.0, np.maximum.accumulate(greatest[order]))
        middle = -(self.low + 0.5 * self.spans.sum(axis=0)) / offered
        at, change = _crossed(middle)
        rigid = coupling.rigid and self.device.rule == "trapezoid"
        for k in np.flatnonzero(starts > ends * (1 + APART))[::-1]:
            outside = int(self.heavy and not rigid) - change[at > 0.5 * (ends[k] + min(starts[k], 1e300))].sum()
            if outside == 0:
                return float(ends[k]), float(starts[k])
        return inf, 0.0


def _real_ranges(first: Complexes, spans: Complexes) -> tuple[Floats, Floats]:
    """Return the ends of the real numbers among first + sum of t spans, 0 <= t <= 1, at each angle, joined to those at
    the next; and those at which a corner becomes real between two angles, where their ends have kinks."""
    low, high = (first.imag + of(spans.imag, 0.0).sum(axis=0) for of in (np.minimum, np.maximum))
    side = np.where(low > 0, 1, np.where(high < 0, -1, 0))
    side[-1] = side[-2]  # at the last angle, pi, all are real
    real = np.flatnonzero(side[:-1] == 0)
    own, re, im = first[real], spans.real[:, real], spans.imag[:, real]
    # with one of these as the multiplier of the imaginary part, the greatest and the least of the real part are found
    slopes = re / np.where(im == 0, np.nan, im)
    part, gain = own.real - slopes * own.imag, re - slopes[:, None] * im
    greatest, least = np.full((2, first.size), np.nan)
    greatest[real] = np.nanmin(part + np.maximum(gain, 0.0).sum(axis=1), axis=0, initial=inf)
    least[real] = np.nanmax(part + np.minimum(gain, 0.0).sum(axis=1), axis=0, initial=-inf)
    greatest[-1], least[-1] = (first.real[-1] + of(spans.real[:, -1], 0.0).sum() for of in (np.maximum, np.minimum))
    known = np.isfinite(greatest)
    joined = known[:-1] & known[1:] & (np.arange(1, first.size) < first.size - 1)
    corners = np.array(list(product((0.0, 1.0), repeat=len(spans))))
    height = corners @ spans.imag + first.imag
    corner, at = np.nonzero(height[:, :-1] * height[:, 1:] < 0)
    ends = [first[k] + (corners[corner] * spans.T[k]).sum(axis=1) for k in (at, at + 1)]
    passed = _crossings(np.stack(ends, axis=1))
    passed = passed[passed > -inf]
    return (
        np.concatenate([least[known], np.minimum(least[:-1], least[1:])[joined], passed]),
        np.concatenate([greatest[known], np.maximum(greatest[:-1], greatest[1:])[joined], passed]),
    )


def _crossed(multiples: Complexes) -> tuple[Floats, Floats]:
    """Return the real numbers on a curve and by how much each changes the number of poles outside as a multiple passes
    it: the outside is to the right of the curve, and its image to the right of that of the curve."""
    at = _crossings(multiples[None])[0]
    rises = np.where(multiples.imag[:-1] < 0, 2.0, -2.0)
    found = at > -inf
    last = 1.0 if multiples.imag[-2] < 0 else -1.0
    return np.append(at[found], multiples.real[-1]), np.append(rises[found], last)


@dataclass(frozen=True, slots=True)
class ServoOnCurve:
    """The impedance that a coupling meets on the curve: of a servo in some hands, with some environments."""

    device: Device
    w: Complexes  # 1/z, shape (n,)
    met: Complexes  # N s/m, shape (cases, n)

    @classmethod
    def of(
        cls, device: Device, hands: Sequence[Hand], worlds: Sequence[World], ratio: float, also: Floats
    ) -> ServoOnCurve:
        """Return the impedances for the curve of a damping ratio, also at some angles."""
        curve = _curve(device, ratio, np.union1d(angles_of(device), also))
        of_hands = np.array([[getattr(hand, name) for name in NAMES] for hand in hands]) @ curve.hands + curve.fixed
        behind = [np.array(astuple(world)) @ curve.worlds for world in worlds]
        return cls(device, curve.w, np.concatenate([of_hands + each for each in behind]))

    @np.errstate(all="ignore")
    def limits(self, coupling: Coupling) -> list[float]:
        """Return in each case, the hands with the first environment and then with the second, the greatest multiple
        with a pole on the curve, and 0 without any."""
        multiples = -self.met / _offered(self.device, coupling, self.w)
        last = np.where(np.isfinite(multiples[:, -1]), multiples[:, -1].real, 0.0)
        return np.maximum(np.maximum(_crossings(multiples).max(axis=1), last), 0.0).tolist()


def _crossings(multiples: Complexes) -> Floats:
    """Return the values at which complex numbers are real between two adjacent angles; -inf where they are not."""
    one, other = multiples[:, :-1], multiples[:, 1:]
    crosses = one.imag * other.imag < 0
    share = np.where(crosses, one.imag / np.where(crosses, one.imag - other.imag, 1.0), 0.0)
    between = one.real + share * (other.real - one.real)
    return np.where(crosses & np.isfinite(between), between, -inf)


@dataclass(frozen=True, slots=True)
class WallOnCurve:
    """The loop of an impedance display in some hands on the curve, F = free + share (b_c damper + k_c spring)."""

    free: Complexes  # shape (hands, n); polynomials in 1/z
    damper: Complexes
    spring: Complexes

    @classmethod
    def of(cls, device: Device, hands: Sequence[Hand], ratio: float, also: Floats) -> WallOnCurve:
        """Return the loop for the curve of a damping ratio, also at some angles."""
        ops, along = ray(ratio, FLOATS), np.union1d(angles_of(device), also)
        theta = ops.angle(along)
        plant = plant_in_hand(device, hands_as_one(hands, (-1, 1)), delays_of(device), FLOATS)
        loop, half = loop_in_hand(plant, theta, ops), ops.sin(theta / 2)
        assert isinstance(loop, ForceInHand)
        back = np.exp(-0.5j * plant.poles * _plain(theta))

        def number(part: Any) -> Complexes:
            value = _plain(as_one(Pair(part.even, half * part.odd))) * back
            return np.broadcast_to(value, (len(hands), along.size))

        return cls(number(loop.open), number(loop.velocity), number(loop.position))

    @np.errstate(all="ignore")
    def bears(self, wall: SpringDamper) -> bool:
        """Return whether no pole is outside the curve in these hands, nor on it with about this wall."""
        spring = wall.damping * self.damper + wall.stiffness * self.spring
        loop = self.free + spring
        turned = np.angle(loop[:, 1:] / loop[:, :-1]).sum(axis=1) + np.angle(loop[:, 0])
        multiples = -self.free / spring
        on_curve = np.append(_crossings(multiples), multiples[:, -1].real)  # at the last angle, pi, all are real
        beside = np.nanmin(np.abs(on_curve - 1), initial=inf)
        return bool(np.all(np.abs(turned) < pi / 2) and beside > BESIDE_WALL)
