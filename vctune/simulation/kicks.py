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
# Windows of a run over which a motion that dies away falls from each to the next, those of a first look, and the share
# of its size by which it falls, at least
WINDOWS, FEWEST, FALLS = 5, 3, 1e-3
# Length of a run in time constants, and its limits in seconds and in samples
CONSTANTS, SHORTEST, LONGEST, MOST_SAMPLES = 4.0, 1.5, 12.0, 20_000
FURTHER = 3.0  # Times as long a motion is watched that falls, within these limits
CYCLES = 3  # Periods of the softest of several walls for which each is watched at once
MORE = 16  # How many times as many kicks a calm wall bears
FIRST, FEW = 8, 6  # One of so many of the fixed kicks, and of those all over a box, comes before the others
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
) -> Buzz | None:
    """Return what a fixed set of kicks does to a design; None if neither friction nor a step of a reading is stated.

    `time_constant` is that of the loop's slowest oscillation, s.
    """
    if not any(_steps_and_friction(device)):
        return None
    kicked = _hands_kicked(hands)
    numbers = np.arange(len(kicked))
    buzzes = list[Buzz]()
    for world, law in laws(device, gains, coupling, worlds):
        going = _going(device, hands, gains, coupling, (world, law), time_constant, kicked, numbers)
        buzzes.append(_worst(going, kicked, world))
    worst = max(buzzes, key=lambda buzz: (buzz.moving > 0, buzz.amplitude))
    return replace(worst, kicks=sum(one.kicks for one in buzzes), moving=sum(one.moving for one in buzzes))


def bears_more_kicks(
    device: Device,
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    worlds: tuple[World, ...],
    time_constant: float,
) -> bool:
    """Return whether none of `MORE` times as many kicks as those of `buzz`, in hands all over the box, keeps a design
    moving. It ends with the first block of kicks one of which does."""
    fixed = len(_hands_kicked(hands))
    kicked = _hands_all_over(hands)
    for block in _few_then_others(len(kicked)):
        struck = [kicked[number] for number in block]
        for place in laws(device, gains, coupling, worlds):
            going = _going(device, hands, gains, coupling, place, time_constant, struck, fixed + block)
            if going.lanes.size:
                return False
    return True


def _going(
    device: Device,
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    place: tuple[World, Law],
    time_constant: float,
    kicked: Sequence[Hand],
    numbers: NDArray[np.intp],
) -> Going:
    """Return the kicks that keep a design moving before one environment.

    Parameters
    ----------
    device, hands, gains, coupling
        The design, and the box of its hands.
    place : tuple[World, Law]
        The environment, and the firmware before it.
    time_constant : float
        That of the loop's slowest oscillation, s.
    kicked : Sequence[Hand]
        The hand of each kick.
    numbers : NDArray[np.intp]
        The number of each kick, which fixes its speed, place and force.
    """
    world, law = place
    stiffness = stiffness_read(gains, coupling)
    damping = damping_acting(gains, coupling)
    firm = world.stiffness > 0 and stiffness > 0  # else a constant force moves it on
    seconds = min(max(CONSTANTS * time_constant, SHORTEST), LONGEST)
    window = max(WATCHED, FADES * seconds / CONSTANTS)
    if firm and device.servo is None:  # a window has both ends of the slowest motion
        window = max(window, min(_slowest(device, hands, stiffness), LONGEST / WINDOWS))
    kicks = _kicks(device, kicked, numbers, np.array(damping), np.array(stiffness), PUSHES if firm else 0.0)
    longest = min(FURTHER * seconds, LONGEST)
    return _struck(together(_scene(device, law), kicked), kicks, window, WINDOWS, seconds, longest)


def calm(device: Device, hands: Hands, walls: Sequence[SpringDamper]) -> NDArray[np.bool_]:
    """Return which of several walls of an impedance display no kick of those of `buzz` keeps moving, as is seen in a
    few periods. A few kicks in each corner of the box come first: they find most walls that buzz."""
    kicked = _hands_kicked(hands)
    numbers = np.arange(len(kicked))
    few = numbers % FIRST == 0
    return _calm_after(device, hands, walls, kicked, [numbers[few], numbers[~few]], 0)


def calm_all_over(device: Device, hands: Hands, walls: Sequence[SpringDamper]) -> NDArray[np.bool_]:
    """Return which of several walls no kick of those of `bears_more_kicks` keeps moving, as is seen in a few
    periods."""
    kicked = _hands_all_over(hands)
    return _calm_after(device, hands, walls, kicked, _few_then_others(len(kicked)), len(_hands_kicked(hands)))


def _calm_after(
    device: Device,
    hands: Hands,
    walls: Sequence[SpringDamper],
    kicked: Sequence[Hand],
    blocks: Sequence[NDArray[np.intp]],
    first: int,
) -> NDArray[np.bool_]:
    """Return which of several walls rest or fall after every kick, shape (walls,).

    The kicks of a block are stepped for all walls in the same arrays, for a few periods of the softest. A wall that one
    of them keeps moving is not struck again.

    Parameters
    ----------
    device, hands, walls
        An impedance display, the box of its hands, and the walls.
    kicked : Sequence[Hand]
        The hand of each kick.
    blocks : Sequence[NDArray[np.intp]]
        Places in `kicked` of the kicks of each block.
    first : int
        Number of the first of the kicks.
    """
    [(_, law)] = laws(device, NO_GAINS, walls[0], (RIGID,))
    stiffness = np.array([wall.stiffness for wall in walls])
    damping = np.array([wall.damping for wall in walls])
    window = min(CYCLES * _slowest(device, hands, float(stiffness.min())), WATCHED)
    rests = np.ones(len(walls), dtype=bool)
    for block in blocks:
        left = np.flatnonzero(rests)
        if not left.size:
            break
        struck = [kicked[number] for number in block]
        wall_of_lane = np.repeat(left, len(block))
        handles = together(_scene(device, law), struck).of(np.tile(np.arange(len(block)), left.size))
        controller, state = handles.firmware
        controller = with_walls(controller, stiffness[wall_of_lane], damping[wall_of_lane])
        handles = replace(handles, firmware=(controller, state))
        numbers = np.tile(first + block, left.size)
        kicks = _kicks(device, struck * left.size, numbers, damping[wall_of_lane], stiffness[wall_of_lane], PUSHES)
        going = _struck(handles, kicks, window, FEWEST)
        rests[wall_of_lane[going.lanes]] = False
    return rests


def _slowest(device: Device, hands: Hands, stiffness: float) -> float:
    """Return the period of a handle on a wall, in the heaviest hand, s."""
    return 2 * pi * sqrt((device.mass + hands.high.mass) / stiffness)


def _few_then_others(count: int) -> list[NDArray[np.intp]]:
    """Return the numbers from 0 to a count in two blocks: what many kicks keep moving is found in the first."""
    return np.split(np.arange(count), [count // FEW])


def _steps_and_friction(device: Device) -> tuple[float, float, float]:
    """Return the steps of the encoder, m, and of the force sensor, N, and the friction, N; 0 for none."""
    return read_in_steps(device) or 0.0, device.sensing.resolution or 0.0, device.friction or 0.0


def _scene(device: Device, law: Law) -> Scene:
    """Return a device under a firmware, with its friction and the steps of its readings."""
    q, q_f, f = _steps_and_friction(device)
    friction = Friction(f, f) if f > 0 and device.servo is None else None
    stays = held_by(Hand(0.0, 0.0, 0.0))  # each lane has a hand of its own
    return Scene(device, stays, friction, replace(law, position_resolution=q), 0.0, 0, q_f)


def _hands_kicked(hands: Hands) -> list[Hand]:
    """Return the hand of each kick of a fixed set: each corner of a box several times."""
    corners = list(dict.fromkeys(hands.corners))
    return [hand for hand in corners for _ in range(max(EACH, ceil(LEAST_KICKS / len(corners))))]


def _hands_all_over(hands: Hands) -> list[Hand]:
    """Return the hand of each further kick: `MORE` - 1 times as many as the least number, all over a box."""
    return _spread(hands, (MORE - 1) * LEAST_KICKS)


def _spread(hands: Hands, count: int) -> list[Hand]:
    """Return hands that fill a box evenly."""
    low, high = (np.array([getattr(end, name) for name in NAMES], float) for end in (hands.low, hands.high))
    shares = np.mod(0.5 + np.arange(count)[:, None] * EVENLY_IN_HANDS, 1.0)
    return [Hand(*map(float, row)) for row in low + shares * (high - low)]


def _kicks(
    device: Device,
    hands: Sequence[Hand],
    numbers: NDArray[np.intp],
    damping: Floats,
    stiffness: Floats,
    pushes: float,
) -> Kicks:
    """Return kicks that are spread evenly over speeds, places within a step, places of the hand and constant forces.

    Parameters
    ----------
    device : Device
        What is struck.
    hands : Sequence[Hand]
        The hand of each lane.
    numbers : NDArray[np.intp]
        The number of each lane's kick in the sequence that fills the box of kicks.
    damping, stiffness : Floats
        What acts on the reading, N s/m and N/m: of one law, or of each lane.
    pushes : float
        Greatest constant force of the hand, as a share of the friction.
    """
    q, q_f, f = _steps_and_friction(device)
    spread = np.mod(0.5 + numbers[:, None] * EVENLY, 1.0)
    of_hand = np.array([hand.stiffness for hand in hands])
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


def _struck(
    handles: Together, kicks: Kicks, window: float, fewest: int, seconds: float = 0.0, longest: float = 0.0
) -> Going:
    """Strike every lane once, and return those that go on moving.

    A lane is watched for one window after the other until it rests. After `seconds`, it goes on moving unless it falls:
    unless its amplitude in each of the last windows is less than in the one before. One that falls is watched further,
    for `longest` at most, and if it has fallen in every window until then, it dies away. One that drifts on passes the
    steps of its reading, and does not go on moving either.

    Parameters
    ----------
    handles : Together
        The lanes at rest.
    kicks : Kicks
        What strikes each of them.
    window : float
        Time for which a lane is watched at once, s.
    fewest : int
        Number of windows for which one that does not rest is watched, at least.
    seconds, longest : float
        Times until one that does not fall goes on moving, and at most, s.
    """
    device = handles.scene.device
    q = handles.scene.law.position_resolution
    T = device.sample_time
    now = handles.start
    names = handles.moving.states
    now["body"][names.index(POSITION)] = kicks.begins.copy()
    for name in chain(device, FLOATS).velocities if device.servo is None else ():
        now["body"][names.index(name)] = np.broadcast_to(kicks.speed, kicks.begins.shape).copy()
    block = max(min(ceil(window / T), MOST_SAMPLES // fewest), LEAST_SAMPLES)
    most = max(min(ceil(longest / T), MOST_SAMPLES), fewest * block)
    total = min(max(ceil(seconds / T), fewest * block), most)
    lanes, push = np.arange(kicks.begins.size), kicks.push
    travel, greatest = np.zeros(lanes.size), np.zeros(lanes.size)
    amplitudes, variations = np.zeros((0, lanes.size)), np.zeros((0, lanes.size))
    going = list[Going]()
    for done in range(block, most + block, block):
        now, places, forces = _watched(handles, now, push, block)
        ripple, drift = _ripple(places)
        varies = np.ptp(forces, axis=0)
        # not the ripple: a line through a few periods has a slope that depends on where they begin
        amplitudes = np.vstack([amplitudes, np.ptp(places, axis=0) / 2])
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
    """Return whether each lane's amplitude has fallen from every one of the last `WINDOWS` windows to the next, by more
    than rounding; `amplitudes` has the shape (windows, lanes)."""
    last = amplitudes[-WINDOWS:]
    return np.asarray((last[1:] < (1 - FALLS) * last[:-1]).all(axis=0))


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
