"""Average the lines of a periodic excitation (README, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Channel, Floats, Recording
from vctune.identification.study import Complex

LEAST_PERIODS, LEAST_LINES = 4, 8
REPEATS = 0.9  # Least correlation of a column with itself one period later
EXCITED, ABOVE_NOISE = 0.05, 5.0  # Least amplitude of a line, over the greatest, and in deviations of its mean
FINER, MOST_POINTS = 32, 1 << 21  # Points per sample for the direction of motion, and in half a period
HIGHEST_LINE = 0.45  # Frequency of the highest line, as a share of the sampling rate


@dataclass(frozen=True, slots=True)
class Response:
    """The lines of a periodic recording."""

    period: int  # length of a period in samples
    periods: int
    input: str  # "force" or "command", by which the outputs are divided
    omega: Floats  # rad/s
    ratio: Complex  # of the position, and of the handle if it is logged, to the input, m/N, shape (outputs, lines)
    spread: Floats  # relative standard deviation of the ratio, real and imaginary part together
    drive: Complex | None  # from command to force
    friction: Complex  # lines of a Coulomb friction of 1 N, divided by those of the input, 1/N
    speed: float  # root mean square speed of the motor, m/s
    sample_time: float


def response(recording: Recording, T: float) -> Response | None:
    """Return the averaged lines of a recording; None if it is not periodic, or has too few lines."""
    has = recording.channels
    excited = recording.values("command" if "command" in has else "force")
    period = None if excited is None else find_period(excited)
    if excited is None or period is None:
        return None

    def spectra_of(values: Floats) -> Complex:
        return np.asarray(np.fft.rfft(values[len(recording) % period + period :].reshape(-1, period), axis=1))

    spectra = {role: spectra_of(has[role].values) for role in ("command", "force") if role in has}
    factor = 2 * np.cos(2 * np.pi * np.arange(period // 2 + 1) / period) - 2
    factor[0] = 1.0
    outputs = [role for role in ("position", "handle") if role in has]
    for role in outputs:  # from the second difference, which hardly drifts
        second = np.pad(np.diff(has[role].values, 2), 1)
        second[-1] = second[-1 - period]
        spectra[role] = spectra_of(second) / factor
    lines, of = _excited(spectra_of(excited), period), "force" if "force" in has else "command"
    if lines.size < LEAST_LINES:
        return None
    means = {role: each.mean(axis=0) for role, each in spectra.items()}
    count, inputs, ratio, spread = len(spectra[of]), spectra[of][:, lines], [], []
    for role in outputs:
        found, mean = spectra[role][:, lines], means[role][lines]
        ratio.append(mean / means[of][lines])
        variance = (np.abs(found - ratio[-1] * inputs) ** 2).sum(axis=0) / (count - 1) / count
        spread.append(np.sqrt(variance + _rounding(has[role], period) ** 2) / np.abs(mean))
    omega = np.asarray(2 * np.pi * lines / (period * T), dtype=np.float64)
    speed = float(np.linalg.norm(omega * means["position"][lines])) * np.sqrt(2) / period
    drive = means["force"][lines] / means["command"][lines] if {"command", "force"} <= set(means) else None
    friction = (_direction(means["position"]) / means[of])[lines]
    return Response(period, count, of, omega, np.array(ratio), np.array(spread), drive, friction, speed, T)


def find_period(values: Floats) -> int | None:
    """Return the period of a column in samples; None unless the column repeats at least `LEAST_PERIODS` times."""
    from scipy.signal import correlate

    centred = values - values.mean()
    n, power = centred.size, float(centred @ centred)
    if power == 0:
        return None
    summed = correlate(centred, centred, method="fft")[n - 1 : n + n // LEAST_PERIODS]
    correlation = summed * (n / (n - np.arange(summed.size))) / power
    ahead = np.flatnonzero(correlation < 0.5)  # beyond the peak of the correlation around 0
    if not ahead.size:
        return None
    start = int(ahead[0])
    best = float(correlation[start:].max(initial=0.0))
    if best < REPEATS:
        return None
    first = int(np.flatnonzero(correlation[start:] > best - 0.02 * (1 - best) - 0.002)[0]) + start
    top = first + int(np.argmax(correlation[first : first + max(2, first // 50)]))
    return top if 2 * LEAST_LINES < top <= n // LEAST_PERIODS else None


def _excited(spectra: Complex, period: int) -> NDArray[np.int64]:
    """Return the indices of the lines that stand out of the noise and beside the greatest."""
    mean, noise = np.abs(spectra.mean(axis=0)), spectra.std(axis=0, ddof=1) / np.sqrt(len(spectra))
    numbers = np.arange(mean.size)
    inside = (numbers > 0) & (numbers < HIGHEST_LINE * period)
    return np.flatnonzero(inside & (mean > EXCITED * mean[inside].max()) & (mean > ABOVE_NOISE * noise))


def _direction(position: Complex) -> Complex:
    """Return the lines of the velocity's sign, whose changes may lie between samples."""
    count = position.size
    finer = max(2, min(FINER, MOST_POINTS // count))
    fine = np.zeros((count - 1) * finer + 1, dtype=complex)
    fine[:count] = 1j * np.arange(count) * position * (np.arange(count) < HIGHEST_LINE * 2 * (count - 1))
    return np.asarray(np.fft.rfft(np.sign(np.fft.irfft(fine)))[:count] / finer)


def _rounding(channel: Channel, period: int) -> float:
    """Return the error of a line due to rounding. It is equal in each period, so averaging does not reduce it."""
    steps = np.abs(np.diff(channel.values))
    quantum = channel.quantum or float(steps[steps > 1e-9 * np.ptp(channel.values)].min(initial=np.inf))
    return quantum * np.sqrt(period / 12) if np.isfinite(quantum) else 0.0
