"""Find the multiples of a wall at which an impedance display is unstable in hands, in double precision
(model/README.md, section 15).

With y times a wall of b_c and k_c, the characteristic number of the loop in a hand is P + y W, W = b_c V + k_c X. At
y = 0 the device is alone in the hand, which is passive, so that no pole is outside the unit circle. A pole crosses the
circle at z = e^(j theta) where L = W/P is real and negative, at y = -1/L: outwards if Im L rises through 0 with theta,
and inwards if it falls. The sum of these crossings from 0 up to y is the number of pairs of poles outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats, local_minima
from vctune.analysis.margins import roots
from vctune.analysis.worst_hand import Place
from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.hands import Hand, Hands, hands_as_one
from vctune.model.loop.filters import velocity_sections
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.plant_in_hand import delays_of, modes_in_hand, plant_in_hand
from vctune.running import check_time

Complex = NDArray[np.complex128]

FIRST_ANGLE = 1e-5  # rad
PER_DECADE, PER_TURN, TURNS = 24, 12, 6  # angles; those of a turn of a delay, and turns without one
# Angles beside a mode of the device in a hand, or a pole or zero of a filter: distances from it, in its half-width, and
# relative to its angle
IN_WIDTHS = np.array([0.25, 0.5, 1.0, 1.5, 2.5, 4.0, 7.0])
RELATIVE = np.array([1e-5, 1e-4, 1e-3, 3e-3, 0.01])
AT_ZERO = 1e-6  # Multiple of a wall below which a pole that is on the circle without a wall has crossed it at 0
# Masses, dampings and stiffnesses of hands that are compared, the decades of a range that begins at 0, the number of
# hands from which the search continues, its first step in the square roots of the shares of the ranges, and its rounds
HANDS, DECADES, STARTS, FIRST_STEP, ROUNDS = (4, 3, 10), 4.0, 3, 0.25, 14
CLOSE = np.linspace(-1.0, 1.0, 33)  # Angles beside the last crossing, in steps of the grid


class LoopsBeforeWall(NamedTuple):
    """P, V and X of an impedance display in some hands at some angles, each of shape (hands, n)."""

    angles: Floats  # theta, rad; a row for each hand, in ascending order
    open: Complex
    velocity: Complex
    position: Complex

    @classmethod
    def of(cls, device: Device, hands: Sequence[Hand], also: Floats | None = None) -> LoopsBeforeWall:
        """Return the loop at angles that show each mode of the device in each hand and each notch of its filters, and
        at others."""
        common = _angles(device) if also is None else np.union1d(_angles(device), also)
        modes = modes_in_hand(device, hands_as_one(hands, (-1, 1)), FLOATS)  # s T
        beside = _beside(np.abs(modes.imag), np.abs(modes.real))
        rows = np.concatenate((np.broadcast_to(common, (len(hands), common.size)), beside), axis=1)
        return cls.at(device, hands, np.sort(np.minimum(rows, pi), axis=1))

    @classmethod
    def at(cls, device: Device, hands: Sequence[Hand], angles: Floats) -> LoopsBeforeWall:
        """Return the loop at given angles, a row for each hand."""
        check_time()
        plant = plant_in_hand(device, hands_as_one(hands, (-1, 1)), delays_of(device), FLOATS)
        loop = loop_in_hand(plant, angles, FLOATS)
        assert isinstance(loop, ForceInHand)
        half = np.sin(angles / 2)
        numbers = [np.asarray(part.even + 1j * half * part.odd) for part in (loop.open, loop.velocity, loop.position)]
        return cls(angles, *(np.broadcast_to(number, angles.shape) for number in numbers))

    def wall(self, wall: SpringDamper) -> Complex:
        """Return W."""
        return wall.damping * self.velocity + wall.stiffness * self.position

    def limits(self, wall: SpringDamper) -> tuple[Floats, Floats]:
        """Return the least unstable multiple of a wall in each hand, and the angle at which a pole crosses there. It is
        that of the multiples above 1 if the wall itself is stable in every hand, else that of all."""
        multiples, angles = self.unstable_from(1.0, wall)
        return (multiples, angles) if multiples.min() > 1 else self.unstable_from(0.0, wall)

    @np.errstate(all="ignore")
    def unstable_from(self, first: float, wall: SpringDamper) -> tuple[Floats, Floats]:
        """Return the least unstable y >= first in each hand, inf where no y is, and the angle at which a pole
        crosses."""
        multiples, pairs, angles = self._crossings(wall)
        most = max(int(np.isfinite(multiples).sum(axis=1).max(initial=0)), 1)
        order = np.argsort(multiples, axis=1)[:, :most]
        multiples, pairs, angles = (np.take_along_axis(each, order, axis=1) for each in (multiples, pairs, angles))
        unstable = (np.cumsum(pairs, axis=1) > 0) & np.isfinite(multiples)  # from here to the next crossing
        ends = np.append(multiples[:, 1:], np.full((len(multiples), 1), np.inf), axis=1)
        unstable &= ends > first
        least = np.where(unstable, np.maximum(multiples, first), np.inf)
        place = np.argmin(least, axis=1)[:, None]
        return np.take_along_axis(least, place, axis=1)[:, 0], np.take_along_axis(angles, place, axis=1)[:, 0]

    def _crossings(self, wall: SpringDamper) -> tuple[Floats, Floats, Floats]:
        """Return the multiples at which poles cross the circle, inf between angles where none does; the number of pairs
        of poles that leave; and the angles. Rows are hands."""
        open_loop, closing = self.open, self.wall(wall)
        across = (closing * open_loop.conj()).imag  # |P|^2 Im L, which is regular
        to_nyquist = self.angles[:, -1] == pi
        across[:, -1] = np.where(to_nyquist, across[:, -2], across[:, -1])  # at pi P and W are real
        rises = (across[:, :-1] < 0) & (across[:, 1:] >= 0)
        falls = (across[:, :-1] >= 0) & (across[:, 1:] < 0)
        share = np.where(rises | falls, across[:, :-1] / (across[:, :-1] - across[:, 1:]), 0.0)
        P, W, angles = (
            each[:, :-1] + share * (each[:, 1:] - each[:, :-1]) for each in (open_loop, closing, self.angles)
        )
        multiples = -(P * W.conj()).real / (W * W.conj()).real
        # A pole that is on the circle without a wall crosses it at 0, which rounding misses
        multiples = np.where(rises & (np.abs(multiples) < AT_ZERO), 0.0, multiples)
        multiples = np.where(rises & (multiples >= 0) | falls & (multiples >= AT_ZERO), multiples, np.inf)
        pairs = np.where(rises, 1.0, -1.0)
        # Below the first angle: two poles at z = 1 that leave with any wall
        first = self.wall(wall)[:, 0] * open_loop[:, 0].conj()
        from_rest = (first.real < 0) & (first.imag > 0)
        # At pi a single pole crosses
        last = -(open_loop[:, -1] / closing[:, -1]).real
        last = np.where(to_nyquist & (last > 0), last, np.inf)
        return (
            np.column_stack((np.where(from_rest, 0.0, np.inf), multiples, last)),
            np.column_stack((np.ones(len(multiples)), pairs, np.where(across[:, -2] < 0, 0.5, -0.5))),
            np.column_stack((self.angles[:, 0], angles, self.angles[:, -1])),
        )


def _angles(device: Device) -> Floats:
    """Return angles for every hand: logarithmic ones, those of the turns of a delay, and those of filters."""
    logarithmic = np.geomspace(FIRST_ANGLE, pi, int(PER_DECADE * np.log10(pi / FIRST_ANGLE)))
    turns = TURNS + device.latency / device.sample_time
    of_delay = np.linspace(0.0, pi, int(PER_TURN * turns) + 1)[1:]
    filters = [_beside(np.abs(np.angle(z)), np.abs(np.log(np.abs(z)))) for z in _poles_and_zeros(device)]
    return np.unique(np.minimum(np.concatenate((logarithmic, of_delay, *filters)), pi))


def _poles_and_zeros(device: Device) -> list[Complex]:
    """Return the poles and the zeros of each section of the velocity's filter, other than 0."""
    found = list[Complex]()
    for section in velocity_sections(device, FLOATS):
        zeros = np.roots([section.now, section.before, section.earlier])
        poles = np.roots([1.0, section.rest - 1.0 - section.again, section.again])
        found += [each[each != 0].astype(complex) for each in (zeros, poles)]
    return found


def _beside(angles: Floats, widths: Floats) -> Floats:
    """Return angles, and those beside them, of shape (..., n); angles above Nyquist are those that they pass for."""
    turned = np.abs((angles + pi) % (2 * pi) - pi)[..., None]
    distances = np.concatenate((widths[..., None] * IN_WIDTHS, turned * RELATIVE), axis=-1)
    near = np.concatenate((turned, turned - distances, turned + distances), axis=-1)
    return np.clip(near.reshape(*near.shape[:-2], -1), FIRST_ANGLE, pi)


def worst_before_wall(device: Device, wall: SpringDamper, hands: Hands) -> Place:
    """Return the least unstable multiple of a wall in the hands of a box: of those above 1 if the wall itself is
    stable, else of all."""
    above = _worst(device, wall, hands, 1.0)
    return above if above.value > 1 else _worst(device, wall, hands, 0.0)


def _worst(device: Device, wall: SpringDamper, hands: Hands, first: float) -> Place:
    """Return the least unstable multiple from `first` on.

    Hands are compared on a grid, and around the worst of them in steps along each parameter, which halve where no hand
    is worse. Steps are in the square roots of the shares of the ranges, because soft springs lie close.
    """
    low, high = (np.array([*end.numbers.values()], float) for end in (hands.low, hands.high))
    width = high - low
    grid = np.array([*product(*map(_shares, low, high, HANDS))])

    def limits(roots: Floats) -> tuple[Floats, Floats]:
        hands = [Hand(*map(float, numbers)) for numbers in low + width * roots**2]
        return LoopsBeforeWall.of(device, hands).unstable_from(first, wall)

    multiples, angles = limits(grid)
    starts = np.argsort(multiples)[:STARTS]
    place, multiple, angle = grid[starts], multiples[starts], angles[starts]
    step = np.full((len(starts), 1, 1), FIRST_STEP)
    moves = np.array([side * along for along in np.eye(3)[width > 0] for side in (-1.0, 1.0)])
    for _ in range(ROUNDS if len(moves) else 0):
        tried = np.clip(place[:, None] + step * moves, 0.0, 1.0)
        multiples, angles = (each.reshape(len(starts), -1) for each in limits(tried.reshape(-1, 3)))
        best = np.argmin(multiples, axis=1)
        rows = np.arange(len(starts))
        better = multiples[rows, best] < multiple
        place = np.where(better[:, None], tried[rows, best], place)
        multiple = np.where(better, multiples[rows, best], multiple)
        angle = np.where(better, angles[rows, best], angle)
        step = np.where(better[:, None, None], step, step / 2)
    worst = int(np.argmin(multiple))
    hand = Hand(*map(float, low + width * place[worst] ** 2))
    return _closer(device, wall, Place(float(multiple[worst]), float(angle[worst]), hand), first)


def _shares(low: float, high: float, count: int) -> Floats:
    """Return square roots of shares of a range: its ends, and values between them that are spaced by logarithm."""
    if low == high:
        return np.zeros(1)
    first = max(low, high * 10**-DECADES)
    values = np.unique(np.append(low, np.geomspace(first, high, count)))
    return np.asarray(np.sqrt((values - low) / (high - low)))


def _closer(device: Device, wall: SpringDamper, place: Place, first: float) -> Place:
    """Return a place with its multiple at angles close to the crossing, between which P and W are nearly lines."""
    if not first < place.value < np.inf:
        return place
    loop = LoopsBeforeWall.of(device, [place.hand])
    width = np.diff(loop.angles[0])[min(int(np.searchsorted(loop.angles[0], place.theta)), loop.angles.shape[1] - 2)]
    close = np.union1d(loop.angles[0], np.clip(place.theta + width * CLOSE, FIRST_ANGLE, pi))
    multiples, angles = LoopsBeforeWall.at(device, [place.hand], close[None]).unstable_from(first, wall)
    return Place(float(multiples[0]), float(angles[0]), place.hand)


@dataclass(frozen=True, slots=True)
class LoopOfWall:
    """The loop that a wall closes in one hand, L = W/P."""

    peak: float  # greatest |S| = 1/|1 + L|
    omega: float  # where, rad/s
    phase: float  # least phase shift of L, rad, to instability; inf where |L| < 1


@np.errstate(all="ignore")
def loop_of_wall(device: Device, wall: SpringDamper, hand: Hand) -> LoopOfWall:
    """Return the peak of |S| and the phase margin of the loop that a wall closes."""

    def gain(theta: Floats) -> Complex:
        loop = LoopsBeforeWall.at(device, [hand], theta.reshape(1, -1))
        return np.asarray(loop.wall(wall) / loop.open).reshape(theta.shape)

    grid = LoopsBeforeWall.of(device, [hand]).angles[0]
    quiet = local_minima(lambda theta: np.abs(1 + gain(theta)), np.unique(grid))
    crossing = gain(roots(lambda theta: np.log(np.abs(gain(theta))), np.unique(grid)))
    phase = float(np.abs(np.pi - np.abs(np.angle(crossing))).min(initial=np.inf))
    return LoopOfWall(1 / float(quiet.value[0]), float(quiet.omega[0]) / device.sample_time, phase)
