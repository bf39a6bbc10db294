"""Detect a periodic excitation, and average its lines, each with its variance (README, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Channel, Floats, Recording

Complex = NDArray[np.complex128]
LEAST_PERIODS = 4  # Least number of periods
LEAST_LINES = 8  # Least number of excited lines
REPEATS = 0.9  # Least correlation of a column with itself one period later
EXCITED = 0.05  # Least amplitude of an excited line, relative to the greatest amplitude
ABOVE_NOISE = 5.0  # Least amplitude of an excited line, in standard deviations of the line's mean
FINER = 32  # Number of points per sample for the direction of motion
MOST_POINTS = 1 << 21  # Greatest number of points in half a period
HIGHEST_LINE = 0.45  # Frequency of the highest line, as a share of the sampling rate


@dataclass(frozen=True, slots=True)
class Lines:
    """A response at the excited lines."""

    omega: Floats  # frequencies, rad/s, shape (n,)
    ratio: Complex  # ratio of output to input, averaged over periods, shape (n,)
    spread: Floats  # relative standard deviation of this average, for real and imaginary part together, shape (n,)
    coherence: Floats  # coherence between periods, shape (n,)


@dataclass(frozen=True, slots=True)
class Response:
    """The results of a periodic recording."""

    period: int  # length of a period in samples
    periods: int  # number of averaged periods
    input: str  # "force" or "command", the column by which position and handle are divided
    position: Lines  # responses, m/N; handle is None if it was not recorded
    handle: Lines | None
    drive: Lines | None  # response from command to force; None unless both were recorded
    friction: Complex  # lines of a Coulomb friction of 1 N, divided by the lines of the input, 1/N
    speed: float  # root mean square speed of the motor, m/s
    sample_time: float  # T, s


def response(recording: Recording, sample_time: float) -> Response | None:
    """Return the averaged response of a recording; None if it is not periodic, or has fewer than `LEAST_LINES`
    lines."""
    excited = recording.values("command")
    excited = recording.values("force") if excited is None else excited
    period = None if excited is None else find_period(excited)
    if excited is None or period is None:
        return None
    of = "force" if "force" in recording.channels else "command"
    first = len(recording) % period + period
    spectra = {role: _spectra(channel.values, period, first) for role, channel in recording.channels.items()}
    for role in ("position", "handle"):
        if role in spectra:
            spectra[role] = _without_drift(recording.channels[role].values, period, first)
    lines = _excited(_spectra(excited, period, first), sample_time, period)
    if lines.size < LEAST_LINES:
        return None
    omega = np.asarray(2 * np.pi * lines / (period * sample_time), dtype=np.float64)
    pushed = spectra[of]
    mean_lines = spectra["position"].mean(axis=0)
    direction = _direction(mean_lines) / pushed.mean(axis=0)
    speed = float(np.linalg.norm(omega * mean_lines[lines])) * np.sqrt(2) / period

    def over(role: str, below: str) -> Lines | None:
        if role not in spectra:
            return None
        return _lines(
            spectra[role][:, lines], spectra[below][:, lines], omega, _rounding(recording.channels[role], period)
        )

    position = over("position", of)
    assert position is not None
    drive = over("force", "command") if {"force", "command"} <= set(spectra) else None
    return Response(
        period, pushed.shape[0], of, position, over("handle", of), drive, direction[lines], speed, sample_time
    )


def find_period(values: Floats) -> int | None:
    """Return the period of a column in samples; None unless the column repeats at least `LEAST_PERIODS` times."""
    centred = values - values.mean()
    n = centred.size
    size = 1 << (2 * n - 1).bit_length()
    power = float(centred @ centred)
    if power == 0:
        return None
    summed = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)[: n // LEAST_PERIODS + 1]
    overlap = n / (n - np.arange(summed.size))
    correlation = summed * overlap / power
    ahead = np.flatnonzero(correlation < 0.5)  # beyond the peak of the correlation around 0
    if not ahead.size:
        return None
    start = int(ahead[0])
    best = float(correlation[start:].max(initial=0.0))
    if best < REPEATS:
        return None
    good = np.flatnonzero(correlation[start:] > best - 0.02 * (1 - best) - 0.002) + start
    first = int(good[0])
    top = first + int(np.argmax(correlation[first : first + max(2, first // 50)]))
    return top if 2 * LEAST_LINES < top <= n // LEAST_PERIODS else None


def _spectra(values: Floats, period: int, first: int) -> Complex:
    """Return the spectrum of each period, shape (periods, period // 2 + 1)."""
    return np.asarray(np.fft.rfft(values[first:].reshape(-1, period), axis=1))


def _without_drift(values: Floats, period: int, first: int) -> Complex:
    """Return the spectra of a position without its drift. The function uses the second difference, which hardly
    drifts."""
    second = np.zeros(values.size)
    second[1:-1] = values[2:] - 2 * values[1:-1] + values[:-2]
    second[-1] = second[-1 - period] if values.size > period else 0.0
    omega = 2 * np.pi * np.arange(period // 2 + 1) / period
    factor = 2 * np.cos(omega) - 2
    factor[0] = 1.0
    return np.asarray(_spectra(second, period, first) / factor)


def _excited(spectra: Complex, sample_time: float, period: int) -> NDArray[np.int64]:
    """Return the indices of the excited lines: their amplitude is large enough relative to the noise and to the
    greatest line."""
    mean = np.abs(spectra.mean(axis=0))
    noise = spectra.std(axis=0, ddof=1) / np.sqrt(len(spectra))
    numbers = np.arange(mean.size)
    inside = (numbers > 0) & (numbers < HIGHEST_LINE * period)
    return np.flatnonzero(inside & (mean > EXCITED * mean[inside].max()) & (mean > ABOVE_NOISE * noise))


def _direction(position: Complex) -> Complex:
    """Return the lines of the velocity's sign, whose changes may lie between samples."""
    count = position.size
    finer = max(2, min(FINER, MOST_POINTS // count))
    fine = np.zeros((count - 1) * finer + 1, dtype=complex)
    inside = np.arange(count) < HIGHEST_LINE * 2 * (count - 1)
    fine[:count] = 1j * np.arange(count) * position * inside
    sign = np.sign(np.fft.irfft(fine))
    return np.asarray(np.fft.rfft(sign)[:count] / finer)


def _rounding(channel: Channel, period: int) -> float:
    """Return the error of a line due to rounding, in the unit of `_spectra`. The error is equal in each period, so
    averaging does not reduce it."""
    quantum = channel.quantum
    if quantum is None:
        steps = np.abs(np.diff(channel.values))
        quantum = float(steps[steps > 1e-9 * np.ptp(channel.values)].min(initial=np.inf))
    return quantum * np.sqrt(period / 12) if np.isfinite(quantum) else 0.0


def _lines(outputs: Complex, inputs: Complex, omega: Floats, rounding: float) -> Lines:
    """Return the ratio of outputs to inputs at the lines, with its spread over the periods and its coherence."""
    count = len(outputs)
    ratio = outputs.mean(axis=0) / inputs.mean(axis=0)
    deviation = outputs - ratio * inputs
    variance = (np.abs(deviation) ** 2).sum(axis=0) / (count - 1) / count
    spread = np.sqrt(variance + rounding**2) / np.abs(outputs.mean(axis=0))
    cross_power = np.abs((outputs * np.conj(inputs)).sum(axis=0)) ** 2
    coherence = cross_power / ((np.abs(outputs) ** 2).sum(axis=0) * (np.abs(inputs) ** 2).sum(axis=0))
    return Lines(omega, ratio, spread, coherence)
