"""Split delays into samples, and find what a force leaves that acts for a part of a sample."""

from __future__ import annotations

from math import floor

import numpy as np

from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, applied, column, exponential_less_one, scaled

# Difference from a whole number of samples, as a share of a sample, that the code treats as a rounding error
SNAP = 1e-12


def split_delay(delay: Number, sample_time: Number) -> tuple[Number, Number]:
    """Split a delay into whole samples and the remaining fraction of a sample."""
    if np.ndim(delay) > 0:
        split = [split_delay(float(one), sample_time) for one in delay]
        return np.array([whole for whole, _ in split]), np.array([fraction for _, fraction in split])
    samples = delay / sample_time
    nearest = round(samples)
    if abs(samples - nearest) <= SNAP * max(1.0, samples):
        return nearest, 0.0
    return floor(samples), samples - floor(samples)


def left_by_older(rates: Matrix, older: Number, ops: Arithmetic) -> Vector:
    """Return the change of the states over one sample per unit of a force that acts in its first part `older`."""
    early, late = (exponential_less_one(scaled(rates, time), ops) for time in (older, 1 - older))
    left = column(early, -1)
    return tuple(add(a, b) for a, b in zip(left, applied(late, left), strict=True))
