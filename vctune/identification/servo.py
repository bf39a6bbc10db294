"""Fit delay and low-pass of a vendor's servo to the steps of its position (README, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, log, pi, sqrt

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import Bounded, CandidateRecord, Estimate, NumberRecord
from vctune.document.schema.rules import MAX_DELAY_SAMPLES
from vctune.document.text.errors import Note, coded
from vctune.identification.box import jackknife, joint_factor, unexplained
from vctune.identification.checks import position_noise
from vctune.identification.responses import modes, servo_response
from vctune.identification.study import Complex, Curves, Lines, Study, number, record_of
from vctune.model.device import Device

# Lower and upper ends of the search: latency (the sum of delay and lag) in samples, and logarithm of the bandwidth as a
# share of the sampling rate
LOW, HIGH = np.array([-5.0, log(2e-4)]), np.array([2.0 * MAX_DELAY_SAMPLES + 800.0, log(8.0)])
STARTS, ELSEWHERE = 24, 14  # Numbers of bandwidths from which the search starts, and at which it looks again
SETTLING_LAGS = 6.0  # Time after which motion before the log has no effect, in lags of the servo
LEAST_SPAN = 8  # Least number of rows over which a step of the motion is measured
CHANGE = 1e-4  # Step of a derivative
AHEAD = 0.25  # Greatest time by which a motion may seem to precede its command, in samples
DECISIVE_GAIN = 10.0  # Gain in -2 log likelihood, for independent residuals, that decides between the orders
MAX_RESIDUAL_SHARE, GAIN_RANGE = 0.5, (0.8, 1.25)  # Of the motion; beyond these a log is refused
SIGNIFICANT, LEAST_YIELDING = 4.0, 0.005  # Deviations, and share of the motion, with which a servo yields
PER_OCTAVE, LOWEST, HANN = 3, 3.0, 1.5  # Bands; lower edge of the first, and a window's width, in frequency steps
CLEAR = 0.02  # Greatest relative standard deviation of a band's ratio
RIDGE, BEYOND = 40, 40  # Numbers of servos with a fit's latency, and of frequencies of the other order
LATENCY = coded("a delay and a lag are alike in this motion", "limit-latency")
JITTER = coded("jitter", "limit-jitter")


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


@dataclass(frozen=True, slots=True)
class Task:
    """The least-squares problem of the steps of a log. Its unknowns are those of `LOW`.

    A step is late by noise e[k] - kept e[k - 1]: an encoder's, which the next step takes back, and a link's jitter,
    which stays.
    """

    time: Floats  # times of the rows, s
    velocity: Floats  # commanded velocity, held from each row to the next, m/s
    position: Floats  # measured, m
    T: float
    is_position: bool  # whether the command is a position, which the servo interpolates
    encoder: float  # standard deviation of a position sample, m, and the least one that its rounding permits
    rounding: float
    sigma: float = 1.0  # standard deviation of e, m
    kept: float = 0.5
    order: int = 1
    first: int = 0  # first row

    def numbers(self, at: Floats) -> tuple[float, float]:
        """Return delay, s, and bandwidth, Hz."""
        bandwidth = float(np.exp(at[1])) / self.T
        return float(at[0]) * self.T - modes(bandwidth, self.order)[0], bandwidth

    def steps(self, at: Floats) -> Floats:
        """Return the measured and the predicted steps, m, shape (n, 2)."""
        predicted = positions(self.time, self.velocity, *self.numbers(at), self.order)
        return np.diff(np.stack([self.position, predicted], axis=1)[self.first :], axis=0)

    def whitened(self, steps: Floats) -> Floats:
        """Return steps whose noise is white and of unit variance, without the noise of the first row."""
        from scipy.signal import lfilter

        white = np.asarray(lfilter([1.0], [1.0, -self.kept], steps, axis=0)) / self.sigma
        before = self.kept ** np.arange(len(white))
        return white - np.multiply.outer(before, before @ white / (before @ before))

    def gain(self, at: Floats) -> float:
        """Return the ratio of the servo's motion to its command."""
        measured, predicted = self.whitened(self.steps(at)).T
        return float(measured @ predicted / (predicted @ predicted))

    def residual(self, at: Floats) -> Floats:
        """Return the part of the steps that given parameters leave unexplained, m."""
        return np.asarray(self.steps(at) @ [1.0, -self.gain(at)])

    def white(self, at: Floats) -> Floats:
        """Return the whitened residual."""
        return self.whitened(self.residual(at))

    def slopes(self, at: Floats) -> Floats:
        """Return the derivatives of `white`, shape (n, 2)."""
        return np.stack([(self.white(at + h) - self.white(at - h)) / (2 * CHANGE) for h in CHANGE * np.eye(2)], axis=1)

    def chi2(self, at: Floats) -> float:
        """Return the sum of the squares of `white`."""
        return float(np.sum(self.white(at) ** 2))

    def settled(self, at: Floats) -> int:
        """Return the first row that no motion before the log moves."""
        lag = modes(float(np.exp(at[1])), self.order)[0]
        return min(ceil(max(float(at[0]), 0.0) + SETTLING_LAGS * lag) + 2, self.time.size // 4)

    def likeliest(self, at: Floats) -> tuple[Task, float]:
        """Return the task with the noise that makes the residual likeliest, and -2 log likelihood."""
        from scipy.optimize import minimize_scalar

        residual = self.residual(at)

        def variance(kept: float) -> float:
            return float(np.mean(replace(self, kept=kept, sigma=1.0).whitened(residual) ** 2))

        kept = float(minimize_scalar(variance, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-4}).x)
        sigma = max(sqrt(variance(kept)), self.rounding)
        return replace(self, kept=kept, sigma=sigma), residual.size * (variance(kept) / sigma**2 + 2 * log(sigma))

    def refined(self, at: Floats) -> tuple[Task, Floats]:
        """Return the task with the likeliest noise near given parameters, and the parameters that then fit best."""
        from scipy.optimize import least_squares

        task = self.likeliest(at)[0]
        return task, np.asarray(least_squares(task.white, at, jac=task.slopes, bounds=(LOW, HIGH)).x)

    def best_latency(self, at: Floats, logarithm: float) -> Floats:
        """Return the parameters with the best latency at another bandwidth."""
        from scipy.optimize import least_squares

        def left(latency: Floats) -> Floats:
            return self.white(np.array([latency[0], logarithm]))

        found = least_squares(left, at[:1], diff_step=1e-6, bounds=(LOW[:1], HIGH[:1]), xtol=1e-5)
        return np.array([found.x[0], logarithm])

    def end(self, at: Floats, most: float, step: float) -> Floats:
        """Return the parameters at an end of the bandwidth's interval, where chi2, minimised over the latency, is
        `most`. The sign of the first step says which end."""
        from scipy.optimize import brentq

        inside, limit = at, float((LOW if step < 0 else HIGH)[1])
        while True:
            further = self.best_latency(inside, float(np.clip(inside[1] + step, LOW[1], HIGH[1])))
            if self.chi2(further) > most:
                break
            if further[1] == limit:
                return further
            inside, step = further, 2 * step

        def beyond(logarithm: float) -> float:
            return self.chi2(self.best_latency(inside, logarithm)) - most

        tolerance = 0.02 * abs(further[1] - at[1]) + 1e-6
        return self.best_latency(inside, float(brentq(beyond, inside[1], further[1], xtol=tolerance)))


@dataclass(frozen=True, slots=True)
class ServoFit:
    """The fit of a servo of one order."""

    task: Task
    at: Floats
    delay: Estimate  # their intervals hold at the same time
    bandwidth: Estimate
    jitter: float  # standard deviation of the delay from command to command, s; 0 if it is not significant
    cost: float  # -2 log likelihood
    inflation: float  # factor by which correlation of the residuals increases a variance
    residual_share: float
    is_bounded: bool  # whether the bandwidth's interval ends below the highest bandwidth
    latest: float  # greatest delay that the motion permits, s: a lag is not negative, so it is at most the latency's

    def response(self, hertz: Floats) -> Complex:
        """Return the response of the fitted servo."""
        delay, bandwidth = self.task.numbers(self.at)
        return servo_response(2 * pi * hertz, self.task.T, max(delay, 0.0), bandwidth, self.task.order)


def _task(recording: Recording, T: float, command: str) -> Task:
    """Return the columns of a recording, and the least noise that the encoder's rounding permits."""
    position, logged, commands = recording.channels["position"], recording.values("time"), recording.values(command)
    time = np.asarray(np.arange(len(recording)) * T if logged is None else logged - logged[0], dtype=np.float64)
    assert commands is not None
    steps = np.abs(np.diff(position.values))
    quantum = position.quantum or float(steps[steps > 0].min(initial=np.inf))
    encoder = position_noise(position.values, position.quantum)
    is_position = command == "position_command"
    velocity = interpolating_velocity(time, commands) if is_position else commands
    least = 1e-9 * float(np.ptp(position.values))
    rounding = max(min(quantum / sqrt(12), encoder), least)
    return Task(time, velocity, position.values, T, is_position, max(encoder, least), rounding)


def _coarse(task: Task) -> Floats:
    """Return the unknowns for the best of several bandwidths and a delay in whole samples, by correlation."""
    n, T = task.time.size, task.T
    measured, size = np.diff(task.position), 2 ** ceil(np.log2(2 * n))
    transform, power = np.conj(np.fft.rfft(measured, size)), np.append(0.0, np.cumsum(measured**2))
    shifts, best, least = np.arange(min(MAX_DELAY_SAMPLES + 1, n // 4)), np.zeros(2), np.inf
    for logarithm in np.linspace(LOW[1] + log(10), HIGH[1] - log(8), STARTS):
        bandwidth = float(np.exp(logarithm)) / T
        steps = np.diff(positions(task.time, task.velocity, 0.0, bandwidth, task.order))
        correlation = np.fft.irfft(np.conj(transform * np.fft.rfft(steps, size)), size)[: shifts.size]
        predicted = np.append(0.0, np.cumsum(steps**2))[n - 1 - shifts]
        left = (power[-1] - power[shifts] - correlation**2 / np.maximum(predicted, 1e-300)) / (n - shifts)
        shift = int(np.argmin(left))
        if left[shift] < least:
            least, best = float(left[shift]), np.array([shift + modes(bandwidth, task.order)[0] / T, logarithm])
    return best


def fit_servos(task: Task) -> tuple[ServoFit, ServoFit]:
    """Fit servos of order 1 and of order 2 to the same rows; the likelier is first."""
    found = []
    for order in (1, 2):
        one = replace(task, order=order)
        at = _coarse(one)
        for _ in range(3):
            one, at = replace(one, first=one.settled(at)).refined(at)
        grid = np.linspace(LOW[1] + log(10), HIGH[1] - log(4), ELSEWHERE)
        at = min([at, *(one.best_latency(at, logarithm) for logarithm in grid)], key=one.chi2)
        found.append((one, at))
    first = max(one.settled(at) for one, at in found)
    fits = [_with_intervals(*replace(one, first=first).refined(at)) for one, at in found]
    likelier, other = sorted(fits, key=lambda fit: fit.cost)
    return likelier, other


def _with_intervals(task: Task, at: Floats) -> ServoFit:
    """Return the fit at its best parameters, with intervals that allow for correlated residuals."""
    T, lag = task.T, modes(task.numbers(at)[1], task.order)[0] / task.T
    task, cost = task.likeliest(at)
    white, slopes, residual = task.white(at), task.slopes(at), task.residual(at)
    block = ceil(max(np.sqrt(white.size), 3 * lag))
    # the lag falls as the bandwidth rises: to the covariance of delay and log bandwidth
    to_delay = np.array([[1.0, lag], [0.0, 1.0]])
    covariances = jackknife(slopes, white, np.arange(0, white.size, block)), np.linalg.inv(slopes.T @ slopes)
    robust, plain = (np.diag(to_delay @ each @ to_delay.T) for each in covariances)
    inflation, sigmas = max(1.0, float(np.max(robust / plain))), np.sqrt(np.maximum(robust, plain))
    factor, of_latency = joint_factor(2), float(np.sqrt(max(each[0, 0] for each in covariances)))
    most, step = task.chi2(at) + factor**2 * inflation, min(max(float(sigmas[1]), 1e-5), 0.5)
    ends = [task.end(at, most, side * step) for side in (-1, 1)]
    delays, bands = zip(*(task.numbers(each) for each in (*ends, at)), strict=True)
    jitter = _jitter(task, residual, lag)

    def estimate(key: str, values: Sequence[float], sigma: float, more: float) -> Estimate:
        value, low, high = values[-1], min(values), max(values)
        sigma = min(sigma, 1.5 * min(value - low, high - value) / factor)
        beyond = [max(each - factor * sigma, 0.0) for each in (value - low, high - value)]
        reason = JITTER if more > max(beyond) else LATENCY
        source = f"order {task.order}"
        return Estimate(key, value, sigma, source, (beyond[0] + more, beyond[1] + more), reason)

    span = min(max(LEAST_SPAN, ceil(at[0])), residual.size // 2)
    moved, left = task.position[task.first :], np.cumsum(residual)
    share = np.sqrt(np.mean((left[span:] - left[:-span]) ** 2) / np.mean((moved[span:] - moved[:-span]) ** 2))
    delay = estimate("servo.delay", delays, float(sigmas[0]) * T, jitter)
    bandwidth = estimate("servo.bandwidth_hz", bands, float(sigmas[1]) * bands[-1], 0.0)
    latest = (float(at[0]) + factor * of_latency) * T
    is_bounded = max(bands) < 0.99 * exp(HIGH[1]) / T
    return ServoFit(task, at, delay, bandwidth, jitter, cost, inflation, float(share), is_bounded, latest)


def _jitter(task: Task, residual: Floats, lag: float) -> float:
    """Return the standard deviation of a link's delay, s, from the motion that windows of rows leave unexplained."""
    window = max(ceil(2 * lag) + 2, 4)
    count = residual.size // window
    if count < 10:
        return 0.0
    # a late position command shifts the motion once, by its speed; a velocity command for good, by its jump
    by = task.velocity if task.is_position else np.diff(task.velocity, prepend=task.velocity[0])
    exposed, noise = by[task.first + 1 :] ** 2, 2 * task.encoder**2
    values = np.cumsum(residual) - np.mean(np.cumsum(residual)) if task.is_position else residual
    noise = window * task.encoder**2 if task.is_position else noise
    beyond = values[: count * window].reshape(count, window).sum(axis=1) ** 2 - noise
    total, unsure = float(beyond.sum()), float(np.sqrt(np.sum((beyond - beyond.mean()) ** 2)))
    return sqrt(total / float(exposed[: count * window].sum())) if total > 3 * unsure > 0 else 0.0


def servo_study(recording: Recording, T: float) -> Study:
    """Fit both orders of a servo to a recording and decide between them."""
    name, channels, remarks = recording.name, recording.channels, list[Note]()
    command = "velocity_command" if "velocity_command" in channels else "position_command"
    header, place = channels[command].header, channels["position"].header
    try:
        with np.errstate(divide="raise", invalid="raise"):
            fit, other = fit_servos(_task(recording, T, command))
    except (FloatingPointError, ValueError, np.linalg.LinAlgError):  # no part of the motion fits the command
        question = f"is {header} the command of another axis or of another time than {place}?"
        raise unexplained(recording, f"the motion does not follow the command anywhere: {question}", header) from None
    inflation = max(fit.inflation, other.inflation)
    order_is_known = other.cost - fit.cost > DECISIVE_GAIN * inflation
    fits, task, at, gain = [fit] if order_is_known else [fit, other], fit.task, fit.at, fit.task.gain(fit.at)
    _refuse(recording, fits, gain, header, place)
    white = task.whitened(task.steps(at))
    starts = np.arange(0, len(white), ceil(sqrt(len(white))))
    gain_sigma = sqrt(float(jackknife(white[:, 1:], task.white(at), starts)[0, 0]))
    numbers = [
        number("delay", fit.delay.value, fit.delay.sigma),
        number("bandwidth, Hz", fit.bandwidth.value, fit.bandwidth.sigma),
        number("motion over command", gain, gain_sigma),
        number("jitter of the delay", fit.jitter),
        number("noise of a position", task.encoder),
    ]
    latency = float(at[0]) * T
    if not order_is_known:
        text = f"{name}: orders 1 and 2 explain it equally well: the box contains both, and unmodelled covers the rest"
        remarks.append(Note("remark-order", text))
    if fit.jitter > 0.01 * T:
        text = f"{name}: the delay jitters by {fit.jitter:.2g} s from command to command, which its interval includes; "
        remarks.append(Note("remark-jitter", f"{text}proofs assume a constant delay"))
    if not all(each.is_bounded for each in fits):
        text = f"{name}: shows a latency of {latency:.3g} s, and not how much of it is a low-pass: record a sweep "
        remarks.append(Note("remark-latency-only", f"{text}up to a tenth of the sampling rate or higher"))
    if abs(gain - 1) > max(SIGNIFICANT * gain_sigma, 2e-3):
        text = f"{name}: moves {gain:.4g} times as far as it is told, which a servo does not: unmodelled covers it"
        remarks.append(Note("warn-gain", text))
    force = recording.values("hand" if "hand" in channels else "force")
    if force is not None and np.ptp(force) > 0:
        yields, compliances = _yielding(recording, fit, force)
        numbers, remarks = [*numbers, *compliances], [*remarks, *yields]
    measured = task.position[task.first :]
    made = gain * positions(task.time, task.velocity, *task.numbers(at), task.order)[task.first :]
    made += float(np.mean(measured - made))
    chi2 = float(np.mean(task.residual(at) ** 2)) / (2 * task.encoder**2)
    candidates = [
        CandidateRecord(
            structure=f"order {one.task.order}", chosen=one is fit, chi2=one.task.sigma**2 / task.sigma**2,
            model_error=[one.residual_share],
        )
        for one in (fit, other)
    ]  # fmt: skip
    record = record_of(
        recording, T,
        kind=f"a servo told its {'position' if task.is_position else 'velocity'}, order {task.order}",
        used=measured.size, residual_share=fit.residual_share, chi2=chi2, numbers=numbers,
        derived=[number("latency, hold aside", latency)], candidates=candidates,
    )  # fmt: skip
    estimates = [replace(each, source=f"{name}: {each.source}") for one in fits for each in (one.delay, one.bandwidth)]
    lines, hertz = [_lines(fit, other, *_bands(fit))], np.geomspace(1e-3, 0.499, BEYOND) / T
    if not order_is_known:  # the disc must cover both
        lines += [_lines(fit, other, hertz, one.response(hertz), np.zeros(BEYOND)) for one in fits]
    curves = Curves(task.time[task.first :], measured, made)
    orders = {one.task.order: one.cost / inflation for one in (fit, other)}
    return Study(recording, record, estimates, lines, curves, remarks, servo_orders=orders)


def _refuse(recording: Recording, fits: Sequence[ServoFit], gain: float, header: str, place: str) -> None:
    """Refuse a recording whose motion does not follow its command, or follows it with an impossible gain."""
    fit, factor = fits[0], joint_factor(2)
    latest = max(
        min(one.delay.value + factor * one.delay.sigma + one.delay.excess[1] - one.jitter, one.latest) for one in fits
    )
    if -latest > AHEAD * fit.task.T:
        message = (
            f"{place} moves at least {-1e3 * latest:.3g} ms before {header} tells it to: the two were not sampled "
            "together, or the command is logged late"
        )
    elif fit.residual_share > MAX_RESIDUAL_SHARE:
        message = (
            f"{fit.residual_share:.0%} of the motion of {place} does not follow {header}: is it the command of another "
            "axis, or was the robot moved by something else?"
        )
    elif gain < 0:
        message = f"{place} moves against {header}; turn one sign by scale = -1"
    elif not GAIN_RANGE[0] < gain < GAIN_RANGE[1]:
        message = f"{place} moves {gain:.4g} times as far as {header} says; write the unit or scale of one of them"
    else:
        return
    raise unexplained(recording, message, header)


def _yielding(recording: Recording, fit: ServoFit, force: Floats) -> tuple[list[Note], list[NumberRecord]]:
    """Return a warning if a part of the motion follows the force, and compliance and mobility, fitted together with
    gain, delay and bandwidth."""
    task, at, units = fit.task, fit.at, recording.units
    pushed = np.stack([np.diff(force)[task.first :], (force * task.T)[task.first + 1 :]], axis=1)
    predicted, steps = task.steps(at)[:, 1], [task.steps(at + h)[:, 1] for h in CHANGE * np.eye(2)]
    columns = np.column_stack([pushed, predicted, *(each - predicted for each in steps)])
    scale = np.sqrt(np.mean(columns**2, axis=0))
    white = task.whitened(np.column_stack([task.residual(at), columns / scale]))
    values = np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
    starts = np.arange(0, len(white), ceil(sqrt(len(white))))
    sigma = np.sqrt(np.diag(jackknife(white[:, 1:], white[:, 0] - white[:, 1:] @ values, starts)))
    motion = np.abs(values[:2]) * np.std(np.cumsum(columns[:, :2] / scale[:2], axis=0), axis=0)
    share = motion / np.std(task.position[task.first :])
    significant = (np.abs(values[:2]) > SIGNIFICANT * sigma[:2]) & (share > LEAST_YIELDING)
    found, names = (values / scale)[:2], (("compliance", units.compliance), ("mobility", units.mobility))
    texts = [f"{found[i]:.3g} {unit}" for i, (_, unit) in enumerate(names) if significant[i]]
    warning = (
        f"{recording.name}: the servo yields: {(share * significant).max():.1%} of its motion goes with the force, "
        f"{' and '.join(texts)}. Such a device is outside the model, in which the motion follows the command alone: no "
        "claim about the file holds for it"
    )
    records = [number(f"{names[i][0]}, {names[i][1]}", found[i], sigma[i] / scale[i]) for i in range(2)]
    return [Note("warn-yields", warning)] if texts else [], records


def _bands(fit: ServoFit) -> tuple[Floats, Complex, Floats]:
    """Return frequencies, response and its relative deviation in the bands in which the log shows it."""
    measured, made = fit.task.steps(fit.at).T
    window, f = np.hanning(made.size), np.fft.rfftfreq(made.size, fit.task.T)
    M, E = np.fft.rfft(window * made), np.fft.rfft(window * (measured - made))
    edges = LOWEST * f[1] * 2 ** np.arange(0, np.log2(0.5 / fit.task.T / (LOWEST * f[1])), 1 / PER_OCTAVE)
    band, rows = np.digitize(f, edges), []
    for i in range(1, edges.size + 1):
        inside = (band == i) & (f < 0.5 / fit.task.T)
        power = float(np.sum(np.abs(M[inside]) ** 2))
        if power > 0 and inside.sum() >= 2:
            deviation = complex(np.sum(np.conj(M[inside]) * E[inside])) / power
            noise = float(np.sum(np.abs(E[inside] - deviation * M[inside]) ** 2)) / power
            spread = sqrt(noise / max(float(inside.sum()) / HANN, 1.0))
            if spread < CLEAR:
                rows.append((float(np.sum(f[inside] * np.abs(M[inside]) ** 2)) / power, 1 + deviation, spread))
    hertz, ratio, spread_of = (np.array([row[i] for row in rows]) for i in range(3))
    return hertz.astype(float), ratio * fit.response(hertz.astype(float)), spread_of.astype(float)


def _lines(fit: ServoFit, other: ServoFit, hertz: Floats, ratio: Complex, spread: Floats) -> Lines:
    """Return lines that are compared with servos of the box at random, and with some that have the fit's latency."""

    def model(device: Device) -> Complex:
        servo = device.servo
        assert servo is not None and servo.bandwidth_hz is not None
        return servo_response(2 * pi * hertz, device.sample_time, servo.delay, servo.bandwidth_hz, servo.order)

    def more(device: Device, bounds: Sequence[Bounded]) -> list[Device]:
        assert device.servo is not None
        order, ends = device.servo.order, {b.key: (b.value * (1 - b.share), b.value * (1 + b.share)) for b in bounds}
        one = fit if fit.task.order == order else other
        slowest, fastest = ends["servo.bandwidth_hz"]
        mine, latency = float(np.clip(one.bandwidth.value, slowest, fastest)), float(one.at[0]) * one.task.T
        found = []
        for bandwidth in (*np.geomspace(slowest, fastest, RIDGE), mine):
            delay = float(np.clip(latency - modes(bandwidth, order)[0], *ends["servo.delay"]))
            found.append(device.with_numbers({"servo.delay": delay, "servo.bandwidth_hz": float(bandwidth)}))
        return found

    return Lines(hertz, ratio, spread, fit.response(hertz), model, more=more)
