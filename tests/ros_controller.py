"""A ROS 2 admittance_controller around a servo in a hand, stepped as its source does: shares nothing with vctune.

Each control period the controller smooths the sensed force, adds up the acceleration (f - D v - S x)/M - j v to its
velocity, of the velocity of the period before, and the velocity to its position, x being the measured position. What it
commands, a held velocity or a position that the arm interpolates, is the same motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, pi, sqrt

import numpy as np
from scipy.linalg import expm


@dataclass(frozen=True)
class Arm:
    """A servo and its force sensor."""

    T: float
    delay: float
    hz: float
    order: int = 1
    sensor_hz: float | None = None
    sensor_order: int = 1
    sensor_delay: float = 0.0


@dataclass(frozen=True)
class Rule:
    """What the controller is told of one axis."""

    mass: float
    damping_ratio: float
    stiffness: float
    joint_damping: float
    filter_coefficient: float


class Held:
    """An arm in a hand (mass, damping, stiffness), from command to command."""

    def __init__(self, arm, hand):
        self.arm, self.hand = arm, hand
        names = ["x", *["v", "v'"][: arm.order], *(["y", "y'"][: arm.sensor_order] if arm.sensor_hz else []), "u"]
        self.at = {name: i for i, name in enumerate(names)}
        self.n = len(names) - 1
        rows = np.zeros((self.n + 1, self.n + 1))
        rows[self.at["x"], self.at["v"]] = 1.0
        unit = np.eye(self.n + 1)
        self._low_pass(rows, "v", arm.order, 2 * pi * arm.hz, unit[self.at["u"]])
        mass, damping, stiffness = hand
        self.force = -(mass * rows[self.at["v"]] + damping * unit[self.at["v"]] + stiffness * unit[self.at["x"]])
        if arm.sensor_hz:
            self._low_pass(rows, "y", arm.sensor_order, 2 * pi * arm.sensor_hz, self.force)
            self.force = unit[self.at["y"]]
        self.rates = rows
        self.older = floor(arm.delay / arm.T + 1e-9) + 1  # commands that are still on their way
        self.late = arm.delay - (self.older - 1) * arm.T
        self.sensor_older = floor(arm.sensor_delay / arm.T + 1e-9)
        self.before = arm.sensor_delay - self.sensor_older * arm.T
        self.size = self.n + self.older + self.sensor_older + 1

    def _low_pass(self, rows, name, order, corner, source):
        at = self.at[name]
        unit = np.eye(len(rows))
        if order == 1:
            rows[at] = corner * (source - unit[at])
        else:
            rows[at] = unit[at + 1]
            rows[at + 1] = corner**2 * (source - unit[at]) - sqrt(2) * corner * unit[at + 1]

    def _over(self, seconds, states, command):
        moved = expm(self.rates * seconds) @ np.append(states, command)
        return moved[: self.n]

    def _until(self, offset, states, first, second):
        """Return the states at a time in a period, and the command that acts just before it."""
        if offset <= self.late:
            return self._over(offset, states, first), first
        return self._over(offset - self.late, self._over(self.late, states, first), second), second

    def sensed(self, memory):
        return memory[self.n + self.older + self.sensor_older]

    def position(self, memory):
        return memory[self.at["x"]]

    def advance(self, memory, command):
        """Return the memory a period later: states, commands on their way, the newest first, and what was sensed."""
        states, rest = memory[: self.n], memory[self.n :]
        commands, felt = [command, *rest[: self.older]], rest[self.older :]
        first, second = commands[self.older], commands[self.older - 1]
        at_sensing, acting = self._until(self.arm.T - self.before, states, first, second)
        force = float(self.force @ np.append(at_sensing, acting))
        states, _ = self._until(self.arm.T, states, first, second)
        return np.concatenate([states, commands[: self.older], [force], felt[: self.sensor_older]])

    def matrices(self):
        """Return A and B of memory' = A memory + B command."""
        A = np.array([self.advance(unit, 0.0) for unit in np.eye(self.size)]).T
        return A, self.advance(np.zeros(self.size), 1.0)


@dataclass(frozen=True)
class World:
    """What else is rendered, by the trapezoidal rule: a spring, N/m, or a mass, kg, with a damper beside it."""

    kind: str = "spring"
    value: float = 0.0
    damping: float = 0.0


def loop_matrix(arm, hand, rule, world=None, push=None):
    """Return what a period does to memory of the arm, velocity, smoothed force and what the world remembers.

    With `push`, of shape (n,), it is filled with what a force in the controller does.
    """
    held, world, T = Held(arm, hand), world or World(), arm.T
    A, B = held.matrices()
    n = held.size
    unit = np.eye(n + 3)
    force, position, v, f, kept = unit[n - 1], unit[held.at["x"]], unit[n], unit[n + 1], unit[n + 2]
    damping = 2 * rule.damping_ratio * sqrt(rule.mass * rule.stiffness)
    smooth = (1 - rule.filter_coefficient) * f + rule.filter_coefficient * force
    free = v + T * ((smooth - damping * v - rule.stiffness * position) / rule.mass - rule.joint_damping * v)
    if world.kind == "spring":  # kept is its deflection
        own, rest = world.value * T / 2 + world.damping, world.value * (kept + T / 2 * v)
    else:  # kept is its force
        own, rest = world.value * 2 / T + world.damping, -world.value * 2 / T * v - kept
    share = 1 / (1 + T / rule.mass * own)
    after = share * (free - T / rule.mass * rest)
    matrix = np.zeros((n + 3, n + 3))
    matrix[:n, :n] = A
    matrix[:n] += np.outer(B, after)
    matrix[n], matrix[n + 1] = after, smooth
    spring = kept + T / 2 * (v + after)
    matrix[n + 2] = spring if world.kind == "spring" else world.value * 2 / T * (after - v) - kept
    if push is not None:
        push[:] = 0.0
        push[:n], push[n] = B * share * T / rule.mass, share * T / rule.mass
    return matrix


def radius(arm, hand, rule, world=None):
    return float(abs(np.linalg.eigvals(loop_matrix(arm, hand, rule, world))).max())


def asked(arm, hand, rule, theta):
    """Return a force in the controller over the velocity that it commands then, at an angle."""
    push = np.zeros(Held(arm, hand).size + 3)
    matrix, z = loop_matrix(arm, hand, rule, push=push), np.exp(1j * theta)
    state = np.linalg.solve(z * np.eye(len(push)) - matrix, push.astype(complex))
    return 1 / (z * state[len(push) - 3])
