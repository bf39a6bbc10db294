"""Fit delay and low-pass of a vendor's servo to the steps of its position (README, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, log, pi, sqrt

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import Bounded, CandidateRecord, Estimate, NumberRecord
from vctune.document.schema.rules import MAX_DELAY_SAMPLES
from vctune.document.text.codes import Note, coded
from vctune.identification.box import jackknife, joint_factor, unexplained
from vctune.identification.checks import position_noise
from vctune.identification.study import Complex, Curves, Lines, Study, number, record_of
from vctune.model.device import Device

BANDWIDTHS = (2e-4, 8.0)  # Range of the low-pass's bandwidth, as shares of the sampling rate
LATENCIES = (-5.0, 2.0 * MAX_DELAY_SAMPLES + 800.0)  # Range of the latency, the sum of delay and lag, in samples
STARTS, ELSEWHERE = 24, 14  # Numbers of bandwidths from which the search starts, and at which it looks again
SETTLING_LAGS = 6.0  # Time after which motion before the log has no effect, in lags of the servo
LEAST_SPAN = 8  # Least number of rows over which a step of the motion is measured
CHANGE = 1e-4  # Step of a derivative, in samples of the latency or in the logarithm of the bandwidth
AHEAD = 0.25  # Greatest time by which a motion may seem to precede its command, in samples
DECISIVE_GAIN = 10.0  # Gain in -2 log likelihood, for independent residuals, that decides between the orders
MAX_RESIDUAL_SHARE, GAIN_RANGE = 0.5, (0.8, 1.25)  # Of the motion; beyond these a log is refused
SIGNIFICANT, LEAST_YIELDING = 4.0, 0.005  # Deviations, and share of the motion, with which a servo yields
PER_OCTAVE, LOWEST, HANN = 3, 3.0, 1.5  # Bands; lower edge of the first, and a window's width, in frequency steps
CLEAR = 0.02  # Greatest relative standard deviation of a band's ratio
RIDGE, BEYOND = 40, 40  # Numbers of servos with a fit's latency, and of frequencies of the other order
LATENCY, JITTER = coded("a delay and a lag are alike in this motion", "limit-latency"), coded("jitter", "limit-jitter")


@dataclass(frozen=True, slots=True)
class ServoLog:
    """A log, prepared for the fit."""

    time: Floats  # times of the rows, s
    velocity: Floats  # commanded velocity, held from each row to the next, m/s
    position: Floats  # measured, m
    T: float
    is_position: bool  # whether the command is a position, which the servo interpolates
    rounding: float  # least standard deviation of a position sample, m


@dataclass(frozen=True, slots=True)
class ServoFit:
    """The fit of a servo of one order."""

    task: Task
    at: Floats
    delay: Estimate  # their intervals hold at the same time
    bandwidth: Estimate
    jitter: float  # standard deviation of the delay from command to command, s
    cost: float  # -2 log likelihood
    inflation: float  # factor by which correlation of the residuals increases a variance
    residual: Floats  # part of the position's steps that the fit leaves unexplained, m
    residual_share: float
    is_bounded: bool  # whether the bandwidth's interval ends below the highest bandwidth
    latest: float  # greatest delay that the motion permits, s: a lag is not negative, so it is at most the latency's

    @property
    def latency(self) -> float:
        """The sum of delay and lag, s."""
        return float(self.at[0]) * self.task.log.T


def modes(bandwidth_hz: float, order: int) -> tuple[float, complex, complex]:
    """Return the lag of a low-pass, a pole, and the weight of its decay in a step of the velocity."""
    w = 2 * pi * bandwidth_hz
    if order == 1:
        return 1 / w, complex(-w), complex(1 / w)
    pole = w * complex(-1, 1) / sqrt(2)
    return sqrt(2) / w, pole, 2 * w**2 / (pole**2 * 2 * (pole + w / sqrt(2)))


def interpolating_velocity(time: Floats, command: Floats) -> Floats:
    """Return the held velocity with which a position command is reached one sample later."""
    steps = np.diff(time)
    velocity = np.diff(command, prepend=command[0]) / np.append(steps, steps[-1])
    velocity[0] = velocity[1]
    return velocity


def positions(time: Floats, velocity: Floats, delay: float, bandwidth_hz: float, order: int) -> Floats:
    """Return the positions of a servo at the rows of a log, exact except near its start."""
    lag, pole, residue = modes(bandwidth_hz, order)
    steps = np.diff(time)
    path = np.concatenate([[0.0], np.cumsum(velocity[:-1] * steps)])
    left, through = np.diff(velocity, prepend=velocity[0]).astype(complex), np.append(0.0, np.exp(pole * steps))
    span = 1  # each pass doubles the number of summed terms of left[k] = through[k] left[k - 1] + jump[k]
    while span < left.size and np.abs(through).max() > 1e-17:
        left[span:] = left[span:] + through[span:] * left[:-span]
        through = np.concatenate([np.zeros(span), through[span:] * through[:-span]])
        span *= 2
    row = np.clip(np.searchsorted(time, time - delay, side="right") - 1, 0, time.size - 1)
    since = time - delay - time[row]
    mode = left[row] * np.exp(pole * np.maximum(since, 0.0))
    return np.asarray(path[row] + velocity[row] * (since - lag) + (residue * mode).real)


def sampled_response(omega: Floats, T: float, delay: float, bandwidth_hz: float, order: int) -> Complex:
    """Return the exact response from a held velocity to the velocity between two samples of the position."""
    lag, pole, residue = modes(bandwidth_hz, order)
    whole = np.ceil(delay / T)
    since, w = whole * T - delay, np.exp(-1j * omega * T)
    pairs = [(residue, pole)] if order == 1 else [(residue / 2, pole), (np.conj(residue) / 2, np.conj(pole))]
    left = sum((1 - w) * r * np.exp(p * since) / (1 - np.exp(p * T) * w) for r, p in pairs)
    return np.asarray(w**whole * (T * w + (1 - w) * (since - lag + left)) / T)


@dataclass(frozen=True, slots=True)
class Task:
    """The least-squares problem of the whitened steps. Its unknowns are the latency in samples, and the logarithm of
    the bandwidth as a share of the sampling rate."""

    log: ServoLog
    order: int
    first: int  # first row
    encoder: float  # standard deviation of a position sample, m, and of the delay from command to command, s
    link: float
    exposed: Floats  # variance in each row for a unit variance of the delay

    def numbers(self, at: Floats) -> tuple[float, float]:
        """Return delay, s, and bandwidth, Hz."""
        bandwidth = float(np.exp(at[1])) / self.log.T
        return float(at[0]) * self.log.T - modes(bandwidth, self.order)[0], bandwidth

    def steps(self, at: Floats) -> Floats:
        """Return the measured and the predicted steps, m, shape (n, 2)."""
        predicted = positions(self.log.time, self.log.velocity, *self.numbers(at), self.order)
        return np.diff(np.stack([self.log.position, predicted], axis=1)[self.first :], axis=0)

    def whitened(self, steps: Floats) -> tuple[Floats, float]:
        """Return steps whose noise is white and of unit variance, and the logarithm of their covariance's
        determinant."""
        from scipy.linalg import cholesky_banded, solve_banded

        link = self.link**2 * self.exposed
        rows = self.encoder**2 + (link if self.log.is_position else 0.0 * link)
        band = np.zeros((2, self.exposed.size - 1))
        band[0] = rows[1:] + rows[:-1] + (0.0 if self.log.is_position else link[1:])
        band[1, :-1] = -rows[1:-1]
        factor = cholesky_banded(band, lower=True, check_finite=False)
        return solve_banded((1, 0), factor, steps, check_finite=False), 2 * float(np.sum(np.log(factor[0])))

    def gain(self, at: Floats) -> float:
        """Return the ratio of the servo's motion to its command."""
        measured, predicted = self.whitened(self.steps(at))[0].T
        return float(measured @ predicted / (predicted @ predicted))

    def white(self, at: Floats) -> Floats:
        """Return the whitened residual with the best gain."""
        measured, predicted = self.whitened(self.steps(at))[0].T
        return np.asarray(measured - (measured @ predicted / (predicted @ predicted)) * predicted)

    def residual(self, at: Floats) -> Floats:
        """Return the part of the steps that given parameters leave unexplained, m."""
        return np.asarray(self.steps(at) @ [1.0, -self.gain(at)])

    def slopes(self, at: Floats, unknowns: int = 2) -> Floats:
        """Return the derivatives of `white`, shape (n, unknowns)."""
        steps = CHANGE * np.eye(2)[:unknowns]
        return np.stack([(self.white(at + h) - self.white(at - h)) / (2 * CHANGE) for h in steps], axis=1)

    def chi2(self, at: Floats) -> float:
        """Return the sum of the squares of `white`."""
        return float(np.sum(self.white(at) ** 2))

    def near(self, at: Floats, first: int | None = None) -> Task:
        """Return the task near given parameters, with the rows to fit and the effect of the link's jitter on each."""
        from scipy.signal import lfilter

        lag, n = modes(float(np.exp(at[1])), self.order)[0], self.log.time.size
        if first is None:
            first = min(ceil(max(float(at[0]), 0.0) + SETTLING_LAGS * lag) + 2, n // 4)
        late, kept = min(max(round(float(at[0]) - lag), 0), n // 4), exp(-1 / max(lag, 1e-3))
        by = self.log.velocity if self.log.is_position else np.diff(self.log.velocity, prepend=self.log.velocity[0])
        exposed = lfilter([1 - kept], [1.0, -kept], np.concatenate([np.zeros(late), by[: n - late] ** 2]))
        return replace(self, first=first, exposed=np.asarray(exposed[first:]))

    def refined(self, at: Floats) -> tuple[Task, Floats]:
        """Return the task with the likeliest noise near given parameters, and the parameters that then fit best."""
        from scipy.optimize import least_squares

        task = self.likeliest(at)[0]
        low, high = (log(share) for share in BANDWIDTHS)
        bounds = ([LATENCIES[0], low], [LATENCIES[1], high])
        return task, np.asarray(least_squares(task.white, at, jac=task.slopes, bounds=bounds).x)

    def likeliest(self, at: Floats) -> tuple[Task, float]:
        """Return the task with the noise that makes the residual likeliest, and -2 log likelihood."""
        from scipy.optimize import minimize

        residual, T = self.residual(at), self.log.T

        def noisy(logarithms: Floats) -> Task:
            encoder, link = np.exp(np.clip(logarithms, -40.0, 40.0))
            return replace(self, encoder=max(float(encoder), self.log.rounding), link=float(link) * T)

        def cost(logarithms: Floats) -> float:
            white, determinant = noisy(logarithms).whitened(residual)
            return float(white @ white) + determinant

        start = np.log([self.encoder, max(self.link / T, 1e-3)])
        simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options = {"xatol": 0.02, "fatol": 0.02, "initial_simplex": simplex}
        best = minimize(cost, start, method="Nelder-Mead", options=options)
        return noisy(best.x), float(best.fun)

    def best_latency(self, at: Floats, logarithm: float) -> Floats:
        """Return the parameters with the best latency at another bandwidth, by the method of Gauss and Newton."""
        at = np.array([at[0], np.clip(logarithm, *np.log(BANDWIDTHS))])
        for _ in range(6):
            slope = self.slopes(at, 1)[:, 0]
            if not slope.any():  # the command does not act within the log
                break
            change = float(slope @ self.white(at)) / float(slope @ slope)
            at = at - np.array([change, 0.0])
            if abs(change) < 1e-4:
                break
        return at


def servo_log_of(recording: Recording, T: float) -> ServoLog:
    """Return the columns of a recording that the fit needs, and the least noise that the encoder's rounding permits."""
    position, logged, role = recording.channels["position"], recording.values("time"), commanded(recording)
    time = np.asarray(np.arange(len(recording)) * T if logged is None else logged - logged[0], dtype=np.float64)
    command, is_position = recording.channels[role].values, role == "position_command"
    steps = np.abs(np.diff(position.values))
    quantum = position.quantum or float(steps[steps > 0].min(initial=np.inf))
    rounding = min(quantum / sqrt(12), position_noise(position.values, position.quantum))
    velocity = interpolating_velocity(time, command) if is_position else command
    least = max(rounding, 1e-9 * float(np.ptp(position.values)))
    return ServoLog(time, velocity, position.values, T, is_position, least)


def commanded(recording: Recording) -> str:
    """Return the role of the command that the servo received."""
    return "velocity_command" if "velocity_command" in recording.channels else "position_command"


def fit_servos(servo_log: ServoLog) -> tuple[ServoFit, ServoFit]:
    """Fit servos of order 1 and of order 2 to the same rows; the likelier is first."""
    found = []
    for order in (1, 2):
        at = _coarse(servo_log, order)
        task = Task(servo_log, order, 0, servo_log.rounding, 0.01 * servo_log.T, np.zeros(0)).near(at)
        for _ in range(2):
            task, at = task.refined(at)
            task = task.near(at)
        grid = np.linspace(log(10 * BANDWIDTHS[0]), log(BANDWIDTHS[1] / 4), ELSEWHERE)
        at = min([at, *(task.best_latency(at, logarithm) for logarithm in grid)], key=task.chi2)
        found.append((task.near(at), at))
    first = max(task.first for task, _ in found)
    one, two = (_with_intervals(*task.near(at, first).refined(at)) for task, at in found)
    return (one, two) if one.cost <= two.cost else (two, one)


def _coarse(servo_log: ServoLog, order: int) -> Floats:
    """Return the unknowns for the best of several bandwidths and a delay in whole samples, by correlation."""
    n, T = servo_log.time.size, servo_log.T
    measured, size = np.diff(servo_log.position), 2 ** ceil(np.log2(2 * n))
    transform, power = np.conj(np.fft.rfft(measured, size)), np.append(0.0, np.cumsum(measured**2))
    shifts, best, least = np.arange(min(MAX_DELAY_SAMPLES + 1, n // 4)), np.zeros(2), np.inf
    for logarithm in np.linspace(log(10 * BANDWIDTHS[0]), log(BANDWIDTHS[1] / 8), STARTS):
        bandwidth = float(np.exp(logarithm)) / T
        steps = np.diff(positions(servo_log.time, servo_log.velocity, 0.0, bandwidth, order))
        correlation = np.fft.irfft(np.conj(transform * np.fft.rfft(steps, size)), size)[: shifts.size]
        predicted = np.append(0.0, np.cumsum(steps**2))[n - 1 - shifts]
        left = (power[-1] - power[shifts] - correlation**2 / np.maximum(predicted, 1e-300)) / (n - shifts)
        shift = int(np.argmin(left))
        if left[shift] < least:
            least, best = float(left[shift]), np.array([shift + modes(bandwidth, order)[0] / T, logarithm])
    return best


def _with_intervals(task: Task, at: Floats) -> ServoFit:
    """Return the fit at its best parameters, with intervals that allow for correlated residuals."""
    servo_log, T, residual = task.log, task.log.T, task.residual(at)
    task, cost = task.likeliest(at)
    white, slopes = task.white(at), task.slopes(at)
    lag = modes(task.numbers(at)[1], task.order)[0] / T
    block = ceil(max(np.sqrt(white.size), 3 * lag))
    # the lag falls as the bandwidth rises: to the covariance of delay and log bandwidth
    to_delay = np.array([[1.0, lag], [0.0, 1.0]])
    covariances = jackknife(slopes, white, np.arange(0, white.size, block)), np.linalg.inv(slopes.T @ slopes)
    robust, plain = (np.diag(to_delay @ each @ to_delay.T) for each in covariances)
    inflation, sigma = max(1.0, float(np.max(robust / plain))), np.sqrt(np.maximum(robust, plain))
    factor, of_latency = joint_factor(2), float(np.sqrt(max(each[0, 0] for each in covariances)))
    ends = [_end(task, at, factor**2 * inflation, side, float(sigma[1])) for side in (-1, 1)]
    delays, bands = zip(*(task.numbers(each) for each in (*ends, at)), strict=True)
    jitter = _jitter(task, residual, lag)

    def estimate(key: str, values: Sequence[float], sigma: float, more: float) -> Estimate:
        value, low, high = values[-1], min(values), max(values)
        sigma = min(sigma, 1.5 * min(value - low, high - value) / factor)
        beyond = [max(each - factor * sigma, 0.0) for each in (value - low, high - value)]
        reason = JITTER if more > max(beyond) else LATENCY
        return Estimate(key, value, sigma, "", (beyond[0] + more, beyond[1] + more), reason=reason)

    span = min(max(LEAST_SPAN, ceil(at[0])), residual.size // 2)
    moved, left = servo_log.position[task.first :], np.cumsum(residual)
    share = np.sqrt(np.mean((left[span:] - left[:-span]) ** 2) / np.mean((moved[span:] - moved[:-span]) ** 2))
    return ServoFit(
        task,
        at,
        estimate("servo.delay", delays, float(sigma[0]) * T, jitter),
        estimate("servo.bandwidth_hz", bands, float(sigma[1]) * bands[-1], 0.0),
        jitter,
        cost,
        inflation,
        residual,
        float(share),
        max(bands) < 0.99 * BANDWIDTHS[1] / T,
        (float(at[0]) + factor * of_latency) * T,
    )


def _end(task: Task, at: Floats, allowance: float, side: int, sigma: float) -> Floats:
    """Return the parameters at one end of the bandwidth's interval, at which chi2 exceeds the least by `allowance`."""
    limit, most = log(BANDWIDTHS[0 if side < 0 else 1]), task.chi2(at) + allowance
    inside, step = at, min(max(sigma, 1e-5), 0.5)
    for _ in range(60):
        further = task.best_latency(inside, inside[1] + side * step)
        if task.chi2(further) > most:
            break
        if side * (further[1] - limit) >= 0:
            return further
        inside, step = further, 2 * step
    for _ in range(12):
        if abs(further[1] - inside[1]) < 0.05 * abs(inside[1] - at[1]) + 1e-6:
            break
        middle = task.best_latency(inside, 0.5 * (inside[1] + further[1]))
        inside, further = (inside, middle) if task.chi2(middle) > most else (middle, further)
    return further


def _jitter(task: Task, residual: Floats, lag: float) -> float:
    """Return the standard deviation of a link's delay, s, from the motion that windows of rows leave unexplained."""
    window = max(ceil(2 * lag) + 2, 4)
    count = residual.size // window
    if count < 10:
        return 0.0
    exposed = task.exposed[1 : 1 + count * window].reshape(count, window).sum(axis=1)
    values, encoder = residual, 2 * task.encoder**2
    if task.log.is_position:
        values = np.cumsum(residual)
        values, encoder, exposed = (values - values.mean()) / window, encoder / 2 / window, exposed / window**2
    beyond = values[: count * window].reshape(count, window).sum(axis=1) ** 2 - encoder
    total, unsure = float(beyond.sum()), float(np.sqrt(np.sum((beyond - beyond.mean()) ** 2)))
    return float(np.sqrt(total / exposed.sum())) if total > 3 * unsure > 0 else 0.0


def servo_study(recording: Recording, T: float) -> Study:
    """Fit both orders of a servo to a recording and decide between them."""
    servo_log, name = servo_log_of(recording, T), recording.name
    try:
        with np.errstate(divide="raise", invalid="raise"):
            fit, other = fit_servos(servo_log)
    except (FloatingPointError, ValueError, np.linalg.LinAlgError):  # no part of the motion fits the command
        headers = recording.channels[commanded(recording)].header, recording.channels["position"].header
        question = "is {} the command of another axis or of another time than {}?".format(*headers)
        message = f"the motion does not follow the command anywhere: {question}"
        raise unexplained(recording, message, headers[0]) from None
    order_is_known = other.cost - fit.cost > DECISIVE_GAIN * max(fit.inflation, other.inflation)
    fits = [fit] if order_is_known else [fit, other]
    _refuse(recording, fits)
    task, at, remarks = fit.task, fit.at, list[Note]()
    white_steps = task.whitened(task.steps(at))[0]
    block = ceil(sqrt(len(white_steps)))
    starts, gain = np.arange(0, len(white_steps), block), task.gain(at)
    gain_sigma = sqrt(float(jackknife(white_steps[:, 1:], task.white(at), starts)[0, 0]))
    numbers = [
        number("delay", fit.delay.value, fit.delay.sigma),
        number("bandwidth, Hz", fit.bandwidth.value, fit.bandwidth.sigma),
        number("motion over command", gain, gain_sigma),
        number("jitter of the delay", fit.jitter),
        number("noise of a position", task.encoder),
    ]
    if not order_is_known:
        text = f"{name}: orders 1 and 2 explain it equally well: the box contains both, and unmodelled covers the rest"
        remarks.append(Note("remark-order", text))
    if fit.jitter > 0.01 * T:
        text = f"{name}: the delay jitters by {fit.jitter:.2g} s from command to command, which its interval includes; "
        remarks.append(Note("remark-jitter", f"{text}proofs assume a constant delay"))
    if not all(each.is_bounded for each in fits):
        text = f"{name}: shows a latency of {fit.latency:.3g} s, and not how much of it is a low-pass: record a sweep "
        remarks.append(Note("remark-latency-only", f"{text}up to a tenth of the sampling rate or higher"))
    if abs(gain - 1) > max(SIGNIFICANT * gain_sigma, 2e-3):
        text = f"{name}: moves {gain:.4g} times as far as it is told, which a servo does not: unmodelled covers it"
        remarks.append(Note("warn-gain", text))
    force = recording.values("hand" if "hand" in recording.channels else "force")
    if force is not None and np.ptp(force) > 0:
        yields, compliances = _yielding(recording, fit, force)
        numbers, remarks = [*numbers, *compliances], [*remarks, *yields]
    rows = slice(task.first, None)
    made = gain * positions(servo_log.time, servo_log.velocity, *task.numbers(at), task.order)[rows]
    measured = servo_log.position[rows]
    made += float(np.mean(measured - made))
    candidates = [
        CandidateRecord(
            structure=f"order {one.task.order}", chosen=one is fit, chi2=_chi2(one, task.encoder, task.link),
            model_error=[one.residual_share],
        )
        for one in (fit, other)
    ]  # fmt: skip
    record = record_of(
        recording, T,
        kind=f"a servo told its {'position' if servo_log.is_position else 'velocity'}, order {task.order}",
        used=fit.residual.size + 1, residual_share=fit.residual_share,
        chi2=_chi2(fit, task.encoder, 0.0), numbers=numbers,
        derived=[number("latency, hold aside", fit.latency)], candidates=candidates,
    )  # fmt: skip
    estimates = [
        replace(each, source=f"{name}: order {one.task.order}") for one in fits for each in (one.delay, one.bandwidth)
    ]
    inflation = max(fit.inflation, other.inflation)
    lines = [_bands(fit, other), *([] if order_is_known else [_of_fit(fit, other), _of_fit(other, fit)])]
    orders = {one.task.order: one.cost / inflation for one in (fit, other)}
    curves = Curves(servo_log.time[rows], measured, made)
    return Study(recording, record, "motion", estimates, lines, curves, remarks, servo_orders=orders)


def _chi2(fit: ServoFit, encoder: float, link: float) -> float:
    """Return the power of a fit's residual divided by the power of a given noise, per row."""
    return float(np.mean(replace(fit.task, encoder=encoder, link=link).whitened(fit.residual)[0] ** 2))


def _refuse(recording: Recording, fits: Sequence[ServoFit]) -> None:
    """Refuse a recording whose motion does not follow its command, or follows it with an impossible gain."""
    header, position = recording.channels[commanded(recording)].header, recording.channels["position"].header
    fit, factor = fits[0], joint_factor(2)
    gain = fit.task.gain(fit.at)
    highs = [
        min(each.delay.value + factor * each.delay.sigma + each.delay.excess[1] - each.jitter, each.latest)
        for each in fits
    ]
    if -max(highs) > AHEAD * fit.task.log.T:
        message = (
            f"{position} moves at least {-1e3 * max(highs):.3g} ms before {header} tells it to: the two were not "
            "sampled together, or the command is logged late"
        )
    elif fit.residual_share > MAX_RESIDUAL_SHARE:
        message = (
            f"{fit.residual_share:.0%} of the motion of {position} does not follow {header}: is it the command "
            "of another axis, or was the robot moved by something else?"
        )
    elif gain < 0:
        message = f"{position} moves against {header}; turn one sign by scale = -1"
    elif not GAIN_RANGE[0] < gain < GAIN_RANGE[1]:
        message = f"{position} moves {gain:.4g} times as far as {header} says; write the unit or scale of one of them"
    else:
        return
    raise unexplained(recording, message, header)


def _yielding(recording: Recording, fit: ServoFit, force: Floats) -> tuple[list[Note], list[NumberRecord]]:
    """Return a warning if a part of the motion follows the force, and compliance and mobility, fitted together with
    gain, delay and bandwidth."""
    task, at, units = fit.task, fit.at, recording.units
    pushed = np.stack([np.diff(force)[task.first :], (force * task.log.T)[task.first + 1 :]], axis=1)
    predicted, steps = task.steps(at)[:, 1], [task.steps(at + h)[:, 1] for h in CHANGE * np.eye(2)]
    columns = np.column_stack([pushed, predicted, *(each - predicted for each in steps)])
    scale = np.sqrt(np.mean(columns**2, axis=0))
    white = task.whitened(np.column_stack([fit.residual, columns / scale]))[0]
    values = np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
    starts = np.arange(0, len(white), ceil(sqrt(len(white))))
    sigma = np.sqrt(np.diag(jackknife(white[:, 1:], white[:, 0] - white[:, 1:] @ values, starts)))
    motion = np.abs(values[:2]) * np.std(np.cumsum(columns[:, :2] / scale[:2], axis=0), axis=0)
    share = motion / np.std(task.log.position[task.first :])
    significant = (np.abs(values[:2]) > SIGNIFICANT * sigma[:2]) & (share > LEAST_YIELDING)
    found, unsure = values / scale, sigma / scale
    texts = [f"{value:.3g} {unit}" for value, unit in zip(found, (units.compliance, units.mobility), strict=False)]
    warning = (
        f"{recording.name}: the servo yields: {(share * significant).max():.1%} of its motion goes with the force, "
        f"{' and '.join(text for text, yes in zip(texts, significant, strict=True) if yes)}. Such a device is outside "
        "the model, in which the motion follows the command alone: no claim about the file holds for it"
    )
    names = f"compliance, {units.compliance}", f"mobility, {units.mobility}"
    records = [number(name, found[i], unsure[i]) for i, name in enumerate(names)]
    return [Note("warn-yields", warning)] if significant.any() else [], records


def _bands(fit: ServoFit, other: ServoFit) -> Lines:
    """Return the measured response in the bands in which the log shows it."""
    task, T = fit.task, fit.task.log.T
    measured, made = task.steps(fit.at).T
    window = np.hanning(made.size)
    M, E = np.fft.rfft(window * made), np.fft.rfft(window * (measured - made))
    f = np.fft.rfftfreq(made.size, T)
    edges = LOWEST * f[1] * 2 ** np.arange(0, np.log2(0.5 / T / (LOWEST * f[1])), 1 / PER_OCTAVE)
    band, rows = np.digitize(f, np.append(edges, 0.5 / T)), []
    for i in range(1, edges.size + 1):
        inside = band == i
        power = float(np.sum(np.abs(M[inside]) ** 2))
        if power > 0 and inside.sum() >= 2:
            deviation = complex(np.sum(np.conj(M[inside]) * E[inside])) / power
            noise = float(np.sum(np.abs(E[inside] - deviation * M[inside]) ** 2)) / power
            middle = float(np.sum(f[inside] * np.abs(M[inside]) ** 2)) / power
            rows.append((middle, 1 + deviation, sqrt(noise / max(float(inside.sum()) / HANN, 1.0))))
    hertz, ratio, spread = (np.array(column) for column in zip(*rows, strict=True))
    clear = spread < CLEAR
    fitted = _response(fit, hertz[clear])
    return _lines(fit, other, hertz[clear], ratio[clear] * fitted, spread[clear], fitted)


def _of_fit(fit: ServoFit, other: ServoFit) -> Lines:
    """Return the response of a fit, which the disc must cover if the order is not known."""
    hertz = np.geomspace(1e-3, 0.499, BEYOND) / fit.task.log.T
    response = _response(fit, hertz)
    return _lines(fit, other, hertz, response, np.zeros(BEYOND), response)


def _response(fit: ServoFit, hertz: Floats) -> Complex:
    delay, bandwidth = fit.task.numbers(fit.at)
    return sampled_response(2 * pi * hertz, fit.task.log.T, max(delay, 0.0), bandwidth, fit.task.order)


def _lines(fit: ServoFit, other: ServoFit, hertz: Floats, ratio: Complex, spread: Floats, fitted: Complex) -> Lines:
    """Return lines that are compared with servos of the box at random, and with some that have the fit's latency."""

    def model(device: Device) -> Complex:
        servo = device.servo
        assert servo is not None
        return sampled_response(2 * pi * hertz, device.sample_time, servo.delay, servo.bandwidth_hz, servo.order)

    def more(device: Device, bounds: Sequence[Bounded]) -> list[Device]:
        assert device.servo is not None
        order, ends = device.servo.order, {b.key: (b.value * (1 - b.share), b.value * (1 + b.share)) for b in bounds}
        one = fit if fit.task.order == order else other
        slowest, fastest = ends["servo.bandwidth_hz"]
        mine = float(np.clip(one.bandwidth.value, slowest, fastest))
        found = []
        for bandwidth in (*np.geomspace(slowest, fastest, RIDGE), mine):
            delay = float(np.clip(one.latency - modes(bandwidth, order)[0], *ends["servo.delay"]))
            found.append(device.with_numbers({"servo.delay": delay, "servo.bandwidth_hz": float(bandwidth)}))
        return found

    return Lines(hertz, ratio, spread, fitted, model, more=more)
