"""What a fit leaves: its share of the motion, its spectrum, and halves of the log (README, section 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.identification.fit import Fit, in_units
from vctune.identification.stepped import Complex
from vctune.identification.study import Curves

CLEAR = 0.02  # Greatest relative standard deviation of a frequency's ratio
LOWEST, HIGHEST = 2, 0.45  # Lowest frequency, in steps of the spectrum, and highest, as a share of the sampling rate
LOUD = 100.0  # Least power of the fitted motion over that of the readings' noise, which a closed loop feeds back
EXCITED = 2.5e-3  # Least power of the input at a frequency, as a share of the greatest


def motion_of(fit: Fit) -> Curves:
    """Return what was read in all segments, and its fit, SI units."""
    task, measured, unit = fit.task, fit.task.measured()[:, 0], fit.task.unit[0]
    time = task.drive.T * (task.starts[:, None] + np.arange(task.rows))
    columns = (time, measured.T * unit, (measured - fit.left[:, 0]).T * unit)
    return Curves(*(np.asarray(each.ravel(), dtype=float) for each in columns))


def root_mean_square_speed(fit: Fit) -> float:
    """Return the root mean square of the fitted speed, m/s."""
    made = motion_of(fit).fitted.reshape(fit.task.starts.size, -1)
    speeds = np.diff(made, axis=1) / fit.task.drive.T if fit.task.drive.reads[0] == 0 else made
    return float(np.sqrt(np.mean(speeds**2)))


def share_left(fit: Fit) -> float:
    """Return the root mean square of the residual over that of the motion in the segments, less a mechanism's steady
    speed."""
    measured = fit.task.measured()[:, 0]
    row = np.linspace(-1.0, 1.0, len(measured))
    table = np.stack([np.ones(len(row)), row], 1)[:, : 1 + (fit.task.drive.reads[0] == 0 and not fit.task.drive.servo)]
    moves = measured - table @ np.linalg.lstsq(table, measured, rcond=None)[0]
    return float(np.linalg.norm(fit.left[:, 0]) / (np.linalg.norm(moves) + 1e-300))


def spectrum(fit: Fit) -> tuple[Floats, Complex, Floats]:
    """Return frequencies, Hz, the ratio of measured to fitted motion, and its relative standard deviation.

    Each frequency is averaged over the segments. The fitted motion is what the noise does not enter.
    """
    task, T = fit.task, fit.task.drive.T
    order = 2 - task.drive.reads[0]  # drifts less than what is read
    beyond = np.diff(fit.left[:, 0], order, axis=0)
    made = np.diff(task.measured()[:, 0], order, axis=0) - beyond
    window, hertz = np.hanning(len(made))[:, None], np.fft.rfftfreq(len(made), T)
    M, E = np.fft.rfft(window * made, axis=0), np.fft.rfft(window * beyond, axis=0)
    power = np.sum(np.abs(M) ** 2, axis=1)
    off = np.sum(np.conj(M) * E, axis=1) / np.maximum(power, 1e-300)
    noise = np.sum(np.abs(E - off[:, None] * M) ** 2, axis=1) / np.maximum(power, 1e-300)
    spread = np.sqrt(noise / max(M.shape[1] - 1, 1))
    pushed = np.zeros(hertz.size)
    for each in (task.drive.input, task.drive.hand):
        if each is not None and np.ptp(each) > 0:
            told = each[: len(each) // len(made) * len(made)].reshape(-1, len(made)).T  # of the whole log
            found = np.sum(np.abs(np.fft.rfft(window * (told - told.mean(axis=0)), axis=0)) ** 2, axis=1)
            pushed = np.maximum(pushed, found / found.max())
    inside = (np.arange(hertz.size) >= LOWEST) & (hertz < HIGHEST / T) & (pushed > EXCITED)
    heard = power > LOUD * M.shape[1] * np.sum(window**2) * (2 * np.sin(np.pi * hertz * T)) ** (2 * order)
    clear = inside & heard & (spread < CLEAR)
    return hertz[clear], 1 + off[clear], spread[clear]


def halves(fit: Fit) -> dict[str, float]:
    """Return by how much each number differs between halves of the log: in time, speed, or frequency, the greatest.

    Each half has half of what the log tells of the number; the estimates of both are to first order.
    """
    flat = fit.residual.reshape(-1, fit.residual.shape[-1]).T
    weights = fit.slopes @ fit.inverse
    told = np.einsum("sij,sij->sj", weights, weights)
    by_speed = np.argsort(np.std(fit.task.measured()[:, 0], axis=0))
    W, R = np.fft.rfft(weights, axis=1), np.fft.rfft(flat, axis=1)
    in_band = np.einsum("sij,si->ij", np.conj(W), R).real, np.einsum("sij,sij->ij", np.conj(W), W).real
    in_segments = np.maximum(_half(fit.scores, told), _half(fit.scores[by_speed], told[by_speed]))
    found = np.maximum(in_segments, _half(*in_band) / fit.residual.shape[0] * 2)
    return {name: abs(each) for name, each in in_units(fit.numbers, fit.steps, found).items()}


def _half(scores: Floats, told: Floats) -> Floats:
    """Return twice the sum of the scores up to where half of all is told."""
    share = np.cumsum(told, axis=0) / (np.sum(told, axis=0) + 1e-300)
    first: NDArray[np.bool_] = share <= 0.5
    return np.asarray(np.abs(2 * np.sum(scores * first, axis=0)))
