"""Fit the lag and the delay from command to measured force (README, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.identification.motion.covariance import robust_covariance
from vctune.identification.response.response import Complex, Lines
from vctune.model.loop.filters import low_pass
from vctune.model.numbers.arithmetic import FLOATS

PI2 = 2 * np.pi


@dataclass(frozen=True, slots=True)
class DriveFit:
    """A first-order lag and a delay between two sampled columns. The delay includes half a sample for the hold."""

    lag: float  # lag and delay, s
    delay: float
    lag_sigma: float  # their standard deviations, s
    delay_sigma: float
    residual: float  # relative root mean square of the residual


def fit_drive(lines: Lines, sample_time: float) -> DriveFit:
    """Fit the response from command to force."""
    from scipy.optimize import least_squares

    def errors(at: np.ndarray) -> np.ndarray:
        found = _model(lines, float(np.exp(at[0])), float(at[1]) * sample_time) / lines.ratio - 1
        return np.concatenate([found.real, found.imag])

    solved = least_squares(errors, [np.log(0.5 * sample_time), 0.5])
    half = lines.omega.size
    scores = solved.jac[:half] * solved.fun[:half, None] + solved.jac[half:] * solved.fun[half:, None]
    covariance = robust_covariance(scores, solved.jac.T @ solved.jac, round(np.sqrt(half)))
    sigma = np.sqrt(np.diag(covariance))
    lag = float(np.exp(solved.x[0]))
    return DriveFit(
        lag,
        float(solved.x[1]) * sample_time,
        lag * float(sigma[0]),
        float(sigma[1]) * sample_time,
        float(np.sqrt(np.mean(solved.fun**2) * 2)),
    )


def _model(lines: Lines, lag: float, delay: float) -> Complex:
    through = low_pass(1 / (PI2 * lag), 1, lines.omega, FLOATS)
    return np.asarray((through.re - 1j * lines.omega * through.lag) * np.exp(-1j * lines.omega * delay))
