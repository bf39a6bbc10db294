"""Strike a device that has friction or steps of a reading, and tell which kicks keep it moving (README.md, "Does it
buzz?")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil

import numpy as np
from numpy.typing import NDArray

from vctune.model.device import Device
from vctune.model.experiment import Friction
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import NAMES, Hand, Hands
from vctune.model.mechanism import POSITION, chain
from vctune.model.numbers.arithmetic import FLOATS, Floats
from vctune.model.rest import damping_acting, read_in_steps, stiffness_read
from vctune.model.worlds import World
from vctune.running import check_time
from vctune.simulation.oscillation import SHAKES, strongest_hz
from vctune.simulation.sample import Parts
from vctune.simulation.scene import Scene
from vctune.simulation.together import Together, held_by, together
from vctune.simulation.worlds import laws

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
LASTS = 0.7  # Share of its size that a buzz keeps from one of these times to the next; what fades keeps 0.6
# Length of a run in time constants, and its limits in seconds and in samples
CONSTANTS, SHORTEST, LONGEST, MOST_SAMPLES = 4.0, 1.5, 12.0, 20_000
ROUNDING = 1e-9  # Share of its place within which a handle is at rest
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
    q, q_f, f = read_in_steps(device) or 0.0, device.sensing.resolution or 0.0, device.friction or 0.0
    if q == q_f == f == 0:
        return None
    seconds = min(max(CONSTANTS * time_constant, SHORTEST), LONGEST)
    corners = list(dict.fromkeys(hands.corners))
    each = max(EACH, ceil(LEAST_KICKS / len(corners)))
    kicked = [hand for hand in corners for _ in range(each)]
    kicked += _spread(hands, (more - 1) * LEAST_KICKS) if len(corners) > 1 else kicked * (more - 1)
    found = list[Buzz]()
    for world, law in laws(device, gains, coupling, worlds):
        friction = Friction(f, f) if f > 0 and device.servo is None else None
        scene = Scene(device, held_by(corners[0]), friction, replace(law, position_resolution=q), 0.0, 0, q_f)
        speed, place = _sizes(device, gains, coupling, kicked, (q, q_f, f))
        firm = world.stiffness > 0 and stiffness_read(gains, coupling) > 0  # else a constant force moves it on
        found.append(
            _struck(together(scene, kicked), kicked, speed, place, PUSHES * f if firm else 0.0, world, seconds)
        )
    worst = max(found, key=lambda each: (each.moving > 0, each.amplitude))
    return replace(worst, kicks=sum(one.kicks for one in found), moving=sum(one.moving for one in found))


def _spread(hands: Hands, count: int) -> list[Hand]:
    """Return hands that fill a box evenly."""
    low, high = (np.array([getattr(end, name) for name in NAMES], float) for end in (hands.low, hands.high))
    shares = np.mod(0.5 + np.arange(count)[:, None] * EVENLY_IN_HANDS, 1.0)
    return [Hand(*map(float, row)) for row in low + shares * (high - low)]


def _sizes(
    device: Device, gains: Gains, coupling: AnyCoupling, hands: Sequence[Hand], steps: tuple[float, float, float]
) -> tuple[float, Floats]:
    """Return the unit of a kick's speed, m/s, and the greatest distance of each hand's place, m."""
    q, q_f, f = steps
    if device.servo is not None:
        stiffness = np.array([hand.stiffness for hand in hands])
        return 0.0, np.where(stiffness > 0, AWAY * q_f / np.maximum(stiffness, 1e-300), 0.0)
    damping = damping_acting(gains, coupling) + device.damping
    speed = q / device.sample_time + (f + q_f) / damping if damping > 0 else q / device.sample_time
    k = stiffness_read(gains, coupling)
    return speed, np.full(len(hands), AWAY * (q or (f / k if k > 0 else speed * device.sample_time)))


def _struck(
    one: Together, hands: Sequence[Hand], speed: float, place: Floats, push: float, world: World, seconds: float
) -> Buzz:
    """Strike every lane once and follow those that move; the kicks are spread evenly over speeds, places and forces."""
    device, count, q = one.scene.device, len(hands), one.scene.law.position_resolution
    spread = np.mod(0.5 + np.arange(count)[:, None] * EVENLY, 1.0)
    now, names = one.start, one.moving.states
    struck = speed * SLOWEST * (FASTEST / SLOWEST) ** spread[:, 0]
    stiffness = np.array([hand.stiffness for hand in hands])
    pushed = stiffness * place * (2 * spread[:, 1] - 1) + push * (2 * spread[:, 2] - 1)
    begins = (spread[:, 3] - 0.5) * q
    now["body"][names.index(POSITION)] = begins.copy()
    for name in chain(device, FLOATS).velocities if device.servo is None else ():
        now["body"][names.index(name)] = struck.copy()
    block = max(ceil(max(WATCHED, min(FADES * seconds / CONSTANTS, LONGEST / 3)) / device.sample_time), LEAST_SAMPLES)
    most = max(min(ceil(LONGEST / device.sample_time), MOST_SAMPLES), 3 * block)
    total = min(max(ceil(seconds / device.sample_time), 3 * block), most)
    lanes, last = np.arange(count), np.full(count, np.inf)
    travel, greatest = np.zeros(count), np.zeros(count)
    lasting: tuple[NDArray[np.intp], Floats, Floats] = (lanes[:0], np.zeros((0, 0)), np.zeros((0, 0)))
    for done in range(block, most + block, block):
        now, places, forces = _watched(one, now, pushed, block)
        (ripple, drift), moved = _ripple(places), np.ptp(forces, axis=0)
        travel = np.maximum(travel, ripple)
        greatest = np.maximum(greatest, np.abs(forces).max(axis=0))
        still = np.maximum(SHAKES * q if q > 0 else GRAIN * travel, ROUNDING * np.abs(places).max(axis=0))
        rests = (ripple <= still) & (moved <= SHAKES * greatest)
        goes_on = ~rests
        # what drifts on shows the steps that it passes
        lasts = goes_on & (ripple >= LASTS * last[lanes]) & (drift <= ripple)
        lasting = lanes[lasts], places[:, lasts], forces[:, lasts]
        fades = goes_on & (ripple < LASTS * last[lanes]) & (drift <= ripple)
        last[lanes] = ripple
        if not goes_on.any() or (done >= total and not fades.any()):
            break
        one, lanes, pushed = one.of(np.flatnonzero(goes_on)), lanes[goes_on], pushed[goes_on]
        now = {name: [np.broadcast_to(n, goes_on.shape)[goes_on] for n in numbers] for name, numbers in now.items()}
        travel, greatest = travel[goes_on], greatest[goes_on]
    which, places, forces = lasting
    if not which.size:
        return Buzz(count, 0, 0.0, 0.0, 0.0, None, None)
    sizes, _ = _ripple(places)
    k = int(np.argmax(sizes))
    hz, force = strongest_hz(places[:, k], device.sample_time), float(np.ptp(forces[:, k])) / 2
    return Buzz(count, which.size, float(sizes[k]), force, hz, hands[which[k]], world)


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
