"""A device with all its parts from event to event, not from vctune: plain rates, and solvers that know nothing of them.

An event is a command that arrives at the motor, a moment at which the force sensor looks, or a sample. Between two the
motion goes on by scipy: matrix exponentials without friction, LSODA with it. Only the firmware is the simulation's own,
in floats (`test_simulation` and the oracles of the loop hold that).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import exp, pi, sqrt

import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from vctune.model.device import Device
from vctune.model.experiment import Friction, MovingHand
from vctune.simulation.controller import FLOATS, Measurement, at_rest, control, controller_of
from vctune.simulation.scene import Scene, equilibrium, intended_motion

SIZE = 9
"""Motor x and v, bend, handle's v, drive and its rate, sensed and its rate, bristles: all of them always there."""
RECORDED = ("position", "velocity", "force", "motor", "motor_position", "motor_velocity")


@dataclass(frozen=True)
class Body:
    """Device, hand and friction."""

    device: Device
    hand: MovingHand
    friction: Friction | None

    def rates(self, y: np.ndarray, command: float, push: float) -> tuple[np.ndarray, float, float]:
        """Return dy/dt, the hand's force, and what the sensor has of it at once, N."""
        device, hand = self.device, self.hand
        x, v, bend, handle_v, drive, drive_rate, sensed, sensed_rate, z = y
        motor, drive_rates = low_passed(device.actuator, command, drive, drive_rate)
        rubbing, creep = self.rubbed(v, z)
        if device.structure is None:
            free = push - hand.stiffness * x - hand.damping * v
            at_handle = acceleration = (motor + free - device.damping * v - rubbing) / (device.mass + hand.mass)
            bending = 0.0
        else:
            m_2 = device.structure.handle_mass
            m_1, omega = device.mass - m_2, 2 * pi * device.structure.frequency_hz
            mu = m_1 * m_2 / device.mass
            bending = handle_v - v
            spring = mu * omega**2 * bend + 2 * device.structure.damping_ratio * mu * omega * bending
            free = push - hand.stiffness * (x + bend) - hand.damping * handle_v
            acceleration = (motor + spring - device.damping * v - rubbing) / m_1
            at_handle = (free - spring) / (m_2 + hand.mass)
        force = free - hand.mass * at_handle
        handle_rate = 0.0 if device.structure is None else at_handle
        read, sensed_rates = low_passed(device.force_sensor, force, sensed, sensed_rate)
        return np.array([v, acceleration, bending, handle_rate, *drive_rates, *sensed_rates, creep]), force, read

    def rubbed(self, v: float, z: float) -> tuple[float, float]:
        """Return the friction, N, and the bristles' rate, m/s."""
        if self.friction is None:
            return 0.0, 0.0
        f = self.friction
        g = f.coulomb + (f.stiction - f.coulomb) * exp(-((v / f.stribeck_velocity) ** 2))
        creep = v - f.stiffness * abs(v) / g * z
        return f.stiffness * z + f.damping / (1 + f.damping * abs(v) / (4 * f.coulomb)) * creep, creep

    def handle(self, y: np.ndarray) -> tuple[float, float]:
        """Return the handle's position and velocity, m and m/s."""
        return (y[0], y[1]) if self.device.structure is None else (y[0] + y[2], y[3])


def low_passed(part, source: float, value: float, rate: float) -> tuple[float, tuple[float, float]]:
    """Return what a part makes of a signal, and the rates of its two states."""
    if part is None or part.bandwidth_hz is None:
        return source, (0.0, 0.0)
    w = 2 * pi * part.bandwidth_hz
    if part.order == 1:
        return value, (w * (source - value), 0.0)
    return value, (rate, w * w * (source - value) - sqrt(2) * w * rate)


@lru_cache(maxsize=64)
def response(body: Body, time: float) -> np.ndarray:
    """Return e^(A time) over y, command, and the push with its three derivatives."""
    size = SIZE + 5
    A = np.zeros((size, size))
    for k, one in enumerate(np.eye(size)):
        A[:SIZE, k] = body.rates(one[:SIZE], one[SIZE], one[SIZE + 1])[0]
    A[[-4, -3, -2], [-3, -2, -1]] = 1.0
    return scipy.linalg.expm(A * time)


def exactly(body: Body, y: np.ndarray, command: float, push: CubicHermiteSpline, begin: float, time: float):
    """Return y after some time, without friction."""
    derivatives = [push(begin, order) for order in range(4)]
    return (response(body, time) @ np.array([*y, command, *derivatives]))[:SIZE]


def stiffly(body: Body, y: np.ndarray, command: float, push: CubicHermiteSpline, begin: float, time: float):
    """Return y after some time, by LSODA."""

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return body.rates(y, command, float(push(begin + t)))[0]

    tolerance = {"rtol": 1e-10, "atol": 1e-14}
    return solve_ivp(rates, (0.0, time), y, method="LSODA", first_step=time * 1e-6, **tolerance).y[:, -1]


def simulate(scene: Scene, samples: int) -> dict[str, np.ndarray]:
    """Return what a run records, from the equilibrium in which it starts."""
    device, hand = scene.device, scene.operator
    body, solver = Body(device, hand, scene.friction), stiffly if scene.friction else exactly
    T, delay = Fraction(str(device.sample_time)), Fraction(str(device.delay))
    late = Fraction(str(device.force_sensor.delay)) if device.force_sensor else Fraction(0)
    path = intended_motion(hand, device.sample_time, 0, samples + 1)
    wanted = CubicHermiteSpline(np.arange(samples + 2) * device.sample_time, path.position, path.velocity)
    push = Pushed(wanted, hand)
    begin, c = equilibrium(scene), controller_of(scene.law)
    y, command, now, felt = np.zeros(SIZE), begin.motor, Fraction(0), {}
    y[[0, 2, 4, 6]] = begin.position, begin.bend, begin.motor, begin.hand
    state = at_rest(c, begin.sensed(device), begin.reference)
    events = [(k * T - late, 0, k, 0.0) for k in range(samples)] + [(k * T, 1, k, 0.0) for k in range(samples)]
    heapq.heapify(events)
    out: dict[str, list[float]] = {name: [] for name in RECORDED}
    while events and len(out["motor"]) < samples:
        time, kind, k, value = heapq.heappop(events)
        if time > now:
            y, now = solver(body, y, command, push, float(now), float(time - now)), time
        _, force, read = body.rates(y, command, float(push(float(now))))
        if kind == 0:  # the sensor looks for sample k
            felt[k] = read if time >= 0 else begin.hand
        elif kind == 1:
            seen = body.handle(y) if device.at_handle else (y[0], y[1])
            state, given = control(c, state, Measurement(*seen, felt[k]), FLOATS)
            heapq.heappush(events, (time + delay, 2, k, given.given))
            for name, number in zip(RECORDED, (*body.handle(y), force, given.given, y[0], y[1]), strict=True):
                out[name].append(number)
        else:
            command = value
    return {name: np.array(values) for name, values in out.items()}


@dataclass(frozen=True)
class Pushed:
    """The force of the hand's spring and damper if the handle stood still at 0, and its derivatives, N."""

    wanted: CubicHermiteSpline
    hand: MovingHand

    def __call__(self, time: float, order: int = 0) -> float:
        """Return a derivative at a time; at a node that of the piece that begins there."""
        x = self.wanted
        faster = x(time, order + 1) if order < 3 else 0.0
        return float(self.hand.stiffness * x(time, order) + self.hand.damping * faster)
