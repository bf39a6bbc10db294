"""Intervals that do not take correlated residuals for independent ones (README, section 2)."""

from __future__ import annotations

from math import erf, sqrt

import numpy as np

from vctune.document.recording import Floats

TOGETHER = 0.95
"""Probability that all the intervals of a box hold at once."""


def robust_covariance(scores: Floats, information: Floats, reach: int) -> Floats:
    """Return the covariance of estimates whose residuals are correlated (Newey and West).

    Parameters
    ----------
    scores : shape (n, p), residual times sensitivity, each row of a sample or line
    information : shape (p, p), of the sensitivities
    reach : how many rows residuals are correlated over

    Returns
    -------
    array of float
        Shape (p, p).
    """
    n = len(scores)
    size = 1 << (2 * n - 1).bit_length()
    spectra = np.fft.rfft(scores, size, axis=0)
    lags = np.arange(min(reach, n - 1) + 1)
    weights = 1 - lags / (lags[-1] + 1)
    p = scores.shape[1]
    middle = np.empty((p, p))
    for i in range(p):
        for j in range(i, p):
            crossed = np.fft.irfft(spectra[:, i] * np.conj(spectra[:, j]), size)
            both = crossed[lags] + np.where(lags > 0, crossed[-lags], 0.0)
            middle[i, j] = middle[j, i] = float(weights @ both)
    inverse = np.linalg.inv(information)
    return inverse @ middle @ inverse


def joint_factor(count: int) -> float:
    """Return how many standard deviations hold `count` numbers at once with probability `TOGETHER`; at least 2.

    Parameters
    ----------
    count : of numbers in the box
    """
    each = TOGETHER ** (1 / max(count, 1))
    low, high = 0.0, 10.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if erf(middle / sqrt(2)) < each else (low, middle)
    return max(2.0, high)
