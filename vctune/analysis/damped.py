"""Find how far a coupling is from a damping ratio that is demanded, in double precision (model/README.md, section 21).

In one hand with one environment, a pole lies on the curve of the ratio at an angle where the multiple of the coupling
that puts it there is real.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.analysis.multiples import angles_of
from vctune.model.device import Device
from vctune.model.gains import Coupling, SpringDamper, stepped
from vctune.model.hands import NAMES, Hand, hands_as_one
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.complexes import Complex, as_one
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.damped import ray
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.servo_in_hand import seen_apart
from vctune.model.sampled.servo_plant import sensed_delay, servo_plant
from vctune.model.worlds import World

Complexes = NDArray[np.complex128]
BESIDE_WALL = 1e-3  # Share of a wall within which no multiple of it may have a pole on the curve


def _plain(number: Complex) -> Complexes:
    return np.asarray(number.re) + 1j * np.asarray(number.im)


@dataclass(frozen=True, slots=True)
class ServoOnCurve:
    """The impedance that a coupling meets on the curve: of a servo in some hands, with some environments."""

    device: Device
    w: Complexes  # 1/z, shape (n,)
    met: Complexes  # N s/m, shape (cases, n)
    heavy: NDArray[np.bool_]  # whether a mass is behind, shape (cases,)

    @classmethod
    def of(
        cls, device: Device, hands: Sequence[Hand], worlds: Sequence[World], ratio: float, also: Floats
    ) -> ServoOnCurve:
        """Return the impedances for the curve of a damping ratio, also at some angles."""
        along, ops, T = np.union1d(angles_of(device), also), ray(ratio, FLOATS), device.sample_time
        plant, theta = servo_plant(device, sensed_delay(device), FLOATS), ray(ratio, FLOATS).angle(along)
        w = np.exp(-1j * _plain(theta))

        def seen(plant: Any, hand: Hand) -> Complexes:
            regular, spring = (_plain(as_one(part)) for part in seen_apart(plant, hand, theta, ops))
            return regular + spring / (1 - w)

        units = np.stack([seen(plant, Hand(**{each: float(each == name) for each in NAMES})) for name in NAMES])
        of_hands = np.array([[getattr(hand, name) for name in NAMES] for hand in hands]) @ units
        if plant.pull is not None:
            of_hands = of_hands + seen(plant.pull.plant, Hand(0.0, 0.0, float(plant.pull.stiffness)))
        s = 2 / T * (1 - w) / (1 + w)
        behind = [world.mass * s + world.damping + world.stiffness / s for world in worlds]
        met = np.concatenate([of_hands + np.broadcast_to(each, w.shape) for each in behind])
        return cls(device, w, met, np.repeat([world.mass > 0 for world in worlds], len(hands)))

    @np.errstate(all="ignore")
    def room(self, coupling: Coupling) -> tuple[Floats, Floats]:
        """Return in each case, the hands with the first environment and then with the second, the least and the
        greatest multiple of a coupling between which no pole is outside the curve.

        A mass by the trapezoidal rule has a pole at z = -1, to which a pole goes as the coupling grows, unless the
        coupling is such a mass itself.
        """
        jump, decay = stepped(coupling, self.device.sample_time, self.device.rule)
        multiples = -self.met / (coupling.drag + jump * (1 - self.w) / (1 - decay * self.w))
        last, rigid = multiples[:, -1].real, coupling.rigid and self.device.rule == "trapezoid"
        bounded = self.heavy & (not rigid)
        least = np.where(bounded | ~np.isfinite(last), 0.0, last)
        least = np.maximum(least, _crossings(multiples).max(axis=1))
        return np.maximum(least, 0.0), np.where(bounded, np.maximum(last, 0.0), inf)


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
