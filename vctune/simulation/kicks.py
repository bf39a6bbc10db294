"""Strike a device that has friction or steps of a reading, and tell which kicks keep it moving (README.md, "Does it
buzz?")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.experiment import Friction
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import NAMES, Hand, Hands
from vctune.model.mechanism import POSITION, chain
from vctune.model.numbers.arithmetic import FLOATS, Floats
from vctune.model.rest import damping_acting, read_in_steps, stiffness_read
from vctune.model.worlds import World
from vctune.running import check_time
from vctune.simulation.controller import Law
from vctune.simulation.oscillation import SHAKES, strongest_hz
from vctune.simulation.sample import Parts
from vctune.simulation.scene import Scene
from vctune.simulation.together import Together, held_by, together, with_walls
from vctune.simulation.worlds import RIGID, laws

LEAST_KICKS, EACH = 192, 24  # Number of kicks before an environment, and in a hand, at least
# Fractions of the golden ratio's generalisation to four dimensions, whose multiples fill a box evenly
EVENLY = 1 / 1.1673039782614187 ** np.arange(1, 5)
EVENLY_IN_HANDS = 1 / 1.2207440846057596 ** np.arange(1, 4)  # to three dimensions
SLOWEST, FASTEST = 0.1, 16.0  # Speeds of the kicks, in steps of the encoder per sample and speeds that friction stops
AWAY = 30.0  # Greatest distance of the hand's place from the handle, in steps
PUSHES = 1.25  # Greatest constant force of the hand, as a share of the friction
# Time for which a device is watched at once, s and in time constants, so that what fades differs from what lasts, and
# least number of samples
WATCHED, FADES, LEAST_SAMPLES = 0.5, 0.5, 128
FALLS = 1e-3  # Share of its size by which a motion that dies away falls from one third of a run to the next, at least
# Length of a run in time constants, and its limits in seconds and in samples
CONSTANTS, SHORTEST, LONGEST, MOST_SAMPLES = 4.0, 1.5, 12.0, 20_000
FURTHER = 3.0  # Times as long a motion is watched that falls, within these limits
CYCLES = 3  # Periods of the softest of several walls for which each is watched at once
ROUNDING = 1e-9  # Share of its place within which a handle is at rest
LEAST = 1e-300  # What stands for a divisor of 0 whose quotient does not count
NO_GAINS = Gains(0.0, 0.0)  # of an impedance display that injects no damping
GRAIN = 1e-4  # Of an ideal encoder: share of a kick's motion that counts as a step


@dataclass(frozen=True, slots=True)
class Buzz:
    """What kicks do to a device: the worst of those that keep moving."""

    kicks: int
    moving: int  # number of kicks after which it goes on moving
    amplitude: float  # half of the way of the handle to and fro, m; 0 if every kick comes to rest
    force: float  # half of what the motor's force varies, N; a servo's command, m/s or m
    frequency: float  # Hz
    hand: Hand | None
    world: World | None


@dataclass(frozen=True, slots=True)
class Kicks:
    """What strikes the lanes of a simulation, each of shape (lanes,)."""

    speed: Floats  # m/s; of a servo, which nothing strikes, 0
    begins: Floats  # place of the handle, m
    push: Floats  # constant force of the hand, N


@dataclass(frozen=True, slots=True)
class Going:
    """The lanes that go on moving, each over the last time for which it was watched."""

    lanes: NDArray[np.intp]
    amplitude: Floats  # half of the way to and fro, m, shape (lanes,)
    force: Floats  # half of what the command varies, N
    frequency: Floats  # Hz


@lru_cache(maxsize=16)  # record, row and warning of a design ask for it
def buzz(
    device: Device,
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    worlds: tuple[World, ...],
    time_constant: float,
    more: int = 1,
) -> Buzz | None:
    """Return what a fixed set of kicks does to a design; None if neither friction nor a step of a reading is stated.

    `time_constant` is that of the loop's slowest oscillation, s. There are `more` times as many kicks, the
    others in hands all over the box.
    """
    steps = _steps_and_friction(device)
    if not any(steps):
        return None
    seconds = min(max(CONSTANTS * time_constant, SHORTEST), LONGEST)
    window = max(WATCHED, min(FADES * seconds / CONSTANTS, LONGEST / 3))
    longest = min(FURTHER * seconds, LONGEST)
    kicked = _hands_kicked(hands, more)
    buzzes = list[Buzz]()
    for world, law in laws(device, gains, coupling, worlds):
        firm = world.stiffness > 0 and stiffness_read(gains, coupling) > 0  # else a constant force moves it on
        damping, stiffness = damping_acting(gains, coupling), stiffness_read(gains, coupling)
        kicks = _kicks(device, kicked, np.array(damping), np.array(stiffness), PUSHES if firm else 0.0)
        going = _struck(together(_scene(device, law), kicked), kicks, window, seconds, longest)
        buzzes.append(_worst(going, kicked, world))
    worst = max(buzzes, key=lambda buzz: (buzz.moving > 0, buzz.amplitude))
    return replace(worst, kicks=sum(one.kicks for one in buzzes), moving=sum(one.moving for one in buzzes))


def calm(device: Device, hands: Hands, walls: Sequence[SpringDamper], more: int = 1) -> NDArray[np.bool_]:
    """Return which of several walls of an impedance display no kick of those of `buzz` keeps moving.

    The kicks of all walls are stepped in the same arrays, for a few periods of the softest: what falls then is calm.
    """
    kicked = _hands_kicked(hands, more)
    [(_, law)] = laws(device, NO_GAINS, walls[0], (RIGID,))
    stiffness = np.repeat([wall.stiffness for wall in walls], len(kicked))
    damping = np.repeat([wall.damping for wall in walls], len(kicked))
    handles = together(_scene(device, law), kicked).of(np.tile(np.arange(len(kicked)), len(walls)))
    controller, state = handles.firmware
    handles = replace(handles, firmware=(with_walls(controller, stiffness, damping), state))
    kicks = _kicks(device, kicked, damping, stiffness, PUSHES)
    slowest = 2 * pi * sqrt((device.mass + hands.high.mass) / stiffness.min())  # period of the softest wall, s
    window = min(CYCLES * slowest, WATCHED)
    going = _struck(handles, kicks, window, 3 * window, 3 * window)
    moving = np.bincount(going.lanes // len(kicked), minlength=len(walls))
    return np.asarray(moving == 0)


def _steps_and_friction(device: Device) -> tuple[float, float, float]:
    """Return the steps of the encoder, m, and of the force sensor, N, and the friction, N; 0 for none."""
    return read_in_steps(device) or 0.0, device.sensing.resolution or 0.0, device.friction or 0.0


def _scene(device: Device, law: Law) -> Scene:
    """Return a device under a firmware, with its friction and the steps of its readings."""
    q, q_f, f = _steps_and_friction(device)
    friction = Friction(f, f) if f > 0 and device.servo is None else None
    stays = held_by(Hand(0.0, 0.0, 0.0))  # each lane has a hand of its own
    return Scene(device, stays, friction, replace(law, position_resolution=q), 0.0, 0, q_f)


def _hands_kicked(hands: Hands, more: int) -> list[Hand]:
    """Return the hand of each kick: each corner of a box several times, and `more` - 1 times as many all over it."""
    corners = list(dict.fromkeys(hands.corners))
    at_corners = [hand for hand in corners for _ in range(max(EACH, ceil(LEAST_KICKS / len(corners))))]
    if len(corners) == 1:
        return at_corners * more
    return at_corners + _spread(hands, (more - 1) * LEAST_KICKS)


def _spread(hands: Hands, count: int) -> list[Hand]:
    """Return hands that fill a box evenly."""
    low, high = (np.array([getattr(end, name) for name in NAMES], float) for end in (hands.low, hands.high))
    shares = np.mod(0.5 + np.arange(count)[:, None] * EVENLY_IN_HANDS, 1.0)
    return [Hand(*map(float, row)) for row in low + shares * (high - low)]


def _kicks(device: Device, hands: Sequence[Hand], damping: Floats, stiffness: Floats, pushes: float) -> Kicks:
    """Return kicks that are spread evenly over speeds, places within a step, places of the hand and constant forces.

    Parameters
    ----------
    device : Device
        What is struck.
    hands : Sequence[Hand]
        The hand of each kick of a law.
    damping, stiffness : Floats
        What acts on the reading, N s/m and N/m: of one law, or of each lane of several laws one after the other.
    pushes : float
        Greatest constant force of the hand, as a share of the friction.
    """
    q, q_f, f = _steps_and_friction(device)
    laws_struck = max(1, damping.size // len(hands))
    spread = np.tile(np.mod(0.5 + np.arange(len(hands))[:, None] * EVENLY, 1.0), (laws_struck, 1))
    of_hand = np.tile([hand.stiffness for hand in hands], laws_struck)
    T = device.sample_time
    if device.servo is not None:
        unit = np.zeros(())
        away = np.where(of_hand > 0, AWAY * q_f / np.maximum(of_hand, LEAST), 0.0)
    else:
        acting = damping + device.damping
        unit = q / T + np.where(acting > 0, (f + q_f) / np.maximum(acting, LEAST), 0.0)
        without_steps = np.where(stiffness > 0, f / np.maximum(stiffness, LEAST), unit * T)
        away = AWAY * (np.full(without_steps.shape, q) if q > 0 else without_steps)
    return Kicks(
        speed=unit * SLOWEST * (FASTEST / SLOWEST) ** spread[:, 0],
        begins=(spread[:, 3] - 0.5) * q,
        push=of_hand * away * (2 * spread[:, 1] - 1) + pushes * f * (2 * spread[:, 2] - 1),
    )


def _struck(handles: Together, kicks: Kicks, window: float, seconds: float, longest: float) -> Going:
    """Strike every lane once, and return those that go on moving.

    A lane is watched for one window after the other until it rests. After `seconds`, it goes on moving unless it falls:
    unless its greatest amplitude in the last third of the run is less than that in the third before. One that falls is
    watched further, for `longest` at most, and if it still falls then, it dies away. One that drifts on passes the
    steps of its reading, and does not go on moving either.

    Parameters
    ----------
    handles : Together
        The lanes at rest.
    kicks : Kicks
        What strikes each of them.
    window, seconds, longest : float
        Times for which a lane is watched at once, until one that does not fall goes on moving, and at most, s.
    """
    device = handles.scene.device
    q = handles.scene.law.position_resolution
    T = device.sample_time
    now = handles.start
    names = handles.moving.states
    now["body"][names.index(POSITION)] = kicks.begins.copy()
    for name in chain(device, FLOATS).velocities if device.servo is None else ():
        now["body"][names.index(name)] = np.broadcast_to(kicks.speed, kicks.begins.shape).copy()
    block = max(ceil(window / T), LEAST_SAMPLES)
    most = max(min(ceil(longest / T), MOST_SAMPLES), 3 * block)
    total = min(max(ceil(seconds / T), 3 * block), most)
    lanes, push = np.arange(kicks.begins.size), kicks.push
    travel, greatest = np.zeros(lanes.size), np.zeros(lanes.size)
    amplitudes, variations = np.zeros((0, lanes.size)), np.zeros((0, lanes.size))
    going = list[Going]()
    for done in range(block, most + block, block):
        now, places, forces = _watched(handles, now, push, block)
        ripple, drift = _ripple(places)
        varies = np.ptp(forces, axis=0)
        amplitudes = np.vstack([amplitudes, ripple])
        variations = np.vstack([variations, varies])
        travel = np.maximum(travel, ripple)
        greatest = np.maximum(greatest, np.abs(forces).max(axis=0))
        still = np.maximum(SHAKES * q if q > 0 else GRAIN * travel, ROUNDING * np.abs(places).max(axis=0))
        watched = (ripple > still) | (varies > SHAKES * greatest)
        if done >= total:
            watched &= drift <= ripple
            # while the handle itself rests, only the command tells whether something falls
            falls = np.where(ripple > still, _falls(amplitudes), _falls(variations))
            lasts = watched & ~falls
            hz = [strongest_hz(trace, T) for trace in places[:, lasts].T]
            going.append(Going(lanes[lasts], ripple[lasts], varies[lasts] / 2, np.array(hz)))
            watched &= ~lasts
        if not watched.any():
            break
        handles, lanes, push = handles.of(np.flatnonzero(watched)), lanes[watched], push[watched]
        now = {
            name: [np.broadcast_to(number, watched.shape)[watched] for number in numbers]
            for name, numbers in now.items()
        }
        travel, greatest = travel[watched], greatest[watched]
        amplitudes, variations = amplitudes[:, watched], variations[:, watched]
    return Going(
        np.concatenate([part.lanes for part in going] or [lanes[:0]]),
        np.concatenate([part.amplitude for part in going] or [travel[:0]]),
        np.concatenate([part.force for part in going] or [travel[:0]]),
        np.concatenate([part.frequency for part in going] or [travel[:0]]),
    )


def _falls(amplitudes: Floats) -> NDArray[np.bool_]:
    """Return whether each lane's greatest amplitude falls from the last third but one of the times to the last, by more
    than rounding; `amplitudes` has the shape (times, lanes)."""
    third = len(amplitudes) // 3
    last = amplitudes[-third:].max(axis=0)
    before = amplitudes[-2 * third : -third].max(axis=0)
    return np.asarray(last < (1 - FALLS) * before)


def _worst(going: Going, hands: Sequence[Hand], world: World) -> Buzz:
    """Return the greatest of the motions that go on."""
    if not going.lanes.size:
        return Buzz(len(hands), 0, 0.0, 0.0, 0.0, None, None)
    k = int(np.argmax(going.amplitude))
    motion = float(going.amplitude[k]), float(going.force[k]), float(going.frequency[k])
    return Buzz(len(hands), going.lanes.size, *motion, hands[going.lanes[k]], world)


def _watched(one: Together, now: Parts, push: Floats, count: int) -> tuple[Parts, Floats, Floats]:
    """Return the states after a number of samples, with the places of the handle and the motor's commands at each."""
    check_time()
    places, forces = np.empty((2, count, push.size))
    for k in range(count):
        now, record = one.advance(now, push)
        places[k], forces[k] = record[0], record[6]
    return now, places, forces


def _ripple(places: Floats) -> tuple[Floats, Floats]:
    """Return half of the way to and fro beside a steady motion, and half of the way of that motion, m."""
    t = np.linspace(-1.0, 1.0, len(places))[:, None]
    drift = (places * t).sum(axis=0) / (t * t).sum()
    return np.asarray(np.ptp(places - drift * t, axis=0) / 2), np.abs(drift)
