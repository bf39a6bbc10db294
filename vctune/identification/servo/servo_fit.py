"""Fit delay and low-pass of a servo by maximum likelihood over the steps of its position (README, section 9)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, log

import numpy as np

from vctune.document.recording import Floats
from vctune.document.schema.device_contradictions import MAX_DELAY_SAMPLES
from vctune.identification.motion.covariance import joint_factor, robust_covariance
from vctune.identification.servo.servo_motion import modes, positions
from vctune.identification.servo.servo_noise import Noise, exposure, jitter, likeliest, whitened

BANDWIDTHS = (2e-4, 8.0)
"""Range of the low-pass's bandwidth, as shares of the sampling rate. The lags range from 800 samples to a fiftieth of a
sample."""
TRIED = 24
"""Number of bandwidths from which the search starts, spaced evenly on a logarithmic axis."""
SETTLED = 6.0
"""Time after which motion before the log has no effect, in lags of the servo."""
VALLEYS = 14
"""Number of other bandwidths at which the search looks for a better fit."""
ROUNDS = 2
"""Number of alternations between fitting the noise and fitting the numbers."""
LEAST_SPAN = 8
"""Least number of rows over which a step of the motion is measured. A single row would show only the encoder's
noise."""
FINE = 1e-4
"""Relative step of a numerical derivative."""
WILD = 1.5
"""Greatest permitted ratio of a standard deviation to the half-width that chi2 gives."""
STATED = 2
"""Number of intervals that must hold together: those of delay and bandwidth."""


@dataclass(frozen=True, slots=True)
class ServoLog:
    """A log, prepared for the fit.

    Attributes
    ----------
    time : times of the rows, s
    velocity : commanded velocity, held from each row to the next, m/s
    position : measured position, m
    sample_time : T, s
    is_position : whether the command is a position, which the servo interpolates
    rounding : least standard deviation of a position sample, m
    """

    time: Floats
    velocity: Floats
    position: Floats
    sample_time: float
    is_position: bool
    rounding: float


@dataclass(frozen=True, slots=True)
class Interval:
    """A number and the ends of its interval."""

    value: float
    sigma: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ServoFit:
    """The fit of a servo of one order.

    Attributes
    ----------
    order : order of the low-pass
    delay, bandwidth : intervals of the delay, s, and of the bandwidth, Hz; they hold at the same time
    gain, gain_sigma : ratio of motion to command, and its standard deviation
    lag : lag of the low-pass at rest, s
    jitter : standard deviation of the delay from command to command, s
    noise : noise in the likelihood
    exposed : variance that jitter causes in each row, divided by the variance of the delay
    first : first row of the fit
    unlikely : -2 log likelihood
    inflation : factor by which correlation of the residuals increases a variance
    left : part of the position's steps that the fit leaves unexplained, m
    left_share : root mean square residual motion over as many rows as the servo's delay
    told : whether the interval of the bandwidth ends below the highest tried bandwidth
    """

    order: int
    delay: Interval
    bandwidth: Interval
    gain: float
    gain_sigma: float
    lag: float
    jitter: float
    noise: Noise
    exposed: Floats
    first: int
    unlikely: float
    inflation: float
    left: Floats
    left_share: float
    told: bool


@dataclass(frozen=True, slots=True)
class _Task:
    """The least-squares problem of the whitened steps.

    The unknowns are the latency in samples, and the log of bandwidth times sample time.
    """

    seen: ServoLog
    order: int
    first: int
    noise: Noise
    exposed: Floats

    def numbers(self, at: Floats) -> tuple[float, float]:
        """Return delay, s, and bandwidth, Hz."""
        T = self.seen.sample_time
        bandwidth = float(np.exp(at[1])) / T
        return float(at[0]) * T - modes(bandwidth, self.order)[0], bandwidth

    def steps(self, at: Floats) -> Floats:
        """Return the measured steps and the steps predicted from given numbers, m, shape (n, 2)."""
        moved = positions(self.seen.time, self.seen.velocity, *self.numbers(at), self.order)
        return np.diff(np.stack([self.seen.position, moved], axis=1)[self.first :], axis=0)

    def gain(self, at: Floats) -> float:
        """Return the gain: the ratio of the servo's motion to its command."""
        measured, made = self._whitened(self.steps(at)).T
        return float(measured @ made / (made @ made))

    def gain_sigma(self, at: Floats, reach: int) -> float:
        """Return the standard deviation of `gain`."""
        made = self._whitened(self.steps(at))[:, 1:]
        return float(np.sqrt(robust_covariance(made * self.white(at)[:, None], made.T @ made, reach)[0, 0]))

    def left(self, at: Floats) -> Floats:
        """Return the part of the steps that given numbers leave unexplained, m."""
        measured, made = self.steps(at).T
        return np.asarray(measured - self.gain(at) * made)

    def white(self, at: Floats) -> Floats:
        """Return the whitened residual with the best gain."""
        measured, made = self._whitened(self.steps(at)).T
        return np.asarray(measured - (measured @ made / (made @ made)) * made)

    def _whitened(self, steps: Floats) -> Floats:
        return whitened(steps, self.noise, self.exposed, is_position=self.seen.is_position)[0]

    def slopes(self, at: Floats, which: tuple[int, ...] = (0, 1)) -> Floats:
        """Return the derivatives of `white`, shape (n, p)."""
        found = []
        for i in which:
            by = np.zeros(2)
            by[i] = FINE
            found.append((self.white(at + by) - self.white(at - by)) / (2 * FINE))
        return np.stack(found, axis=1)


def fit_servos(seen: ServoLog) -> tuple[ServoFit, ServoFit]:
    """Fit servos of order 1 and of order 2 to the same rows.

    Parameters
    ----------
    seen : times, command and position of a recording
    """
    found = [_found(seen, order) for order in (1, 2)]
    first = max(task.first for task, _ in found)
    fits = [_with_intervals(*_refined(_prepared(seen, task.order, at, task.noise, first), at)) for task, at in found]
    return fits[0], fits[1]


def _found(seen: ServoLog, order: int) -> tuple[_Task, Floats]:
    """Return the numbers of the best fit, with their noise."""
    at = _coarse(seen, order)
    task = _prepared(seen, order, at, Noise(seen.rounding, 0.01 * seen.sample_time))
    for _ in range(ROUNDS):
        task, at = _refined(task, at)
        task = _prepared(seen, order, at, task.noise)
    at = _better_elsewhere(task, at)
    return _prepared(seen, order, at, task.noise), at


def _refined(task: _Task, at: Floats) -> tuple[_Task, Floats]:
    """Return the task with the likeliest noise near given numbers, and the numbers that then fit best."""
    seen = task.seen
    noise, _ = likeliest(
        task.left(at), task.noise, seen.rounding, seen.sample_time, task.exposed, is_position=seen.is_position
    )
    task = replace(task, noise=noise)
    return task, _least(task, at)


def _better_elsewhere(task: _Task, at: Floats) -> Floats:
    """Return numbers at another bandwidth if they fit better. The sum of squares has several valleys."""
    best, least = at, float(np.sum(task.white(at) ** 2))
    for logarithm in np.linspace(log(10 * BANDWIDTHS[0]), log(BANDWIDTHS[1] / 4), VALLEYS):
        tried = _best_latency(task, at, logarithm)
        found = float(np.sum(task.white(tried) ** 2))
        if found < least:
            best, least = tried, found
    return best


def _prepared(seen: ServoLog, order: int, at: Floats, noise: Noise, first: int | None = None) -> _Task:
    """Return the task near given numbers, with the rows to fit and the effect of the link's jitter on each row."""
    lag = modes(float(np.exp(at[1])), order)[0]
    if first is None:
        first = min(ceil(max(float(at[0]), 0.0) + SETTLED * lag) + 2, seen.time.size // 4)
    late = min(max(round(float(at[0]) - lag), 0), seen.time.size // 4)
    exposed = exposure(seen.velocity, is_position=seen.is_position, late=late, lag=lag)
    return _Task(seen, order, first, noise, exposed[first:])


def _coarse(seen: ServoLog, order: int) -> Floats:
    """Return the best combination of a whole number of samples of delay and one of several bandwidths, by correlation
    of steps."""
    n, T = seen.time.size, seen.sample_time
    measured = np.diff(seen.position)
    best, least = np.zeros(2), np.inf
    size = 2 ** ceil(np.log2(2 * n))
    transform = np.conj(np.fft.rfft(measured, size))
    squares = np.concatenate([[0.0], np.cumsum(measured**2)])
    reach = min(MAX_DELAY_SAMPLES + 1, n // 4)
    for logarithm in np.linspace(log(10 * BANDWIDTHS[0]), log(BANDWIDTHS[1] / 8), TRIED):
        bandwidth = float(np.exp(logarithm)) / T
        steps = np.diff(positions(seen.time, seen.velocity, 0.0, bandwidth, order))
        together = np.fft.irfft(np.conj(transform * np.fft.rfft(steps, size)), size)[:reach]
        shifts = np.arange(reach)
        powers = np.concatenate([[0.0], np.cumsum(steps**2)])[n - 1 - shifts]
        left = (squares[-1] - squares[shifts] - together**2 / np.maximum(powers, 1e-300)) / (n - shifts)
        shift = int(np.argmin(left))
        if left[shift] < least:
            least = float(left[shift])
            best = np.array([shift + modes(bandwidth, order)[0] / T, logarithm])
    return best


def _least(task: _Task, at: Floats) -> Floats:
    from scipy.optimize import least_squares

    low, high = (log(each) for each in BANDWIDTHS)
    bounds = ([-5.0, low], [2.0 * MAX_DELAY_SAMPLES + 800.0, high])
    return np.asarray(least_squares(task.white, at, jac=task.slopes, bounds=bounds, x_scale=[1.0, 1.0]).x)


def _with_intervals(task: _Task, at: Floats) -> ServoFit:
    seen, T = task.seen, task.seen.sample_time
    left = task.left(at)
    noise, unlikely = likeliest(left, task.noise, seen.rounding, T, task.exposed, is_position=seen.is_position)
    task = replace(task, noise=noise)
    white, slopes = task.white(at), task.slopes(at)
    information = slopes.T @ slopes
    lag = modes(task.numbers(at)[1], task.order)[0] / T
    reach = ceil(max(np.sqrt(white.size), 3 * lag))
    robust = robust_covariance(slopes * white[:, None], information, reach)
    plain = np.linalg.inv(information)
    # convert the slope by delay and log bandwidth to one by latency: the lag decreases as the bandwidth increases
    turn = np.array([[1.0, lag], [0.0, 1.0]])
    robust, plain = turn @ robust @ turn.T, turn @ plain @ turn.T
    inflation = max(1.0, float(np.max(np.diag(robust) / np.diag(plain))))
    sigma = np.sqrt(np.maximum(np.diag(robust), np.diag(plain)))
    delay, bandwidth = _profile(task, at, sigma, inflation)
    return ServoFit(
        order=task.order,
        delay=delay,
        bandwidth=bandwidth,
        gain=task.gain(at),
        gain_sigma=task.gain_sigma(at, reach),
        lag=lag * T,
        jitter=jitter(left, noise.encoder, lag, task.exposed, is_position=seen.is_position),
        noise=noise,
        exposed=task.exposed,
        first=task.first,
        unlikely=unlikely,
        inflation=inflation,
        left=left,
        left_share=_share(np.cumsum(left), seen.position[task.first :], max(LEAST_SPAN, ceil(at[0]))),
        told=bandwidth.high < 0.99 * BANDWIDTHS[1] / T,
    )


def _share(left: Floats, position: Floats, span: int) -> float:
    """Return the root mean square residual motion over some rows, without the drift over the whole log."""
    span = min(span, left.size // 2)
    of = np.sqrt(np.mean((position[span:] - position[:-span]) ** 2))
    return float(np.sqrt(np.mean((left[span:] - left[:-span]) ** 2)) / of)


def _profile(task: _Task, at: Floats, sigma: Floats, inflation: float) -> tuple[Interval, Interval]:
    """Return intervals of delay and bandwidth.

    An interval ends where the least chi2 at a given bandwidth exceeds its limit.

    For a short lag, chi2 is not a parabola. A standard deviation would then give wrong ends for the bandwidth.
    """
    T, factor = task.seen.sample_time, joint_factor(STATED)
    least = float(np.sum(task.white(at) ** 2))
    most = factor**2 * inflation
    ends = [_end(task, at, least, most, side, float(sigma[1])) for side in (-1, 1)]
    delays = [task.numbers(each)[0] / T for each in (*ends, at)]
    delay, bandwidth = task.numbers(at)
    low_delay, high_delay = (side * max(side * each for each in delays) * T for side in (-1, 1))
    slow, fast = (task.numbers(each)[1] for each in ends)
    return (
        _interval(delay, float(sigma[0]) * T, low_delay, high_delay, factor),
        _interval(bandwidth, float(sigma[1]) * bandwidth, slow, fast, factor),
    )


def _interval(value: float, sigma: float, low: float, high: float, factor: float) -> Interval:
    """Return an interval.

    If the standard deviation reaches far beyond an end, chi2 is not a parabola, and the function keeps the given ends.
    """
    sigma = min(sigma, WILD * min(value - low, high - value) / factor)
    return Interval(value, sigma, min(low, value - factor * sigma), max(high, value + factor * sigma))


def _end(task: _Task, at: Floats, least: float, most: float, side: int, sigma: float) -> Floats:
    """Return the numbers at one end of the bandwidth's interval."""
    limit = log(BANDWIDTHS[0]) if side < 0 else log(BANDWIDTHS[1])
    inside, step = at, min(max(sigma, 1e-5), 0.5)
    for _ in range(60):
        further = _best_latency(task, inside, inside[1] + side * step)
        if _excess(task, further, least) > most:
            break
        if side * (further[1] - limit) >= 0:
            return further
        inside, step = further, 2 * step
    for _ in range(12):
        if abs(further[1] - inside[1]) < 0.05 * abs(inside[1] - at[1]) + 1e-6:
            break
        middle = _best_latency(task, inside, 0.5 * (inside[1] + further[1]))
        if _excess(task, middle, least) > most:
            further = middle
        else:
            inside = middle
    return further


def _excess(task: _Task, at: Floats, least: float) -> float:
    return float(np.sum(task.white(at) ** 2)) - least


def _best_latency(task: _Task, at: Floats, logarithm: float) -> Floats:
    """Return the numbers with the best latency at another bandwidth, by the method of Gauss and Newton."""
    low, high = (log(each) for each in BANDWIDTHS)
    at = np.array([at[0], min(max(logarithm, low), high)])
    for _ in range(6):
        slope = task.slopes(at, (0,))[:, 0]
        by = float(slope @ task.white(at)) / float(slope @ slope)
        at = at - np.array([by, 0.0])
        if abs(by) < 1e-4:
            break
    return at
