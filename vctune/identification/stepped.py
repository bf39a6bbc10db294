"""The response of a device, and its steps from the recorded commands, many segments of a log and many devices at once
(README, section 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.model.device import Device
from vctune.model.mechanism import forces, linked
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.matrices import exponentials
from vctune.model.parts import Structure

Numbers = Mapping[str, float]
Complex = NDArray[np.complex128]
SHORTEST = 0.02  # Shortest lag of a servo, in rows
LAGS = {1: 1.0, 2: sqrt(2)}  # Lag of a servo's low-pass, times its angular frequency, by its order
INPUTS = 5  # Force of the motor, friction, hand, and the slopes of the first and of the third over a part of a row


@dataclass(frozen=True, slots=True)
class Drive:
    """What moved a device, on even rows, and how it was read."""

    T: float  # time between two rows, s
    input: Floats  # command or force, shape (rows,)
    hand: Floats | None = None  # sensed force of a hand
    ramp: bool = False  # whether the input is a line between two rows, or held
    servo: int = 0  # order of a servo, whose input is a velocity; 0 for a mechanism
    reads: tuple[int, ...] = (0,)  # states that were read: 0 the position, 1 the velocity, 2 the handle's position

    @property
    def greatest(self) -> float:
        """The greatest input, of motor or hand."""
        return max(float(np.abs(each).max()) for each in (self.input, self.hand) if each is not None)

    def free(self, numbers: Numbers) -> list[int]:
        """Return the states at the start of a segment that do not follow from the input and are seen."""
        placed = [0] if self.reads != (1,) else []
        if self.servo:
            return placed
        return [*placed, 1, *([2, 3] if "handle_mass" in numbers else [])]


def dampings(numbers: Numbers) -> tuple[float, float]:
    """Return the damping while the position rises, and while it falls."""
    return numbers["damping"], numbers.get("damping_back", numbers["damping"])


def linear(drive: Drive, numbers: Numbers) -> tuple[Floats, Floats, float]:
    """Return A and B of z' = A z + B (force, friction, hand) without friction and gravity, and the mass that rubs.

    The states are position and velocity of the motor, those of the handle behind a spring, and the lagging force; of a
    servo position, velocity and acceleration.
    """
    if drive.servo:
        w = 1 / max(numbers["lag"], SHORTEST * drive.T)
        if drive.servo == 1:
            return np.array([[0, 1.0], [0, -w]]), np.array([[0.0, 0, 0], [numbers["gain"] * w, 0, 0]]), 1.0
        w *= LAGS[2]
        A = np.array([[0, 1.0, 0], [0, 0, 1.0], [0, -w * w, -np.sqrt(2) * w]])
        return A, np.array([[0.0, 0, 0], [0, 0, 0], [numbers["gain"] * w * w, 0, 0]]), 1.0
    mass, lag, spring = numbers["mass"], "lag" in numbers, list[Structure]()
    if "handle_mass" in numbers:
        spring = [Structure(numbers["handle_mass"], numbers["frequency_hz"], numbers["damping_ratio"])]
        mass = numbers["handle_mass"] + max(mass - numbers["handle_mass"], 1e-3 * mass)  # which a search may try
    of = linked(mass, sum(dampings(numbers)) / 2, spring, None, FLOATS)
    places, last = [0, 2][: 1 + len(spring)], 2 * len(spring)
    A, B = np.zeros((2 + last + lag, 2 + last + lag)), np.zeros((2 + last + lag, 3))
    for place, (name, own) in zip(places, of.masses.items(), strict=True):
        A[place, place + 1] = 1.0
        for state, share in forces(of)[name].items():
            if state in of.bends:
                A[place + 1, [2, 0]] += np.array([share, -share]) / own
            else:
                A[place + 1, 2 * of.velocities.index(state) + 1] += share / own
    motor = of.motor
    A[1, 0] -= numbers.get("stiffness", 0.0) / motor
    B[1, 1], B[last + 1, 2] = 1 / motor, 1 / of.masses[of.velocities[-1]]
    if lag:
        A[1, -1], A[-1, -1], B[-1, 0] = 1 / motor, -1 / numbers["lag"], 1 / numbers["lag"]
    else:
        B[1, 0] = 1 / motor
    return A, B, motor


def late_rows(delay: Floats, T: float) -> tuple[NDArray[np.integer], Floats]:
    """Return delays as whole rows and a part of a row, s."""
    whole = np.floor(delay / T + 1e-9).astype(int)
    return whole, np.clip(delay - whole * T, 0.0, T)


def propagators(A: Floats, B: Floats, time: Floats) -> tuple[Floats, Floats]:
    """Return the exact factors of states and of `INPUTS` over a time for each device, with inputs that are lines."""
    count, size = A.shape[:2]
    rate = np.zeros((count, size + INPUTS, size + INPUTS))
    rate[:, :size, :size], rate[:, :size, size : size + 3] = A, B
    rate[:, size, size + 3] = rate[:, size + 2, size + 4] = 1.0
    ways, which = np.unique((rate * time[:, None, None]).reshape(count, -1), axis=0, return_inverse=True)
    over = exponentials(ways.reshape(-1, *rate.shape[1:]))[which.ravel()]  # many devices differ in first states alone
    return np.ascontiguousarray(over[:, :size, :size]), np.ascontiguousarray(over[:, :size, size:])


def response(drive: Drive, numbers: Numbers, hertz: Floats) -> Complex:
    """Return the response of the motor's position, of a servo's speed, to the input.

    At the samples to a held input, or to a continuous signal if the drive is a ramp.
    """
    A, B, _ = linear(drive, numbers)
    s, T = 2j * pi * hertz, drive.T
    if drive.ramp:
        at, rate, pushed = s, s, B[:, :1] * np.exp(-s * numbers["delay"])[:, None, None]
    else:
        whole, late = late_rows(np.array([numbers["delay"]]), T)
        lengths = np.concatenate([late, T - late])
        F, G = propagators(np.stack([A, A]), np.stack([B, B]), lengths)
        at, rate, A = np.exp(s * T), (1 - np.exp(-s * T)) / T, F[1] @ F[0]
        pushed = (G[1, :, :1] + F[1] @ G[0, :, :1] / at[:, None, None]) * (at**-whole)[:, None, None]
    place = np.linalg.solve(at[:, None, None] * np.eye(len(A)) - A, pushed)[:, 0, 0]
    return np.asarray(place * rate if drive.servo else place)


def numbers_of(device: Device) -> dict[str, float]:
    """Return the numbers of a fit that a device of a problem file has."""
    if device.servo is not None:
        assert device.servo.bandwidth_hz is not None
        lag = LAGS[device.servo.order] / (2 * pi * device.servo.bandwidth_hz)
        return {"gain": 1.0, "delay": device.servo.delay, "lag": lag}
    numbers = {"mass": device.mass, "damping": device.damping, "delay": device.delay}
    if device.actuator is not None:
        numbers["lag"] = 1 / (2 * pi * device.actuator.bandwidth_hz)
    if (spring := device.structure) is not None:
        numbers |= {"handle_mass": spring.handle_mass, "frequency_hz": spring.frequency_hz}
        numbers["damping_ratio"] = spring.damping_ratio
    return numbers


def _from_the_input(A: Floats, B: Floats, parts: Sequence[tuple[Floats, Floats]], acts: Floats, T: float) -> Floats:
    """Return the states that follow the input alone at each row, shape (rows, states), from rest at the first input.

    `acts` are the inputs of the two parts of a row, shape (rows, 2).
    """
    from scipy.signal import lfilter

    (_, G0), (F1, G1) = parts
    values, modes = np.linalg.eig(A)
    back = np.linalg.inv(modes)
    pushed = np.outer(back @ F1 @ G0, acts[:, 0]) + np.outer(back @ G1, acts[:, 1])
    rest = -back @ np.linalg.solve(A, B) * acts[0, 0]
    found = [
        lfilter([1.0], [1.0, -decay], each, zi=[decay * at])[0]
        for decay, each, at in zip(np.exp(values * T), pushed, rest.astype(complex), strict=True)
    ]
    rows = np.column_stack([np.append(at, each[:-1]) for at, each in zip(rest, found, strict=True)])
    return np.asarray((rows @ modes.T).real)


@dataclass(frozen=True)
class RowPart:
    """A part of each row, before or after the next command acts, of all devices."""

    length: Floats  # s, shape (devices, 1)
    A: Floats
    B: Floats
    F: Floats  # factors of the states and of `INPUTS`
    G: Floats
    acting: Floats  # inputs, shape (rows, devices, `INPUTS`, segments)
    pushed: Floats  # what they add to the states
    rest: Floats  # force on the motor, friction, springs and dampers aside, shape (rows, devices, segments)

    @cached_property
    def held(self) -> tuple[Floats, Floats]:
        """The factors of a motor that friction holds."""
        A, B = self.A.copy(), self.B.copy()
        A[:, :2] = B[:, :2] = 0.0
        return propagators(A, B, self.length[:, 0])


@dataclass(frozen=True, slots=True)
class Rubbing:
    """What is not linear in the devices, each of shape (devices, 1)."""

    friction: Floats  # Coulomb's
    stiction: Floats  # that it has more at rest, by Stribeck's curve
    stribeck: Floats  # speed at which a part exp(-1) of that is left
    apart: Floats  # half of what the damping has more while the position rises than while it falls
    sine: Floats  # gravity: sine and cosine of the position
    cosine: Floats
    motor: Floats  # mass that rubs
    force: Floats  # force on the motor by the states, shape (devices, 1, states)

    @property
    def holds(self) -> Floats:
        """The greatest friction at rest."""
        return self.friction + self.stiction

    def against(self, speed: Floats, sign: Floats) -> Floats:
        """Return the friction against a velocity of a sign, beyond the mean damping."""
        more = self.stiction * np.exp(-((speed / self.stribeck) ** 2)) if self.stiction.any() else 0.0
        return np.asarray((self.friction + more) * sign + self.apart * np.abs(speed))


def stepped(drive: Drive, devices: Sequence[Numbers], first: Floats, starts: NDArray[np.integer], rows: int) -> Floats:
    """Return what is read of each device in each segment, shape (rows, readings, devices, segments).

    `first` are the free states at the starts of the segments, shape (devices, free, segments). In each part of a row
    the linear motion is exact. Friction is constant while the velocity keeps its sign, and holds the motor at rest
    where the other forces do not overcome it.
    """
    systems = [linear(drive, each) for each in devices]
    A, B, motor = (np.array([each[i] for each in systems]) for i in range(3))

    def of(name: str) -> Floats:
        return np.array([each.get(name, 0.0) for each in devices])[:, None]

    rubbing = Rubbing(
        of("coulomb"), of("stiction"), np.maximum(of("stribeck"), 1e-300),
        np.array([[(ahead - back) / 2] for ahead, back in map(dampings, devices)]) if not drive.servo else of("servo"),
        of("sine"), of("cosine"), motor[:, None], A[:, 1:2] * motor[:, None, None],
    )  # fmt: skip
    whole, late = late_rows(of("delay")[:, 0], drive.T)
    lengths = np.stack([late, drive.T - late])
    row, last = np.arange(-1, rows + 2)[:, None, None] - whole[None, :, None], len(drive.input) - 1
    told = drive.input[np.clip(starts + row, 0, last)]  # told[i] acts in the first part of row i, told[i + 1] later
    acting = _acting(drive, told, lengths, of("sensor_delay"), of("offset"), starts, rows)
    parts = []
    for length, each in zip(lengths, acting, strict=True):
        F, G = propagators(A, B, length)
        rest = np.matmul((B[:, 1:2] * motor[:, None, None]), each[:, :, :3])[:, :, 0]
        parts.append(RowPart(length[:, None], A, B, F, G, each, np.matmul(G, each), rest))
    z = np.zeros((len(devices), A.shape[1], starts.size))
    known = slice(
        1 if drive.servo else 4 if "handle_mass" in devices[0] else 2, A.shape[1]
    )  # the states that follow the input alone
    for i in range(len(devices) if known.start < A.shape[1] else 0):
        pair = [(part.F[i, known, known], part.G[i, known, 0]) for part in parts]
        acts = np.stack([drive.input[np.clip(np.arange(last + 1) - whole[i] - 1 + j, 0, last)] for j in (0, 1)], 1)
        z[i, known] = _from_the_input(A[i, known, known], B[i, known, 0], pair, acts, drive.T)[starts].T
    z[:, drive.free(devices[0])] = first
    return _read(drive, parts, rubbing, z)


def _read(drive: Drive, parts: Sequence[RowPart], rubbing: Rubbing, z: Floats) -> Floats:
    """Return the readings of all rows from the states at the first."""
    rows, (before, after) = len(parts[0].acting), parts
    read = np.empty((rows, len(drive.reads), len(z), z.shape[2]))
    if not any(np.any(each) for each in (rubbing.holds, rubbing.apart, rubbing.sine, rubbing.cosine)):
        F, pushed = after.F @ before.F, np.matmul(after.F, before.pushed) + after.pushed
        for i in range(rows):
            read[i] = z[:, drive.reads].transpose(1, 0, 2)
            z = F @ z + pushed[i]
        return read
    for i in range(rows):
        read[i] = z[:, drive.reads].transpose(1, 0, 2)
        for part in parts:
            if part.length.any():
                z = _over(part, i, z, rubbing)
    return read


def _over(part: RowPart, i: int, z: Floats, rubbing: Rubbing) -> Floats:
    """Return the states after a part of row i, with friction and gravity."""
    v, h, holds, motor = z[:, 1], part.length, rubbing.holds, rubbing.motor
    middle = z[:, 0] + v * h / 2
    turning = -rubbing.sine * np.sin(middle) - rubbing.cosine * np.cos(middle)
    net, stands = (rubbing.force @ z)[:, 0] + part.rest[i] + turning, v == 0
    sign = np.sign(np.where(stands, net, v)) if stands.any() else np.sign(v)
    rubs = rubbing.against(v, sign)
    if rubbing.apart.any() or rubbing.stiction.any():  # which depend on the speed in the middle of the part
        rubs = rubbing.against(np.maximum(v * sign + h / 2 * sign * (net - rubs) / motor, 0.0), sign)
    new = part.F @ z + part.pushed[i] + part.G[:, :, 1:2] * (turning - rubs)[:, None]
    d, s = np.nonzero(stands & (np.abs(net) <= holds))
    if d.size:
        inputs = part.acting[i, d, :, s][:, :, None]
        F_held, G_held = part.held
        held = (F_held[d] @ z[d, :, s][:, :, None] + G_held[d] @ inputs)[:, :, 0]
        later = np.einsum("ij,ij->i", rubbing.force[d, 0], held) + (part.rest[i] + turning)[d, s]
        more = np.maximum(np.abs(later) - holds[d, 0], 0.0)  # than friction holds at the end: it has begun to move
        after = h[d, 0] * more / np.where(more > 0, np.abs(later) - np.sign(later) * net[d, s], 1.0)
        held[:, 1] = np.sign(later) * more * after / (2 * motor[d, 0])
        held[:, 0] += held[:, 1] * after / 3
        new[d, :, s] = held
    d, s = np.nonzero(new[:, 1] * v < 0)
    if d.size:  # the velocity turns at a share of the part, where friction holds it or turns too
        share = v[d, s] / (v[d, s] - new[d, 1, s])
        later = np.einsum("ij,ij->i", rubbing.force[d, 0], new[d, :, s]) + (part.rest[i] + turning)[d, s]
        stops = np.abs((1 - share) * net[d, s] + share * later) <= holds[d, 0]
        after = (1 - share) * h[d, 0]
        change = 2 * holds[d, 0] * sign[d, s] * after / motor[d, 0]
        at_rest = z[d, 0, s] + share * h[d, 0] * v[d, s] / 2
        new[d, 0, s] = np.where(stops, at_rest, new[d, 0, s] + change * after / 2)
        new[d, 1, s] = np.where(stops, 0.0, new[d, 1, s] + change)
    return np.asarray(new)


def _acting(
    drive: Drive, told: Floats, lengths: Floats, sensor_delay: Floats, pull: Floats, starts: NDArray[np.integer],
    rows: int,
) -> list[Floats]:  # fmt: skip
    """Return the inputs in both parts of each row, each of shape (rows, devices, `INPUTS`, segments)."""
    T, found = drive.T, []
    hands = None
    if drive.hand is not None:
        at = starts + np.arange(rows + 1)[:, None, None] + sensor_delay[None] / T
        hands = np.interp(at.ravel(), np.arange(len(drive.hand)), drive.hand).reshape(at.shape)
    for j, length in enumerate(lengths):
        acting = np.zeros((rows, len(pull), INPUTS, starts.size))
        acting[:, :, 0], acting[:, :, 1] = told[j : j + rows], -pull
        if drive.ramp:
            acting[:, :, 3] = np.diff(told, axis=0)[j : j + rows] / T
            acting[:, :, 0] += acting[:, :, 3] * (T - length[:, None]) * (j == 0)
        if hands is not None:
            acting[:, :, 4] = np.diff(hands, axis=0) / T
            acting[:, :, 2] = hands[:-1] + acting[:, :, 4] * lengths[0][:, None] * j
        found.append(acting)
    return found
