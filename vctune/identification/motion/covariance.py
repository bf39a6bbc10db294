"""Compute intervals for correlated residuals (README, section 2)."""

from __future__ import annotations

from math import erf, sqrt
from typing import Protocol

import numpy as np

from vctune.document.recording import Floats

TOGETHER = 0.95  # Probability with which all intervals of a box hold at the same time
BLOCK = 1 << 16  # Number of rows that the code sums in one operation


class Scores(Protocol):
    """Residual times sensitivity, shape (n, p), with one row per sample or line. The scores are an array, or an object
    that computes its rows on demand."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, rows: slice, /) -> Floats: ...


def robust_covariance(scores: Scores, information: Floats, reach: int) -> Floats:
    """Return the covariance of estimates whose residuals are correlated (Newey and West)."""
    n, p = scores.shape
    window = min(reach, n - 1) + 1
    middle = np.zeros((p, p))
    # products of sums over a moving window give Bartlett's weights; some windows extend beyond the ends of the rows
    for first in range(0, n + window - 1, BLOCK):
        ends = np.arange(first, min(first + BLOCK, n + window - 1)) + 1
        low, high = max(first + 1 - window, 0), min(int(ends[-1]), n)
        summed = np.zeros((high - low + 1, p))
        np.cumsum(scores[low:high], axis=0, out=summed[1:])
        within = summed[np.minimum(ends, high) - low] - summed[np.maximum(ends - window, low) - low]
        middle += within.T @ within / window
    inverse = np.linalg.inv(information)
    return np.asarray(inverse @ middle @ inverse)


def least_squares(sensitivity: Floats, measured: Floats) -> Floats:
    """Return the least-squares solution, as NumPy does, but without copying a long table."""
    count = sensitivity.shape[1]
    triangle = np.zeros((0, count + 1))
    for first in range(0, len(measured), BLOCK):
        rows = slice(first, first + BLOCK)
        block = np.column_stack([sensitivity[rows], measured[rows]])
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, block]), mode="r"))
    return np.asarray(np.linalg.lstsq(triangle[:, :count], triangle[:, count], rcond=None)[0])


def joint_factor(count: int) -> float:
    """Return the number of standard deviations with which `count` intervals hold together with probability
    `TOGETHER`."""
    probability = TOGETHER ** (1 / max(count, 1))
    low, high = 0.0, 10.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if erf(middle / sqrt(2)) < probability else (low, middle)
    return max(2.0, high)
