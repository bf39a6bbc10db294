"""Fit delay and low-pass of a servo by maximum likelihood over the steps of its position (README, section 8)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, log

import numpy as np

from vctune.document.recording import Floats
from vctune.document.schema.device_contradictions import MAX_DELAY_SAMPLES
from vctune.identification.motion.covariance import joint_factor, robust_covariance
from vctune.identification.servo.servo_motion import modes, positions
from vctune.identification.servo.servo_noise import Noise, exposure, jitter, likeliest, whitened

BANDWIDTHS = (2e-4, 8.0)  # Range of the low-pass's bandwidth, as shares of the sampling rate
LATENCIES = (-5.0, 2.0 * MAX_DELAY_SAMPLES + 800.0)  # Range of the latency, the sum of delay and lag, in samples
START_BANDWIDTHS = 24  # Number of bandwidths from which the search starts, spaced evenly on a logarithmic axis
SETTLING_LAGS = 6.0  # Time after which motion before the log has no effect, in lags of the servo
OTHER_BANDWIDTHS = 14  # Number of other bandwidths at which the search looks for a better fit
NOISE_ROUNDS = 2  # Number of alternations between fitting the noise and fitting the parameters
LEAST_SPAN = 8  # Least number of rows over which a step of the motion is measured
DERIVATIVE_STEP = 1e-4  # Step of a numerical derivative, in samples of the latency or in the logarithm of the bandwidth
# Greatest permitted half-width from the standard deviation, relative to the shorter side of the interval that chi2
# gives
MAX_SIGMA_RATIO = 1.5
JOINT_INTERVALS = 2  # Number of intervals that must hold at the same time: the intervals of delay and bandwidth


@dataclass(frozen=True, slots=True)
class ServoLog:
    """A log, prepared for the fit."""

    time: Floats  # times of the rows, s
    velocity: Floats  # commanded velocity, held from each row to the next, m/s
    position: Floats  # measured position, m
    sample_time: float  # T, s
    is_position: bool  # whether the command is a position, which the servo interpolates
    rounding: float  # least standard deviation of a position sample, m


@dataclass(frozen=True, slots=True)
class Interval:
    """A parameter with its standard deviation and the ends of its interval."""

    value: float
    sigma: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ServoFit:
    """The fit of a servo of one order."""

    order: int  # order of the low-pass
    delay: Interval  # intervals of the delay, s, and of the bandwidth, Hz; they hold at the same time
    bandwidth: Interval
    gain: float  # ratio of motion to command, and its standard deviation
    gain_sigma: float
    lag: float  # lag of the low-pass at rest, s
    jitter: float  # standard deviation of the delay from command to command, s
    noise: Noise  # noise in the likelihood
    exposed: Floats  # variance that jitter causes in each fitted row, divided by the variance of the delay
    first: int  # first row of the fit
    minus_twice_log_likelihood: float  # -2 log likelihood
    inflation: float  # factor by which correlation of the residuals increases a variance
    residual: Floats  # part of the position's steps that the fit leaves unexplained, m
    residual_share: float
    bandwidth_is_bounded: bool  # whether the interval of the bandwidth ends below the highest bandwidth of `BANDWIDTHS`


@dataclass(frozen=True, slots=True)
class _Task:
    """The least-squares problem of the whitened steps."""

    servo_log: ServoLog
    order: int
    first: int
    noise: Noise
    exposed: Floats

    def numbers(self, at: Floats) -> tuple[float, float]:
        """Return delay, s, and bandwidth, Hz."""
        T = self.servo_log.sample_time
        bandwidth = float(np.exp(at[1])) / T
        return float(at[0]) * T - modes(bandwidth, self.order)[0], bandwidth

    def steps(self, at: Floats) -> Floats:
        """Return the measured steps and the steps predicted from given parameters, m, shape (n, 2)."""
        predicted = positions(self.servo_log.time, self.servo_log.velocity, *self.numbers(at), self.order)
        return np.diff(np.stack([self.servo_log.position, predicted], axis=1)[self.first :], axis=0)

    def gain(self, at: Floats) -> float:
        """Return the gain: the ratio of the servo's motion to its command."""
        measured, predicted = self._whitened(self.steps(at)).T
        return float(measured @ predicted / (predicted @ predicted))

    def gain_sigma(self, at: Floats, reach: int) -> float:
        """Return the standard deviation of `gain`."""
        predicted = self._whitened(self.steps(at))[:, 1:]
        return float(
            np.sqrt(robust_covariance(predicted * self.white(at)[:, None], predicted.T @ predicted, reach)[0, 0])
        )

    def residual(self, at: Floats) -> Floats:
        """Return the part of the steps that given parameters leave unexplained, m."""
        measured, predicted = self.steps(at).T
        return np.asarray(measured - self.gain(at) * predicted)

    def white(self, at: Floats) -> Floats:
        """Return the whitened residual with the best gain."""
        measured, predicted = self._whitened(self.steps(at)).T
        return np.asarray(measured - (measured @ predicted / (predicted @ predicted)) * predicted)

    def _whitened(self, steps: Floats) -> Floats:
        """Return steps whose noise is white and of unit variance."""
        return whitened(steps, self.noise, self.exposed, is_position=self.servo_log.is_position)[0]

    def slopes(self, at: Floats, unknowns: tuple[int, ...] = (0, 1)) -> Floats:
        """Return the derivatives of `white`, shape (n, p)."""
        columns = []
        for unknown in unknowns:
            change = np.zeros(2)
            change[unknown] = DERIVATIVE_STEP
            columns.append((self.white(at + change) - self.white(at - change)) / (2 * DERIVATIVE_STEP))
        return np.stack(columns, axis=1)


def fit_servos(servo_log: ServoLog) -> tuple[ServoFit, ServoFit]:
    """Fit servos of order 1 and of order 2 to the same rows, and return both fits in this order."""
    tasks = [_best_numbers(servo_log, order) for order in (1, 2)]
    first = max(task.first for task, _ in tasks)
    fits = [
        _fit_with_intervals(*_refined(_task_near(servo_log, task.order, at, task.noise, first), at))
        for task, at in tasks
    ]
    return fits[0], fits[1]


def _best_numbers(servo_log: ServoLog, order: int) -> tuple[_Task, Floats]:
    """Return the task with the noise of the best fit, and the parameters of this fit."""
    at = _coarse_numbers(servo_log, order)
    task = _task_near(servo_log, order, at, Noise(servo_log.rounding, 0.01 * servo_log.sample_time))
    for _ in range(NOISE_ROUNDS):
        task, at = _refined(task, at)
        task = _task_near(servo_log, order, at, task.noise)
    at = _better_elsewhere(task, at)
    return _task_near(servo_log, order, at, task.noise), at


def _refined(task: _Task, at: Floats) -> tuple[_Task, Floats]:
    """Return the task with the likeliest noise near given parameters, and the parameters that then fit best."""
    servo_log = task.servo_log
    noise, _ = likeliest(
        task.residual(at),
        task.noise,
        servo_log.rounding,
        servo_log.sample_time,
        task.exposed,
        is_position=servo_log.is_position,
    )
    task = replace(task, noise=noise)
    return task, _least_squares(task, at)


def _better_elsewhere(task: _Task, at: Floats) -> Floats:
    """Return parameters at another bandwidth if they fit better. The sum of squares can have several local minima."""
    best, least_sum = at, float(np.sum(task.white(at) ** 2))
    for logarithm in np.linspace(log(10 * BANDWIDTHS[0]), log(BANDWIDTHS[1] / 4), OTHER_BANDWIDTHS):
        numbers = _best_latency(task, at, logarithm)
        sum_of_squares = float(np.sum(task.white(numbers) ** 2))
        if sum_of_squares < least_sum:
            best, least_sum = numbers, sum_of_squares
    return best


def _task_near(servo_log: ServoLog, order: int, at: Floats, noise: Noise, first: int | None = None) -> _Task:
    """Return the task near given parameters, with the rows to fit and the effect of the link's jitter on each row."""
    lag = modes(float(np.exp(at[1])), order)[0]
    if first is None:
        first = min(ceil(max(float(at[0]), 0.0) + SETTLING_LAGS * lag) + 2, servo_log.time.size // 4)
    delay_samples = min(max(round(float(at[0]) - lag), 0), servo_log.time.size // 4)
    exposed = exposure(servo_log.velocity, is_position=servo_log.is_position, late=delay_samples, lag=lag)
    return _Task(servo_log, order, first, noise, exposed[first:])


def _coarse_numbers(servo_log: ServoLog, order: int) -> Floats:
    """Return the unknowns for the best combination of a delay in whole samples and one of several bandwidths. The
    function correlates the measured and the predicted steps."""
    n, T = servo_log.time.size, servo_log.sample_time
    measured = np.diff(servo_log.position)
    best, least_residual = np.zeros(2), np.inf
    size = 2 ** ceil(np.log2(2 * n))
    transform = np.conj(np.fft.rfft(measured, size))
    measured_power = np.concatenate([[0.0], np.cumsum(measured**2)])
    reach = min(MAX_DELAY_SAMPLES + 1, n // 4)
    for logarithm in np.linspace(log(10 * BANDWIDTHS[0]), log(BANDWIDTHS[1] / 8), START_BANDWIDTHS):
        bandwidth = float(np.exp(logarithm)) / T
        steps = np.diff(positions(servo_log.time, servo_log.velocity, 0.0, bandwidth, order))
        correlation = np.fft.irfft(np.conj(transform * np.fft.rfft(steps, size)), size)[:reach]
        shifts = np.arange(reach)
        predicted_power = np.concatenate([[0.0], np.cumsum(steps**2)])[n - 1 - shifts]
        mean_residual = (
            measured_power[-1] - measured_power[shifts] - correlation**2 / np.maximum(predicted_power, 1e-300)
        ) / (n - shifts)
        shift = int(np.argmin(mean_residual))
        if mean_residual[shift] < least_residual:
            least_residual = float(mean_residual[shift])
            best = np.array([shift + modes(bandwidth, order)[0] / T, logarithm])
    return best


def _least_squares(task: _Task, at: Floats) -> Floats:
    """Return the parameters near a start at which the whitened residual is least."""
    from scipy.optimize import least_squares

    low, high = (log(share) for share in BANDWIDTHS)
    bounds = ([LATENCIES[0], low], [LATENCIES[1], high])
    return np.asarray(least_squares(task.white, at, jac=task.slopes, bounds=bounds, x_scale=[1.0, 1.0]).x)


def _fit_with_intervals(task: _Task, at: Floats) -> ServoFit:
    """Return the fit at its best parameters, with intervals that allow for correlated residuals."""
    servo_log, T = task.servo_log, task.servo_log.sample_time
    residual = task.residual(at)
    noise, minus_twice_log_likelihood = likeliest(
        residual, task.noise, servo_log.rounding, T, task.exposed, is_position=servo_log.is_position
    )
    task = replace(task, noise=noise)
    white, slopes = task.white(at), task.slopes(at)
    information = slopes.T @ slopes
    lag = modes(task.numbers(at)[1], task.order)[0] / T
    reach = ceil(max(np.sqrt(white.size), 3 * lag))
    robust = robust_covariance(slopes * white[:, None], information, reach)
    plain = np.linalg.inv(information)
    # convert the covariance of latency and log bandwidth to the covariance of delay and log bandwidth: the lag falls as
    # the bandwidth rises
    to_latency = np.array([[1.0, lag], [0.0, 1.0]])
    robust, plain = to_latency @ robust @ to_latency.T, to_latency @ plain @ to_latency.T
    inflation = max(1.0, float(np.max(np.diag(robust) / np.diag(plain))))
    sigma = np.sqrt(np.maximum(np.diag(robust), np.diag(plain)))
    delay, bandwidth = _intervals(task, at, sigma, inflation)
    return ServoFit(
        order=task.order,
        delay=delay,
        bandwidth=bandwidth,
        gain=task.gain(at),
        gain_sigma=task.gain_sigma(at, reach),
        lag=lag * T,
        jitter=jitter(residual, noise.encoder, lag, task.exposed, is_position=servo_log.is_position),
        noise=noise,
        exposed=task.exposed,
        first=task.first,
        minus_twice_log_likelihood=minus_twice_log_likelihood,
        inflation=inflation,
        residual=residual,
        residual_share=_residual_share(
            np.cumsum(residual), servo_log.position[task.first :], max(LEAST_SPAN, ceil(at[0]))
        ),
        bandwidth_is_bounded=bandwidth.high < 0.99 * BANDWIDTHS[1] / T,
    )


def _residual_share(residual_motion: Floats, position: Floats, span: int) -> float:
    """Return the root mean square residual motion over `span` rows, divided by the root mean square motion over `span`
    rows."""
    span = min(span, residual_motion.size // 2)
    motion = np.sqrt(np.mean((position[span:] - position[:-span]) ** 2))
    return float(np.sqrt(np.mean((residual_motion[span:] - residual_motion[:-span]) ** 2)) / motion)


def _intervals(task: _Task, at: Floats, sigma: Floats, inflation: float) -> tuple[Interval, Interval]:
    """Return intervals of delay and bandwidth."""
    T, factor = task.servo_log.sample_time, joint_factor(JOINT_INTERVALS)
    least = float(np.sum(task.white(at) ** 2))
    allowance = factor**2 * inflation
    ends = [_end_of_bandwidth(task, at, least, allowance, side, float(sigma[1])) for side in (-1, 1)]
    delays = [task.numbers(numbers)[0] / T for numbers in (*ends, at)]  # in samples
    delay, bandwidth = task.numbers(at)
    low_delay, high_delay = (side * max(side * numbers for numbers in delays) * T for side in (-1, 1))
    slow, fast = (task.numbers(numbers)[1] for numbers in ends)
    return (
        _interval(delay, float(sigma[0]) * T, low_delay, high_delay, factor),
        _interval(bandwidth, float(sigma[1]) * bandwidth, slow, fast, factor),
    )


def _interval(value: float, sigma: float, low: float, high: float, factor: float) -> Interval:
    """Return the interval that contains both given ends and reaches at least `factor` standard deviations to each
    side."""
    sigma = min(sigma, MAX_SIGMA_RATIO * min(value - low, high - value) / factor)
    return Interval(value, sigma, min(low, value - factor * sigma), max(high, value + factor * sigma))


def _end_of_bandwidth(task: _Task, at: Floats, least: float, allowance: float, side: int, sigma: float) -> Floats:
    """Return the parameters at one end of the bandwidth's interval: the lower end for `side` -1, the upper end for
    1."""
    limit = log(BANDWIDTHS[0]) if side < 0 else log(BANDWIDTHS[1])
    inside, step = at, min(max(sigma, 1e-5), 0.5)
    for _ in range(60):
        further = _best_latency(task, inside, inside[1] + side * step)
        if _excess_chi2(task, further, least) > allowance:
            break
        if side * (further[1] - limit) >= 0:
            return further
        inside, step = further, 2 * step
    for _ in range(12):
        if abs(further[1] - inside[1]) < 0.05 * abs(inside[1] - at[1]) + 1e-6:
            break
        middle = _best_latency(task, inside, 0.5 * (inside[1] + further[1]))
        if _excess_chi2(task, middle, least) > allowance:
            further = middle
        else:
            inside = middle
    return further


def _excess_chi2(task: _Task, at: Floats, least: float) -> float:
    """Return how far chi2 at given parameters exceeds the least chi2."""
    return float(np.sum(task.white(at) ** 2)) - least


def _best_latency(task: _Task, at: Floats, logarithm: float) -> Floats:
    """Return the parameters with the best latency at another bandwidth, by the method of Gauss and Newton."""
    low, high = (log(share) for share in BANDWIDTHS)
    at = np.array([at[0], min(max(logarithm, low), high)])
    for _ in range(6):
        slope = task.slopes(at, (0,))[:, 0]
        if not slope.any():  # the command does not act within the log
            break
        change = float(slope @ task.white(at)) / float(slope @ slope)
        at = at - np.array([change, 0.0])
        if abs(change) < 1e-4:
            break
    return at
