"""Compute the intended motion: the target of the hand at each sample, and a cubic between samples."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from vctune.model.experiment import Operator

Floats = NDArray[np.float64]
RAMP = 0.1
"""Share of a stroke's time that the hand takes at each end to gain or lose speed. Half this share doubles the
acceleration, and the force that accelerates the hand's mass becomes noticeable. With twice this share, less of the
stroke has constant speed."""


@dataclass(frozen=True, slots=True)
class IntendedMotion:
    """Positions [m] and velocities [m/s] of the intended motion at the sample times."""

    position: Floats
    velocity: Floats


def stroke_time(operator: Operator) -> float:
    """Return the time of a stroke from one end to the other, s.

    The greatest speed of the stroke is `operator.speed`. The mean speed of a sine is 2/pi of its greatest speed.
    """
    travel = abs(operator.end - operator.start)
    mean_over_greatest = 1 - RAMP if operator.motion == "reciprocate" else 2 / pi
    return travel / (mean_over_greatest * operator.speed)


def sample_count(operator: Operator, sample_time: float) -> int:
    """Return the number of sample intervals of an experiment.

    Parameters
    ----------
    operator : the hand, whose cycles make up the experiment
    sample_time : T, s
    """
    return max(1, ceil(2 * operator.cycles * stroke_time(operator) / sample_time * (1 - 1e-12)))


def intended_motion(operator: Operator, sample_time: float, first: int, last: int) -> IntendedMotion:
    """Return the intended motion at the samples `first` to `last`, both included.

    Parameters
    ----------
    operator : the hand
    sample_time : T, s
    first, last : indices of samples, from 0

    Returns
    -------
    IntendedMotion
        Positions and velocities, last - first + 1 of each.
    """
    stroke = stroke_time(operator)
    strokes = np.arange(first, last + 1) * (sample_time / stroke)
    phase, travel = np.mod(strokes, 2.0), operator.end - operator.start
    back = phase > 1
    local = np.where(back, 2 - phase, phase)
    if operator.motion == "sine":
        place, rate = (1 - np.cos(pi * local)) / 2, pi / 2 * np.sin(pi * local)
    else:
        place, rate = _ramped(local)
    return IntendedMotion(operator.start + travel * place, np.where(back, -1.0, 1.0) * rate * (travel / stroke))


def _ramped(u: Floats) -> tuple[Floats, Floats]:
    """Return the position, which runs from 0 to 1 for u from 0 to 1, and its rate, constant except near the ends."""
    top = 1 / (1 - RAMP)
    end = np.minimum(u, 1 - u)
    rate = top * np.minimum(end / RAMP, 1.0)
    from_end = np.where(end < RAMP, top * end * end / (2 * RAMP), top * (end - RAMP / 2))
    return np.where(u <= 0.5, from_end, 1 - from_end), rate


def hand_force_derivatives(operator: Operator, sample_time: float) -> Floats:
    """Return the matrix from (x, v, x', v') of two samples to the hand's push and the push's three derivatives at the
    first sample.

    The push is stiffness x_i + damping v_i, where x_i is the cubic with these positions and velocities. It is the force
    on a handle that rests at 0; the carriage subtracts what the motion of the handle changes.

    Parameters
    ----------
    operator : the hand
    sample_time : T, s

    Returns
    -------
    array of float
        Shape (4, 4): rows for N, N/s, N/s^2 and N/s^3, columns for m, m/s, m, m/s.
    """
    T, k, b = sample_time, operator.stiffness, operator.damping
    position = np.array([1.0, 0.0, 0.0, 0.0])
    velocity = np.array([0.0, 1.0, 0.0, 0.0])
    second = np.array([-6.0, -4.0 * T, 6.0, -2.0 * T]) / T**2
    third = np.array([12.0, 6.0 * T, -12.0, 6.0 * T]) / T**3
    return np.array([k * position + b * velocity, k * velocity + b * second, k * second + b * third, k * third])
