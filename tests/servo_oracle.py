"""A servo in a hand, by matrix exponentials and in exact time; nothing of it is from vctune.

The servo follows first, the hand's force M a + B v + K x is formed of its motion, and the sensor filters that force and
is late by itself: nothing commutes here that vctune commutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np
from scipy.linalg import block_diag, expm


@dataclass(frozen=True)
class Follower:
    """Its sample time, delay and low-pass, whether its command is a position, and its sensor's low-pass and delay."""

    sample_time: float
    delay: float
    bandwidth_hz: float
    order: int = 1
    position: bool = False
    sensor_hz: float | None = None
    sensor_order: int = 1
    sensor_delay: float = 0.0

    @property
    def latency(self) -> float:
        """Time by which the force of a spring is late at rest."""
        lag = {1: 1.0, 2: math.sqrt(2)}
        late = self.sample_time * (1.0 if self.position else 0.5) + self.delay + self.sensor_delay
        late += lag[self.order] / (2 * math.pi * self.bandwidth_hz)
        return late + (lag[self.sensor_order] / (2 * math.pi * self.sensor_hz) if self.sensor_hz else 0.0)


@dataclass(frozen=True)
class Grip:
    """A hand, mass, damping and stiffness."""

    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0


def low_pass(hertz: float, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A and b of y' = ..., y being the first state."""
    w = 2 * math.pi * hertz
    if order == 1:
        return np.array([[-w]]), np.array([w])
    return np.array([[0.0, 1.0], [-w * w, -math.sqrt(2) * w]]), np.array([0.0, w * w])


def body(servo: Follower, hand: Grip) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return A, b, c and d from the late velocity command to the sensed force; the first state is the position."""
    A_h, b_h = low_pass(servo.bandwidth_hz, servo.order)
    n = len(b_h) + 1
    A, b = np.zeros((n, n)), np.zeros(n)
    A[1:, 1:], b[1:] = A_h, b_h
    A[0, 1] = 1.0
    c = hand.mass * A[1] + hand.damping * np.eye(n)[1] + hand.stiffness * np.eye(n)[0]
    d = hand.mass * b[1]
    if servo.sensor_hz is None:
        return A, b, c, d
    A_s, b_s = low_pass(servo.sensor_hz, servo.sensor_order)
    both = block_diag(A, A_s)
    both[n:, :n] = np.outer(b_s, c)
    return both, np.concatenate((b, b_s * d)), np.eye(len(both))[n], 0.0


def over(A: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return e^(A t), and what a held input leaves."""
    n = len(b)
    joined = np.zeros((n + 1, n + 1))
    joined[:n, :n], joined[:n, n] = A, b
    step = expm(joined * time)
    return step[:n, :n], step[:n, n]


def split(delay: float, sample_time: float) -> tuple[int, float]:
    """Return the whole samples of a decimal, and the rest in seconds."""
    whole, rest = divmod(Fraction(repr(delay)), Fraction(repr(sample_time)))
    return int(whole), float(rest)


def seen(servo: Follower, hand: Grip, theta: np.ndarray) -> np.ndarray:
    """Return Z_seen at z = e^(j theta): the force is read a sensor's delay ago, just before the next command acts."""
    A, b, c, d = body(servo, hand)
    T, z = servo.sample_time, np.exp(1j * np.asarray(theta, float))
    N, rest = split(servo.delay, T)
    (whole, _), (early, left), (after, right) = over(A, b, T), over(A, b, rest), over(A, b, T - rest)
    assert np.allclose(after @ early, whole)
    old, new = z ** (-N - 1), z**-N
    pushed = np.multiply.outer(old, after @ left) + np.multiply.outer(new, right)
    x = np.linalg.solve(z[..., None, None] * np.eye(len(b)) - whole, pushed[..., None])[..., 0]
    ago, more = split(servo.sensor_delay, T)
    if more > 0:  # read at (k - ago - 1) T + (T - more)
        ago, since = ago + 1, T - more
        on, left = over(A, b, min(since, rest))
        x, command = x @ on.T + np.multiply.outer(old, left), old
        if since > rest * (1 + 1e-12):
            on, left = over(A, b, since - rest)
            x, command = x @ on.T + np.multiply.outer(new, left), new
    else:
        command = old
    found = (x @ c + d * command) / z**ago
    return found * (1 + 1 / z) / 2 if servo.position else found


@dataclass(frozen=True)
class Virtual:
    """A coupling with its environment: damping and mass in series and a drag; mass, damping and stiffness beside it."""

    damping: float
    mass: float
    drag: float
    heavy: float = 0.0
    viscous: float = 0.0
    stiff: float = 0.0


def coupling(virtual: Virtual, sample_time: float, theta: np.ndarray) -> np.ndarray:
    """Return Z_c by the trapezoidal rule."""
    s = 2j / sample_time * np.tan(np.asarray(theta) / 2)
    if math.isinf(virtual.damping):
        return virtual.drag + virtual.mass * s
    return virtual.drag + virtual.damping * virtual.mass * s / (virtual.damping + virtual.mass * s)


def radius(servo: Follower, hand: Grip, virtual: Virtual) -> float:
    """Return the spectral radius of one sample of everything; both delays are the command's."""
    A, b, c, d = body(servo, hand)
    if hand.stiffness == 0:  # nothing depends on where it is
        A, b, c = A[1:, 1:], b[1:], c[1:]
    T, n = servo.sample_time, len(b)
    total = Fraction(repr(servo.delay)) + Fraction(repr(servo.sensor_delay))
    whole, rest = divmod(total, Fraction(repr(T)))
    N, rest = int(whole), float(rest)
    (early, left), (after, right) = over(A, b, rest), over(A, b, T - rest)
    damper = virtual.damping
    soft = 2 * virtual.mass / T if math.isinf(damper) else damper / (1 + damper * T / (2 * virtual.mass))
    hard, grip = 2 * virtual.heavy / T, virtual.stiff * T / 2
    # body, commands u[k - N - 1] .. u[k - 1], v[k - 1], coupling's mass, environment's mass and spring
    size = n + N + 1 + 4

    def after_one(memory: np.ndarray) -> np.ndarray:
        x, wait = memory[:n], memory[n : n + N + 1]
        before, p_c, p_e, x_e = memory[n + N + 1 :]
        force = -(c @ x + d * wait[0])
        v = (force + soft * p_c + hard * p_e - virtual.stiff * x_e) / (
            virtual.drag + soft + hard + virtual.viscous + grip
        )
        command = (v + before) / 2 if servo.position else v
        queue = [*wait, command]
        x = after @ (early @ x + left * queue[0]) + right * queue[1]
        p_c = p_c + T / virtual.mass * soft * (v - p_c)
        return np.concatenate((x, queue[1:], [v, p_c, 2 * v - p_e if virtual.heavy else 0.0, x_e + T * v * (grip > 0)]))

    step = np.column_stack([after_one(unit) for unit in np.eye(size)])
    return float(np.abs(np.linalg.eigvals(step)).max())


def vertices(low: Grip, high: Grip) -> list[Grip]:
    """Return the hands at the vertices of a box."""
    return [Grip(*ends) for ends in product(*zip(vars(low).values(), vars(high).values(), strict=True))]


class Need:
    """R less Re Z_c without drag over the vertices of a box: what is left for the drag."""

    def __init__(self, servo: Follower, low: Grip, high: Grip, virtual: Virtual) -> None:
        self.servo, self.virtual = servo, virtual
        self.corners = np.array([[*vars(hand).values()] for hand in vertices(low, high)])

    def each(self, theta: np.ndarray) -> np.ndarray:
        """Return it at angles > 0, of shape (vertices, angles)."""
        units = [seen(self.servo, Grip(*unit), theta).real for unit in np.eye(3)]
        return -self.corners @ units - (coupling(self.virtual, self.servo.sample_time, theta).real - self.virtual.drag)

    def __call__(self, theta: np.ndarray) -> np.ndarray:
        """Return it in the worst of them."""
        return self.each(theta).max(axis=0)

    @property
    def at_rest(self) -> float:
        """What it tends to at 0 Hz."""
        return float((self.corners @ [0.0, -1.0, self.servo.latency]).max())

    def most(self) -> tuple[float, float]:
        """Return its greatest value and the angle of it."""
        turns = (self.servo.delay + self.servo.sensor_delay) / self.servo.sample_time + 1
        theta = np.unique(
            np.concatenate((np.geomspace(1e-3, math.pi, 1500), np.linspace(0.01, math.pi, int(60 * turns) + 500)))
        )
        found, best = self(theta), (self.at_rest, 0.0)
        for place in np.argsort(found)[-8:]:
            low, high = theta[max(place - 1, 0)], theta[min(place + 1, len(theta) - 1)]
            for _ in range(5):
                closer = np.linspace(low, high, 21)
                values = self(closer)
                at = int(values.argmax())
                low, high = closer[max(at - 1, 0)], closer[min(at + 1, 20)]
            best = max(best, (float(values[at]), float(closer[at])))
        return best
