"""Hands whose damping changes from sample to sample, in exact time: the matrices of `in_time`, one for each damping."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace

import numpy as np
from device_arithmetic import DOUBLES
from device_pairs import real_of
from in_time import Environment, Loop
from random_devices import decades, ordinary, ordinary_gains
from random_hands import random_hands
from sampled_device_oracle import Hand as Held

from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.model.gains import Coupling
from vctune.model.hands import Hands
from vctune.proof.claims.margins_of_claims import Design


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


def lossless(rng: np.random.Generator, design: Design) -> Environment:
    """Return an environment that stores and does not lose: a mass, a spring or both, of the device's size."""
    mass, T = design.device.mass, design.device.sample_time
    numbers = mass * decades(rng, -3, 1), mass / T**2 * decades(rng, -5, 0)
    kind = int(rng.integers(3))
    return Environment(mass=numbers[0] * (kind != 0), stiffness=numbers[1] * (kind != 1))


def random_certified(rng: np.random.Generator, ratio: float = 1.05) -> tuple[Design, Hands]:
    """Return a random design of a rigid velocity loop with a least ratio over a box of hands, in floats."""
    while True:
        device = replace(
            ordinary(rng, held=0.0), hold="zoh", velocity=None, actuator=None, force_sensor=None, structure=None
        )
        gains, coupling = ordinary_gains(device, rng)
        hands = random_hands(rng, device)
        if gains.position == 0 or hands.high.mass == 0:
            continue
        if coupling.drag == 0:
            coupling = replace(coupling, drag=coupling.damping * decades(rng, -3, -0.5))
        least = least_ratios_in_hands(device, hands, gains, coupling)[0].ratio
        if 0 < least < np.inf:
            scaled = (float(f"{number * ratio / least:.9g}") for number in astuple(coupling))
            return Design(device, gains, Coupling(*scaled)), hands
