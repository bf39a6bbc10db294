"""Compute the motion of a rigid device and the hand between two samples, without friction (model/README.md, section
7)."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log2

import numpy as np

from vctune.model.numbers.arithmetic import Floats
from vctune.model.sampled.velocity_loop import split_delay
from vctune.simulation.mechanics.intended_motion import push_matrix
from vctune.simulation.scene import Scene


@dataclass(frozen=True, slots=True)
class Timing:
    """The commands that act after sample k, up to the next sample: u[k-N-1] for `early` seconds, then u[k-N]."""

    whole_samples: int  # N, the number of whole samples in the delay
    early: float  # durations of the two commands, s; early is 0 if the delay is a whole number of samples
    late: float


def timing(scene: Scene) -> Timing:
    """Return the timing of a scene's commands. The hold is the real zero-order hold, whatever the device's `hold`."""
    T = scene.device.sample_time
    whole, fraction = split_delay(scene.device.latency, T)
    return Timing(whole, fraction * T, T - fraction * T)


@dataclass(frozen=True, slots=True)
class Transition:
    """The state after a sample: state @ before + early u_early + late u_late + motion @ (x_i, v_i, x_i', v_i')."""

    state: Floats
    early: Floats
    late: Floats
    motion: Floats


def transition(scene: Scene) -> Transition:
    """Return the exact transition over one sample of a scene without friction whose device and hand move as one
    mass."""
    when, carriage = timing(scene), scene.carriage
    # x, v, motor's force, the hand's push and its three derivatives
    rates = np.zeros((7, 7))
    rates[0, 1] = 1.0
    rates[1, :4] = np.array([-carriage.stiffness, -carriage.damping, 1.0, 1.0]) / carriage.mass
    rates[[3, 4, 5], [4, 5, 6]] = 1.0
    early, late = exponential(rates * when.early), exponential(rates * when.late)
    push = push_matrix(scene.operator, scene.device.sample_time)
    return Transition(
        state=late[:2, :2] @ early[:2, :2],
        early=late[:2, :2] @ early[:2, 2],
        late=late[:2, 2],
        motion=(late[:2, :2] @ early[:2, 3:] + late[:2, 3:] @ early[3:, 3:]) @ push,
    )


def exponential(matrix: Floats) -> Floats:
    """Return e^matrix of a small matrix."""
    return np.eye(len(matrix)) + exponential_less_one(matrix)


def exponential_less_one(matrix: Floats) -> Floats:
    """Return e^matrix - 1 of a small matrix, by scaling, Taylor's series and squaring."""
    norm = float(np.abs(matrix).sum(axis=1).max())
    # halved to a norm of at most 1/4, at which the series to order 17 is exact to rounding
    halvings = max(0, ceil(log2(norm)) + 2) if norm > 0 else 0
    scaled = matrix / 2.0**halvings
    excess = term = scaled
    for order in range(2, 18):
        term = term @ scaled / order
        excess = excess + term
    for _ in range(halvings):
        excess = 2 * excess + excess @ excess
    return excess
