"""Compute the motion that a simulated hand aims at, and the force with which the hand pushes a handle that rests."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi

import numpy as np

from vctune.model.experiment import Operator
from vctune.model.numbers.arithmetic import Floats

RAMP = 0.1  # Share of a stroke's time that a hand with the motion "reciprocate" takes at each end to gain or lose speed


@dataclass(frozen=True, slots=True)
class IntendedMotion:
    """The intended motion at consecutive samples."""

    position: Floats  # x_i, m, and its derivative v_i, m/s, at each sample, shape (number of samples,)
    velocity: Floats


def stroke_time(operator: Operator) -> float:
    """Return the time of a stroke from one end of the intended motion to the other, s."""
    travel = abs(operator.end - operator.start)
    # a sine has the mean speed 2/pi; the ramps of the other motion have half its greatest speed
    mean_over_greatest = 1 - RAMP if operator.motion == "reciprocate" else 2 / pi
    return travel / (mean_over_greatest * operator.speed)


def sample_count(operator: Operator, sample_time: float) -> int:
    """Return the number of samples of a run: one at the start of each sample interval, and none at the end of the
    last."""
    # a rounding above a whole number must not add a sample
    return max(1, ceil(2 * operator.cycles * stroke_time(operator) / sample_time * (1 - 1e-12)))


def intended_motion(operator: Operator, sample_time: float, first: int, last: int) -> IntendedMotion:
    """Return the intended motion at the samples `first` to `last`, both included."""
    time, travel = stroke_time(operator), operator.end - operator.start
    strokes = np.arange(first, last + 1) * (sample_time / time)  # number of strokes since the start
    phase = np.mod(strokes, 2.0)  # 0 to 1 from start to end, 1 to 2 back
    back = phase > 1
    from_start = np.where(back, 2 - phase, phase)
    if operator.motion == "sine":
        share, rate = (1 - np.cos(pi * from_start)) / 2, pi / 2 * np.sin(pi * from_start)
    else:
        share, rate = _ramped(from_start)
    return IntendedMotion(operator.start + travel * share, np.where(back, -1.0, 1.0) * rate * (travel / time))


def _ramped(u: Floats) -> tuple[Floats, Floats]:
    """Return the share of the travel at the share u of a stroke's time, and the derivative of that share."""
    top = 1 / (1 - RAMP)
    to_nearer_end = np.minimum(u, 1 - u)
    rate = top * np.minimum(to_nearer_end / RAMP, 1.0)
    from_end = np.where(
        to_nearer_end < RAMP, top * to_nearer_end * to_nearer_end / (2 * RAMP), top * (to_nearer_end - RAMP / 2)
    )
    return np.where(u <= 0.5, from_end, 1 - from_end), rate


def push_matrix(operator: Operator, sample_time: float) -> Floats:
    """Return the matrix that gives the push of the hand at a sample, and its derivatives, from the intended motion."""
    T, k, b = sample_time, operator.stiffness, operator.damping
    # rows of the cubic's value and derivatives at the sample
    position = np.array([1.0, 0.0, 0.0, 0.0])
    velocity = np.array([0.0, 1.0, 0.0, 0.0])
    second = np.array([-6.0, -4.0 * T, 6.0, -2.0 * T]) / T**2
    third = np.array([12.0, 6.0 * T, -12.0, 6.0 * T]) / T**3
    return np.array([k * position + b * velocity, k * velocity + b * second, k * second + b * third, k * third])
