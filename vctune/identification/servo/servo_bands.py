"""Measure the response of a servo in bands of frequencies (README, section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.servo.servo_fit import ServoFit, ServoLog
from vctune.identification.servo.servo_motion import Complex, positions, sampled_response

PER_OCTAVE = 3  # Number of bands per octave
LOWEST = 3.0  # Lower edge of the lowest band, in units of the log's frequency resolution
# Greatest relative standard deviation of a band's ratio. vctune does not use a band with a greater deviation
CLEAR = 0.02
HANN = 1.5  # Equivalent width of the Hann window in bins


@dataclass(frozen=True, slots=True)
class Bands:
    """The measured response divided by the response of a fit, in bands."""

    hertz: Floats  # centres of the bands, Hz, shape (n,)
    ratio: Complex  # measured response divided by the fitted response
    spread: Floats  # relative standard deviation of the ratio
    fitted: Complex  # response of the fit, from commanded velocity to the velocity between samples
    share: Floats  # square root of the share of the motion's power that lies in the band


def bands(servo_log: ServoLog, fit: ServoFit) -> Bands:
    """Return the bands in which a log shows the response."""
    T = servo_log.sample_time
    fitted_steps = np.diff(
        positions(servo_log.time, servo_log.velocity, fit.delay.value, fit.bandwidth.value, fit.order)[fit.first :]
    )
    measured = np.diff(servo_log.position[fit.first :])
    window = np.hanning(fitted_steps.size)
    M, E = (np.fft.rfft(window * steps) for steps in (fitted_steps, measured - fitted_steps))
    f = np.fft.rfftfreq(fitted_steps.size, T)
    low, high = LOWEST * f[1], 0.5 / T
    edges = low * 2 ** np.arange(0, np.log2(high / low), 1 / PER_OCTAVE)
    band, total = np.digitize(f, np.append(edges, high)), float(np.sum(np.abs(M) ** 2))
    rows = []
    for i in range(1, edges.size + 1):
        inside = band == i
        power, count = float(np.sum(np.abs(M[inside]) ** 2)), max(float(inside.sum()) / HANN, 1.0)
        if power == 0 or inside.sum() < 2:
            continue
        deviation = complex(np.sum(np.conj(M[inside]) * E[inside])) / power
        noise = float(np.sum(np.abs(E[inside] - deviation * M[inside]) ** 2)) / power
        middle = float(np.sum(f[inside] * np.abs(M[inside]) ** 2)) / power
        rows.append((middle, 1 + deviation, sqrt(noise / count), sqrt(power / total)))
    hertz, ratio, spread, share = (np.array(column) for column in zip(*rows, strict=True))
    used = spread < CLEAR
    hertz, ratio, spread, share = hertz[used], ratio[used], spread[used], share[used].astype(float)
    return Bands(hertz, ratio, spread, _response(fit, 2 * pi * hertz, T), share)


def _response(fit: ServoFit, omega: Floats, T: float) -> Complex:
    """Return the response of a fit from commanded velocity to the velocity between samples."""
    return sampled_response(omega, T, max(fit.delay.value, 0.0), fit.bandwidth.value, fit.order)
