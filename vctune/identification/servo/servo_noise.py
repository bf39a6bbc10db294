"""Model the noise of a servo's log, which comes from an encoder and from a communication link with jitter."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp

import numpy as np

from vctune.document.recording import Floats

LEAST_LINK = 1e-3  # Least jitter with which the search starts, in sample times
LEAST_WINDOWS = 10  # Least number of windows of rows from which jitter can be detected


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of the encoder's noise and of the link's delay."""

    encoder: float  # standard deviation of a position sample, m
    link: float  # standard deviation of the delay from command to command, s


def exposure(velocity: Floats, *, is_position: bool, late: int, lag: float) -> Floats:
    """Return the variance that a link's jitter causes in each row, divided by the variance of the delay, shape (n,)."""
    from scipy.signal import lfilter

    by = velocity if is_position else np.diff(velocity, prepend=velocity[0])
    shifted = np.concatenate([np.zeros(late), by[: by.size - late] ** 2])
    kept = exp(-1 / max(lag, 1e-3))
    return np.asarray(lfilter([1 - kept], [1.0, -kept], shifted))


def whitened(steps: Floats, noise: Noise, exposed: Floats, *, is_position: bool) -> tuple[Floats, float]:
    """Return steps divided by the square root of their covariance, and the logarithm of the covariance's
    determinant."""
    from scipy.linalg import cholesky_banded, solve_banded

    r2, link_variance = noise.encoder**2, noise.link**2 * exposed
    row_variance = r2 + (link_variance if is_position else 0.0 * link_variance)
    band = np.zeros((2, exposed.size - 1))
    band[0] = row_variance[1:] + row_variance[:-1] + (0.0 if is_position else link_variance[1:])
    band[1, :-1] = -row_variance[1:-1]
    factor = cholesky_banded(band, lower=True, check_finite=False)
    return solve_banded((1, 0), factor, steps, check_finite=False), 2 * float(np.sum(np.log(factor[0])))


def likeliest(
    steps: Floats, near: Noise, least: float, T: float, exposed: Floats, *, is_position: bool
) -> tuple[Noise, float]:
    """Return the noise that makes the steps likeliest, and -2 log likelihood for this noise."""
    from scipy.optimize import minimize

    def noise_at(logarithms: Floats) -> Noise:
        encoder, link = np.exp(np.clip(logarithms, -40.0, 40.0))
        return Noise(max(float(encoder), least), float(link) * T)

    def minus_twice_log_likelihood(logarithms: Floats) -> float:
        white, log_determinant = whitened(steps, noise_at(logarithms), exposed, is_position=is_position)
        return float(white @ white) + log_determinant

    start = np.log([near.encoder, max(near.link / T, LEAST_LINK)])
    simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"xatol": 0.02, "fatol": 0.02, "initial_simplex": simplex}
    best = minimize(minus_twice_log_likelihood, start, method="Nelder-Mead", options=options)
    return noise_at(best.x), float(best.fun)


def jitter(residual: Floats, encoder: float, lag: float, exposed: Floats, *, is_position: bool) -> float:
    """Return the standard deviation of a link's delay, s."""
    window = max(ceil(2 * lag) + 2, 4)
    count = residual.size // window
    if count < LEAST_WINDOWS:
        return 0.0
    exposure_of = exposed[1 : 1 + count * window].reshape(count, window).sum(axis=1)
    if is_position:
        place = np.cumsum(residual)
        spread = (place - place.mean())[: count * window].reshape(count, window).mean(axis=1)
        variance, encoder_variance, link_share = spread**2, encoder**2 / window, exposure_of / window**2
    else:
        variance = residual[: count * window].reshape(count, window).sum(axis=1) ** 2
        encoder_variance, link_share = 2 * encoder**2, exposure_of
    beyond = variance - encoder_variance
    total, unsure = float(beyond.sum()), float(np.sqrt(np.sum((beyond - beyond.mean()) ** 2)))
    return float(np.sqrt(total / link_share.sum())) if total > 3 * unsure > 0 else 0.0
