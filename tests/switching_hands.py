"""Hands whose damping changes from sample to sample, in exact time: the matrices of `in_time`, one for each damping."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, replace

import numpy as np
from device_arithmetic import DOUBLES
from device_pairs import real_of
from firmware import Device
from in_time import Environment, Loop
from random_devices import decades, ordinary, ordinary_gains
from random_hands import random_hands
from sampled_device_oracle import Hand as Held
from scipy.linalg import expm
from servo_in_time import Mass, Sampled, Servo, rendered

from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.model.gains import Coupling
from vctune.model.hands import Hands
from vctune.proof.claims.margins_of_claims import Design

Loops = Callable[[float, Sequence[float], float, Environment], np.ndarray]
"""The matrix of a sample for each damping, from the hand's mass, its dampings, its stiffness, and the environment."""


def matrices(
    design: Design, mass: float, dampings: Sequence[float], stiffness: float, environment: Environment
) -> np.ndarray:
    """Return the matrix of a sample for each damping of the hand, shape (dampings, n, n).

    The force that is sensed is that of the damping before, as the memory has it.
    """
    real, law = real_of(design.device), design.gains
    loops = (
        Loop(real, law, design.coupling, Held(mass, damping, stiffness), environment, DOUBLES) for damping in dampings
    )
    return np.array([loop.matrix() for loop in loops])


def answers(design: Design, hands: Sequence[Held], desired: Sequence[float]) -> list[float]:
    """Return y = Z_c v_e - f at each sample, N, of a device at rest in a hand that changes just after the samples.

    Parameters
    ----------
    design : a velocity loop
    hands : hand after each sample
    desired : v_e at each sample, m/s
    """
    real, gains, coupling, T = real_of(design.device), design.gains, design.series, design.device.sample_time
    soft = coupling.damping / (1 + coupling.damping * T / (2 * coupling.mass))
    memory, reached, mass_moves, found = np.zeros(Device(real, num=DOUBLES).size), 0.0, 0.0, []
    for hand, v_e in zip(hands, desired, strict=True):
        device = Device(real, hand, DOUBLES)
        found.append((coupling.drag + soft) * v_e - soft * mass_moves - float(device.force(memory)))
        error = reached + T / 2 * v_e - device.position(memory)
        command = gains.velocity * (v_e - device.velocity(memory)) + gains.position * error
        memory, reached = device.wait(memory, command), reached + T * v_e
        mass_moves += T / coupling.mass * soft * (v_e - mass_moves)
    return found


def least_energy(design: Design, hands: Sequence[Held]) -> float:
    """Return the least energy that a motion v_e supplies while the hand changes, relative to |y|; 0 or more if passive.

    The sum of all v_e y is a quadratic form of the samples of v_e. No environment at all is assumed.
    """
    units = np.eye(len(hands))
    form = np.array([answers(design, hands, unit) for unit in units]).T
    return float(np.linalg.eigvalsh(form + form.T).min() / np.abs(form).max())


def growth(steps: np.ndarray, sequences: np.ndarray) -> np.ndarray:
    """Return by how much the loop grows in a period of each of some sequences of dampings, repeated for ever."""
    product = np.broadcast_to(np.eye(steps.shape[-1]), (len(sequences), *steps.shape[1:]))
    for at in sequences.T:
        product = steps[at] @ product
    return np.abs(np.linalg.eigvals(product)).max(axis=1)


def greedy(steps: np.ndarray, rng: np.random.Generator, starts: int, length: int) -> np.ndarray:
    """Return sequences that take at each sample the damping after which a state is greatest, one for each start."""
    _, vectors = np.linalg.eig(steps[0])
    metric = np.linalg.pinv(np.vstack([vectors.T.real, vectors.T.imag]).T)
    state, found = rng.normal(size=(starts, steps.shape[-1])), []
    for _ in range(2 * length):
        after = np.einsum("bij,sj->sbi", steps, state)
        best = np.argmax(((after @ metric.T) ** 2).sum(axis=2), axis=1)
        state = after[np.arange(starts), best]
        state = state / np.linalg.norm(state, axis=1, keepdims=True)
        found.append(best)
    return np.array(found[length:]).T


def periodic(count: int, dwells: Sequence[int]) -> Iterator[np.ndarray]:
    """Yield one period of switching between the least and the greatest of some dampings, with each dwell time."""
    for one in dwells:
        for other in dwells:
            yield np.array([[0] * one + [count - 1] * other])


def lossless(rng: np.random.Generator, mass: float, T: float) -> Environment:
    """Return an environment that stores and does not lose: a mass, a spring or both, in units of a mass and a time."""
    numbers = mass * decades(rng, -3, 1), mass / T**2 * decades(rng, -5, 0)
    kind = int(rng.integers(3))
    return Environment(mass=numbers[0] * (kind != 0), stiffness=numbers[1] * (kind != 1))


def loops_of(design: Design) -> Loops:
    """Return the loops of a velocity loop with hands and environments."""
    return lambda *held: matrices(design, *held)


def servo_loops(servo: Servo, coupling: tuple[float, float, float]) -> Loops:
    """Return the loops of a servo with hands and environments: `servo_in_time.loop_matrix` with a force that is sensed.

    The memory is that of the servo, of coupling and environment, v_e before, and the force that was sensed. The
    sensor has no delay.
    """

    def loops(mass: float, dampings: Sequence[float], stiffness: float, environment: Environment) -> np.ndarray:
        world = Mass(environment.mass, environment.damping, environment.stiffness)
        E, F, G, H = (np.atleast_2d(part) for part in rendered(coupling, world, servo.sample_time))

        def matrix(damping: float) -> np.ndarray:
            held = Sampled(servo, Mass(mass, damping, stiffness))
            split = [held.size, held.size + len(E), held.size + len(E) + 1]

            def after(memory: np.ndarray) -> np.ndarray:
                body, virtual, (before,), (force,) = np.split(memory, split)
                desired = float((G @ virtual + H[:, 0] * force)[0])
                body = held.wait(body, (desired + before) / 2 if servo.position else desired)
                return np.concatenate([body, E @ virtual + F[:, 0] * force, [desired], [held.force(body)]])

            return np.array([after(unit) for unit in np.eye(split[-1] + 1)]).T

        return np.array([matrix(damping) for damping in dampings])

    return loops


def most_growth(
    rng: np.random.Generator,
    loops: Loops,
    hands: Hands,
    units: tuple[float, float],
    cases: int = 10,
    sequences: int = 1000,
    adversaries: int = 100,
) -> float:
    """Return the greatest growth in a period of random sequences of dampings, of greedy and of periodic ones.

    Parameters
    ----------
    rng : source of hands, environments and sequences
    loops : matrices of a sample for each damping
    hands : mass and stiffness stay, damping changes
    units : a mass, kg, and a time, s, for the environments
    cases : hands and environments
    sequences, adversaries : numbers of random and of greedy sequences in all cases together
    """
    dampings = np.linspace(hands.low.damping, hands.high.damping, 4)
    most = 0.0
    for _ in range(cases):
        ends = np.array([astuple(hands.low), astuple(hands.high)])
        mass, _, stiffness = rng.choice([*ends, rng.uniform(*ends)])
        steps = loops(mass, dampings, stiffness, lossless(rng, *units))
        at = rng.integers(4, size=(sequences // cases, int(rng.integers(2, 60))))
        adverse = greedy(steps, rng, adversaries // cases, 60)
        tried = [at, adverse, *periodic(4, (1, 2, 3, 6, 13))]
        most = max(most, *(float(growth(steps, each).max()) for each in tried))
    return most


def random_certified(rng: np.random.Generator, ratio: float = 1.05) -> tuple[Design, Hands]:
    """Return a random design of a velocity loop with a least ratio over a box of hands, in floats.

    Half of the devices are rigid and ideal, with K_p > 0. The others have parts, and some have no K_p.
    """
    while True:
        design, hands = random_with_parts(rng, ratio, ideal=rng.random() < 0.5)
        if design.gains.position > 0 or not design.device.ideal:
            return design, hands


def switching(rng: np.random.Generator, hands: Hands, length: int) -> list[Held]:
    """Return hands of a box whose damping changes at random samples between its ends; mass and stiffness stay."""
    ends = np.array([astuple(hands.low), astuple(hands.high)])
    mass, _, stiffness = rng.choice([*ends, rng.uniform(*ends)])
    return [Held(mass, damping, stiffness) for damping in rng.choice(ends[:, 1], length)]


def random_with_parts(rng: np.random.Generator, ratio: float = 1.05, *, ideal: bool = False) -> tuple[Design, Hands]:
    """Return such a design of a device with parts, or of an ideal one."""
    while True:
        device = replace(ordinary(rng, held=0.0), hold="zoh")
        if ideal:
            device = replace(device, velocity=None, actuator=None, force_sensor=None, structure=None)
        gains, coupling = ordinary_gains(device, rng)
        hands = random_hands(rng, device)
        if hands.high.mass == 0:
            continue
        if coupling.drag == 0:
            coupling = replace(coupling, drag=coupling.damping * decades(rng, -3, -0.5))
        least = least_ratios_in_hands(device, hands, gains, coupling)[0].ratio
        if 0 < least < np.inf:
            scaled = (float(f"{number * ratio / least:.9g}") for number in astuple(coupling))
            return Design(device, gains, Coupling(*scaled)), hands


def regripped(design: Design, stiffness: float, damping: float, world: float, samples: int) -> float:
    """Return by how much the loop grows from one grip to the next: the hand's spring is loose just after each.

    It takes hold where the handle is, just after the force is sampled, without mass; the world is a spring.
    """
    held, gripping = (_step(design, stiffness, damping, world, grips=grips) for grips in (False, True))
    period = np.linalg.matrix_power(held, samples - 1) @ gripping
    return float(np.abs(np.linalg.eigvals(period)).max())


def energy_of_cycle(design: Design, soft: float, stiff: float, reach: float, samples: int) -> float:
    """Return the energy that the port supplies in a slow cycle: out in the soft hand, back in the stiff one, J.

    The environment moves the loop in equal steps, and holds it still while the hand changes.
    """
    T, state, supplied = design.device.sample_time, np.zeros(4), 0.0
    motion = np.concatenate([np.full(samples, reach / samples / T), np.zeros(samples)])
    for v_e, stiffness in [(v, soft) for v in motion] + [(-v, stiff) for v in motion]:
        row = np.array(_port(design, stiffness))
        supplied -= T * v_e * float(row @ np.append(state, v_e))
        state = _driven(design, stiffness) @ np.append(state, v_e)
    return supplied


def _body(design: Design, stiffness: float, damping: float) -> np.ndarray:
    """Return the motion (x, v) after a sample from (x, v, command, where the hand holds)."""
    m, b, T = design.device.mass, design.device.damping, design.device.sample_time
    rates = np.array([[0, 1, 0, 0], [-stiffness / m, -(b + damping) / m, 1 / m, stiffness / m], [0] * 4, [0] * 4])
    return expm(T * rates)[:2]


def _step(design: Design, stiffness: float, damping: float, world: float, *, grips: bool) -> np.ndarray:
    """Return the matrix over (x, v, x_p, p_c, x_0), as in `in_time.Loop`; the hand holds at x_0, or takes hold at x."""
    T, gains, coupling = design.device.sample_time, design.gains, design.series
    x, v, x_p, p_c, x_0 = np.eye(5)
    soft = coupling.damping / (1 + coupling.damping * T / (2 * coupling.mass))
    force = -(damping * v + stiffness * (x - x_0))
    v_e = (force + soft * p_c - world * x_p) / (coupling.drag + soft + world * T / 2)
    command = gains.velocity * (v_e - v) + gains.position * (x_p + T / 2 * v_e - x)
    holds = x if grips else x_0
    moved = _body(design, stiffness, damping) @ np.array([x, v, command, holds])
    return np.array([*moved, x_p + T * v_e, p_c + T / coupling.mass * soft * (v_e - p_c), holds])


def _port(design: Design, stiffness: float) -> np.ndarray:
    """Return y = Z_c v_e - f over (x, v, x_p, p_c, v_e), in a hand that is a spring."""
    T, coupling = design.device.sample_time, design.series
    soft = coupling.damping / (1 + coupling.damping * T / (2 * coupling.mass))
    return np.array([stiffness, 0, 0, -soft, coupling.drag + soft])


def _driven(design: Design, stiffness: float) -> np.ndarray:
    """Return the next (x, v, x_p, p_c) over the same."""
    T, gains, coupling = design.device.sample_time, design.gains, design.series
    x, v, x_p, p_c, v_e = np.eye(5)
    soft = coupling.damping / (1 + coupling.damping * T / (2 * coupling.mass))
    command = gains.velocity * (v_e - v) + gains.position * (x_p + T / 2 * v_e - x)
    moved = _body(design, stiffness, 0.0) @ np.array([x, v, command, np.zeros(5)])
    return np.array([*moved, x_p + T * v_e, p_c + T / coupling.mass * soft * (v_e - p_c)])
