"""Propose a multisine that would reduce the uncertainty of the parameters: lines, duration, amplitude (README, section
5)."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log2, pi

import numpy as np

from vctune.document.recording import Floats
from vctune.document.text.codes import coded
from vctune.identification.identify import Identified
from vctune.identification.motion.signals import position_noise
from vctune.identification.response.physics import antiresonance_hz, compliances

LINES = 60  # Number of lines, spaced evenly on a logarithmic axis
NEAR = 24  # Number of additional lines within 10 % of a resonance, and also within 10 % of an antiresonance
HIGHEST = 0.2  # Frequency of the highest line, as a share of the sampling rate
LONGEST = 8.0  # Longest period, s
PEAK = 1.0  # Greatest force, as a share of the logs' greatest force
SPREAD = 0.005  # Target for the relative standard deviation of a line
PERIODS = (5, 60)  # Least and greatest number of periods that vctune proposes


@dataclass(frozen=True, slots=True)
class Excitation:
    """One period of a force that the user commands repeatedly."""

    force: Floats  # force, N, shape (n,)
    sample_time: float  # T, s
    lines_hz: Floats  # excited frequencies, Hz
    periods: int  # number of periods to record; the evaluation omits the first one
    peak: float  # greatest force, N, and predicted root mean square speed, m/s
    speed: float
    spread: float  # predicted relative standard deviation of the worst line
    reasons: tuple[str, ...]  # the parameters that the multisine would determine better


def excitation(identified: Identified) -> Excitation:
    """Return a multisine for an identified device."""
    device, T = identified.device, float(identified.device.sample_time)
    low = min(max(float(device.damping / device.mass) / (2 * pi), 8 / LONGEST), 0.1 * HIGHEST / T)
    period = 2 ** ceil(log2(min(LONGEST, 8 / low) / T))
    lines = _lines(identified, low, period, T)
    hertz = lines / (period * T)
    motor = np.abs(compliances(device, 2 * pi * hertz)[0])
    force = _wave(lines, period)
    scale = _scale(identified, force, motor, hertz)
    noise = _noise(identified) * np.sqrt(2 / period) / (motor * scale)
    worst = float(noise.max())
    periods = int(np.clip(ceil((worst / SPREAD) ** 2) + 1, *PERIODS))
    return Excitation(
        force=force * scale,
        sample_time=T,
        lines_hz=hertz,
        periods=periods,
        peak=float(np.abs(force).max() * scale),
        speed=float(np.linalg.norm(2 * pi * hertz * motor * scale) / np.sqrt(2)),
        spread=worst / np.sqrt(periods - 1),
        reasons=_reasons(identified),
    )


def _lines(identified: Identified, low: float, period: int, T: float) -> Floats:
    """Return the indices of the excited lines. More lines lie near resonance and antiresonance."""
    resolution = 1 / (period * T)
    spread = np.exp(np.linspace(np.log(low), np.log(HIGHEST / T), LINES))
    places = [spread]
    structure = identified.device.structure
    if structure is not None:
        for hertz in (structure.frequency_hz, antiresonance_hz(identified.device)):
            places.append(np.linspace(0.9 * float(hertz or 0.0), 1.1 * float(hertz or 0.0), NEAR))
    lines = np.unique(np.round(np.concatenate(places) / resolution))
    return lines[(lines >= 1) & (lines * resolution <= HIGHEST / T)]


def _wave(lines: Floats, period: int) -> Floats:
    """Return a period of lines with amplitude 1 and Schroeder's phases, which keep the peak low."""
    phases = -2 * pi * np.cumsum(np.arange(1, lines.size + 1) / lines.size * np.diff(lines, prepend=0.0))
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[lines.astype(int)] = np.exp(1j * phases) * period / 2
    return np.fft.irfft(spectrum)


def _scale(identified: Identified, force: Floats, motor: Floats, hertz: Floats) -> float:
    """Return the amplitude of the wave's lines, N. The wave exceeds neither the greatest force nor the greatest speed
    of the logs."""
    forces, speeds = [], []
    for study in identified.records:
        recording = study.recording
        columns = [recording.values(role) for role in ("command", "force", "hand")]
        forces.append(max(float(np.abs(column).max()) for column in columns if column is not None))
        position = recording.channels["position"].values
        step = max(1, position.size // 1000)
        speeds.append(float(np.abs(position[step:] - position[:-step]).max()) / (step * study.sample_time))
    speed = float(np.linalg.norm(2 * pi * hertz * motor)) * np.sqrt(2)  # peak: twice the root mean square
    return min(PEAK * max(forces) / float(np.abs(force).max()), max(speeds) / speed)


def _noise(identified: Identified) -> float:
    """Return the standard deviation of a position sample in the noisiest recording, m."""
    return max(
        position_noise(study.recording.channels["position"].values, study.recording.channels["position"].quantum)
        for study in identified.records
    )


def _reasons(identified: Identified) -> tuple[str, ...]:
    """Return the parameters that the multisine would determine better, each with its half-width."""
    reasons = [
        f"{bounded.key}: within {bounded.share:.0%}, by {bounded.limit}"
        for bounded in identified.bounds
        if bounded.share > 0.05
    ]
    if not identified.unmodelled:
        reasons.append(coded("resonances and unmodelled dynamics: the logs do not show them", "remark-slow-motion"))
    return tuple(reasons)
