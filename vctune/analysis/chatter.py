"""Bound what the steps of an encoder and of a force sensor make a device do at rest (model/README.md, section 20).

An error of a reading is at most half a step. What it causes is at most half a step times the sum of the absolute
impulse response, whatever the friction. The sums are computed in double precision, not proved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Literal, NamedTuple

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.responses import Loop
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand, hands_as_one
from vctune.model.loop.filters import force_sections
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import EvenOdd
from vctune.model.problem import Problem
from vctune.model.rest import damping_acting, read_in_steps, stiffness_read
from vctune.model.sampled.hand_loop import CommandInHand, LoopInHand, loop_in_hand, quotient
from vctune.model.sampled.impedance_display import ForceInHand, firmware_filter
from vctune.model.sampled.loop_in_worlds import offered_at
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import World
from vctune.running import check_time

FEWEST, MOST = 2**11, 2**19  # Least and greatest number of samples of an impulse response
FOREBODING = 2**15  # Number of samples that tell whether a response dies away within `MOST`
SETTLED = 1e-3  # Share of the sum in the second half of the samples at which the rest is a geometric tail


Reading = Literal["encoder", "force sensor"]


class Caused(NamedTuple):
    """What the steps of a reading cause, at most; inf if it has no bound."""

    motion: float  # half of what the handle moves, m; of a force sensor half of what its velocity varies, m/s
    force: float  # half of what the motor's force varies, N; 0 on a servo
    hand: Hand  # the hand in which the motion is greatest


def caused_by(
    reading: Reading,
    device: Device,
    hands: Sequence[Hand],
    gains: Gains,
    coupling: AnyCoupling,
    worlds: Sequence[World],
) -> Caused:
    """Return what the steps of a reading, which the device must state, cause in some hands before some environments."""
    step = read_in_steps(device) if reading == "encoder" else device.sensing.resolution
    assert step is not None
    plant = plant_in_hand(device, hands_as_one(hands, (-1, 1)), delays_of(device), FLOATS)

    def sums(world: World) -> Floats:
        def answers(theta: Floats) -> list[Any]:
            at = _Answers(device, gains, coupling, world, loop_in_hand(plant, theta, FLOATS), theta)
            return [*(at.of_position() if reading == "encoder" else at.of_force())]

        return absolute_sums(answers, len(hands))

    motion, force = 0.5 * step * np.max([sums(world) for world in worlds], axis=0)
    return Caused(float(motion.max()), float(force.max()), hands[int(np.argmax(motion))])


@np.errstate(all="ignore")
def absolute_sums(answers: Callable[[Floats], list[Any]], count: int) -> Floats:
    """Return the sums of |impulse response| of stable frequency responses, each of shape (count, angles) or such that
    it can be broadcast to it; inf where a response does not die away within `MOST` samples."""
    sums, samples = np.zeros(0), FEWEST
    while samples <= MOST:
        check_time()
        theta = np.asarray((np.arange(samples // 2) + 0.5) * (2 * np.pi / samples), float)
        each = np.array([np.broadcast_to(answer, (count, len(theta))) for answer in answers(theta)])
        # at half-odd multiples of 2 pi/N no response has a pole, and what follows after N samples has the other sign
        padded = np.concatenate((each, np.zeros_like(each)), axis=-1)
        turned = np.exp(1j * np.pi / samples * np.arange(samples))
        h = np.abs(2 * np.real(np.fft.ifft(padded, axis=-1) * turned))
        early, late = h[..., : samples // 2].sum(axis=-1), h[..., samples // 2 :].sum(axis=-1)
        left = np.divide(late, early, out=np.zeros_like(late), where=early > 0)
        sums = np.where(left <= SETTLED, early + late / (1 - left), inf)
        if np.isfinite(sums).all() or (samples >= FOREBODING and np.max(left ** (MOST / samples)) > SETTLED):
            break
        samples *= 4
    return sums


class _Answers(NamedTuple):
    """The loop of firmware, device and hand before an environment at angles theta."""

    device: Device
    gains: Gains
    coupling: AnyCoupling
    world: World
    loop: LoopInHand | ForceInHand | CommandInHand
    theta: Floats

    def _complex(self, number: EvenOdd) -> Any:
        return number.even + 1j * np.sin(self.theta / 2) * number.odd

    @property
    def _back(self) -> Any:
        return 1 - np.exp(-1j * self.theta)

    @property
    def _read(self) -> Any:
        """The motor's force, with the opposite sign, per read position."""
        passed = firmware_filter(self.device, self.theta, FLOATS)
        low_pass = 1.0 if passed is None else passed.re + 1j * passed.im
        damping, stiffness = self._acting
        difference = self._back / self.device.sample_time if self.device.differences else 0.0
        return damping * low_pass * difference + stiffness

    @property
    def _acting(self) -> tuple[float, float]:
        """Damping and stiffness that act on velocity and position, with the coupling as a wall before a rigid world."""
        if isinstance(self.coupling, SpringDamper) and self.world.stiffness == inf:
            return damping_acting(self.gains, self.coupling), stiffness_read(self.gains, self.coupling)
        return self.gains.velocity, self.gains.position

    def _admittance(self) -> Any:
        """Return the commanded velocity per sensed force: 1/(Z_c + Z_e), or 0 before what does not move."""
        if inf in (self.world.mass, self.world.stiffness):
            return 0.0
        assert not isinstance(self.coupling, SpringDamper)
        T, cos = self.device.sample_time, np.cos(self.theta / 2)
        of = offered_at(self.coupling, T, self.device.rule, self.theta, FLOATS)
        s = 2j / T * np.tan(self.theta / 2)
        own = of.resistance + 1j * of.reactance / cos
        return 1 / (own + self.world.mass * s + self.world.damping + self.world.stiffness / s)

    def _closed(self) -> tuple[Any, Any, Any]:
        """Return the whole loop's return difference times that of the open loop, the open loop's, and the position per
        force times it."""
        loop = self.loop
        assert not isinstance(loop, CommandInHand)
        opened, position = self._complex(loop.open), self._complex(loop.position)
        if isinstance(loop, ForceInHand):
            damping, stiffness = self._acting
            return opened + damping * self._complex(loop.velocity) + stiffness * position, opened, position
        felt = self._complex(loop.numerator(self.gains)) / (2j * np.sin(self.theta / 2))
        return self._complex(loop.closed(self.gains)) + self._admittance() * felt, opened, position

    def of_position(self) -> tuple[Any, Any]:
        """Return position and motor force per error of the read position."""
        closed, opened, position = self._closed()
        return -self._read * position / closed, -self._read * opened / closed

    def of_force(self) -> tuple[Any, Any]:
        """Return velocity and motor force per error of the sensed force, 0 of a servo."""
        T, sin, heard = self.device.sample_time, np.sin(self.theta / 2), 1.0 + 0j
        for section in force_sections(self.device):
            even, odd = quotient(section, np.cos(self.theta / 2), sin * sin)
            heard = heard * (even + 1j * sin * odd)
        commanded = self._admittance() * heard
        if isinstance(self.loop, CommandInHand):
            seen = self._complex(self.loop.seen) / (2j * np.sin(self.theta / 2))
            motion = Loop(self.device, self.gains).motion.at(self.theta / T).values
            return motion * commanded / (1 + self._admittance() * seen), 0.0 * self.theta
        closed, opened, position = self._closed()
        ahead = T / self._back if self.device.summed else T / (2j * np.tan(self.theta / 2))
        driven = commanded * (self.gains.velocity + self.gains.position * ahead) / closed
        return driven * position * self._back / T, driven * opened


def encountered(problem: Problem) -> list[World]:
    """Return the environments before which the bounds are taken: the least and the greatest, or a rigid world."""
    rigid, worlds = World(0.0, 0.0, inf), problem.worlds
    if problem.rigid:
        return [rigid]
    if worlds is None:
        return [World(0.0, 0.0, 0.0), rigid]
    return list(dict.fromkeys((worlds.low, replace(worlds.high, damping=worlds.low.damping))))
