"""Measure the response of a servo in bands of frequencies (README, section 9)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.servo.servo_fit import ServoFit, ServoLog
from vctune.identification.servo.servo_motion import Complex, positions, sampled_response

PER_OCTAVE = 3
"""Number of bands per octave."""
LOWEST = 3.0
"""Lowest frequency of a band, in units of the log's frequency resolution."""
CLEAR = 0.02
"""Greatest relative standard deviation of a band that vctune uses."""
HANN = 1.5
"""Width of the window in bins."""


@dataclass(frozen=True, slots=True)
class Bands:
    """The measured response divided by the response of a fit, in bands.

    Attributes
    ----------
    hertz : centres of the bands, Hz, shape (n,)
    ratio : measured response divided by the fitted response
    spread : relative standard deviation of the ratio
    fitted : response of the fit, from commanded velocity to the velocity between samples
    share : share of the motion's power in the band, root mean square
    """

    hertz: Floats
    ratio: Complex
    spread: Floats
    fitted: Complex
    share: Floats


def bands(seen: ServoLog, fit: ServoFit) -> Bands:
    """Return the bands in which a log shows the response.

    Parameters
    ----------
    seen : the fitted log
    fit : the servo that explains the log best
    """
    T = seen.sample_time
    made = np.diff(positions(seen.time, seen.velocity, fit.delay.value, fit.bandwidth.value, fit.order)[fit.first :])
    measured = np.diff(seen.position[fit.first :])
    window = np.hanning(made.size)
    M, E = (np.fft.rfft(window * each) for each in (made, measured - made))
    f = np.fft.rfftfreq(made.size, T)
    low, high = LOWEST * f[1], 0.5 / T
    edges = low * 2 ** np.arange(0, np.log2(high / low), 1 / PER_OCTAVE)
    place, total = np.digitize(f, np.append(edges, high)), float(np.sum(np.abs(M) ** 2))
    found = []
    for i in range(1, edges.size + 1):
        inside = place == i
        power, count = float(np.sum(np.abs(M[inside]) ** 2)), max(float(inside.sum()) / HANN, 1.0)
        if power == 0 or inside.sum() < 2:
            continue
        off = complex(np.sum(np.conj(M[inside]) * E[inside])) / power
        noise = float(np.sum(np.abs(E[inside] - off * M[inside]) ** 2)) / power
        middle = float(np.sum(f[inside] * np.abs(M[inside]) ** 2)) / power
        found.append((middle, 1 + off, sqrt(noise / count), sqrt(power / total)))
    hertz, ratio, spread, share = (np.array(each) for each in zip(*found, strict=True))
    used = spread < CLEAR
    hertz, ratio, spread, share = hertz[used], ratio[used], spread[used], share[used].astype(float)
    return Bands(hertz, ratio, spread, _response(fit, 2 * pi * hertz, T), share)


def _response(fit: ServoFit, omega: Floats, T: float) -> Complex:
    return sampled_response(omega, T, max(fit.delay.value, 0.0), fit.bandwidth.value, fit.order)
