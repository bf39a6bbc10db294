"""Compute the motion that a simulated hand aims at, and the force with which the hand pushes a handle that rests.

The hand is a mass on the handle. A spring and a damper connect this mass to the intended motion x_i(t), which runs to
and fro between two ends (`vctune.model.experiment.Operator`). Between two samples, x_i is the cubic through the
positions with the velocities of both samples. The mechanics therefore need only four numbers of the intended motion for
each sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi

import numpy as np

from vctune.model.experiment import Operator
from vctune.model.numbers.arithmetic import Floats

RAMP = 0.1
"""Share of a stroke's time that a hand with the motion "reciprocate" takes at each end to gain or lose speed. A stroke
is the motion from one end to the other. Half this share doubles the acceleration, and the force that accelerates the
hand's mass becomes noticeable. With twice this share, less of the stroke has constant speed."""


@dataclass(frozen=True, slots=True)
class IntendedMotion:
    """The intended motion at consecutive samples.

    Attributes
    ----------
    position, velocity : x_i, m, and its derivative v_i, m/s, at each sample, shape (number of samples,)
    """

    position: Floats
    velocity: Floats


def stroke_time(operator: Operator) -> float:
    """Return the time of a stroke from one end of the intended motion to the other, s.

    The greatest speed of the stroke is `operator.speed`.
    """
    travel = abs(operator.end - operator.start)
    # a sine has the mean speed 2/pi; the ramps of the other motion have half its greatest speed
    mean_over_greatest = 1 - RAMP if operator.motion == "reciprocate" else 2 / pi
    return travel / (mean_over_greatest * operator.speed)


def sample_count(operator: Operator, sample_time: float) -> int:
    """Return the number of samples of a run: one at the start of each sample interval, and none at the end of the last.

    Parameters
    ----------
    operator : the hand, whose cycles make up the run; a cycle is two strokes
    sample_time : T, s

    Returns
    -------
    int
        At least 1. If the cycles take no whole number of samples, the last interval ends after them.
    """
    # a rounding above a whole number must not add a sample
    return max(1, ceil(2 * operator.cycles * stroke_time(operator) / sample_time * (1 - 1e-12)))


def intended_motion(operator: Operator, sample_time: float, first: int, last: int) -> IntendedMotion:
    """Return the intended motion at the samples `first` to `last`, both included.

    Parameters
    ----------
    operator : the hand
    sample_time : T, s
    first, last : indices of samples; sample 0 is the start of the run, at rest at `operator.start`

    Returns
    -------
    IntendedMotion
        Positions and velocities at last - first + 1 samples.
    """
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
    """Return the share of the travel at the share u of a stroke's time, and the derivative of that share.

    The derivative rises from 0 and falls back to 0 linearly over `RAMP` at each end, and is constant in between.
    """
    top = 1 / (1 - RAMP)
    to_nearer_end = np.minimum(u, 1 - u)
    rate = top * np.minimum(to_nearer_end / RAMP, 1.0)
    from_end = np.where(
        to_nearer_end < RAMP, top * to_nearer_end * to_nearer_end / (2 * RAMP), top * (to_nearer_end - RAMP / 2)
    )
    return np.where(u <= 0.5, from_end, 1 - from_end), rate


def push_matrix(operator: Operator, sample_time: float) -> Floats:
    """Return the matrix that gives the push of the hand at a sample, and its derivatives, from the intended motion.

    The push is the force of the hand's spring and damper on a handle that rests at 0: stiffness x_i + damping v_i. On a
    handle at x with velocity v, spring and damper exert the push less stiffness x + damping v
    (`vctune.simulation.mechanics.friction.Carriage`, `vctune.simulation.mechanics.assembly`).

    Parameters
    ----------
    operator : the hand
    sample_time : T, s

    Returns
    -------
    array of float
        Shape (4, 4). Rows: the push, N, and its first three derivatives, N/s, N/s^2, N/s^3. As x_i is a cubic, the push
        has no further derivatives. Columns: x_i, m, and v_i, m/s, at the sample, then both at the next sample.
    """
    T, k, b = sample_time, operator.stiffness, operator.damping
    # rows of the cubic's value and derivatives at the sample
    position = np.array([1.0, 0.0, 0.0, 0.0])
    velocity = np.array([0.0, 1.0, 0.0, 0.0])
    second = np.array([-6.0, -4.0 * T, 6.0, -2.0 * T]) / T**2
    third = np.array([12.0, 6.0 * T, -12.0, 6.0 * T]) / T**3
    return np.array([k * position + b * velocity, k * velocity + b * second, k * second + b * third, k * third])
