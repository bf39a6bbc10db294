"""A recording as a regression sees it: columns, derivatives, and what of them is the encoder's noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.identification.filters import HIGHEST, edge, filtered, smooth
from vctune.model.device import Actuator

ATTENUATION = 1e-4
"""Greatest share of the acceleration's power that may be the encoder's noise: it takes as much from the mass."""


@dataclass(frozen=True, slots=True)
class Signals:
    """A recording as the regression sees it.

    Attributes
    ----------
    position : shape (n,), m
    command : the force on the motor, as commanded or as measured, N; None without one that moves
    hand : the hand's force as sensed, N; None without
    reference : position that was asked for, m; None without
    sample_time : s
    is_command : whether the force is a command, held between samples
    actuator : of a held command, where it is known
    noise : standard deviation of a position sample, m
    velocity : behind the highest cut-off that its noise bears, m/s: says which way the device moves
    """

    position: Floats
    command: Floats | None
    hand: Floats | None
    reference: Floats | None
    sample_time: float
    is_command: bool
    actuator: Actuator | None
    noise: float
    velocity: Floats


def derivatives(position: Floats, cutoff_hz: float, sample_time: float) -> tuple[Floats, Floats]:
    """Return acceleration and velocity behind the low-pass, m/s2 and m/s.

    Parameters
    ----------
    position : evenly sampled, m or rad, shape (n,)
    cutoff_hz : of the low-pass, Hz
    sample_time : s
    """
    centred = position - position.mean()
    a = filtered(centred, lambda w: -(w**2) * smooth(w, cutoff_hz), sample_time)
    return a, filtered(centred, lambda w: 1j * w * smooth(w, cutoff_hz), sample_time)


def cutoffs(signals: Signals) -> list[float]:
    """Return cut-offs at which the encoder's noise spoils no acceleration, the highest first, Hz."""
    T, found = signals.sample_time, []
    for halvings in range(7):
        cutoff = HIGHEST / T / 2**halvings
        if edge(cutoff, 0.0, T) * 4 > signals.position.size:
            break
        margin = edge(cutoff, 0.0, T)
        a = derivatives(signals.position, cutoff, T)[0][margin:-margin]
        if acceleration_noise(signals, cutoff) ** 2 < ATTENUATION * float(np.mean(a**2)):
            found.append(cutoff)
    return found


def acceleration_noise(signals: Signals, cutoff_hz: float) -> float:
    """Return the standard deviation of an acceleration behind the low-pass, of the encoder alone, m/s2.

    Parameters
    ----------
    signals : of the recording
    cutoff_hz : of the low-pass, Hz
    """
    omega = np.linspace(0, np.pi / signals.sample_time, 4096)
    return signals.noise * sqrt(float(np.mean((omega**2 * smooth(omega, cutoff_hz)) ** 2)))


def signals_of(recording: Recording, sample_time: float, actuator: Actuator | None) -> Signals:
    """Return what the regression needs of a recording.

    Parameters
    ----------
    recording : Recording
    sample_time : s
    actuator : between command and motor, where it is known
    """
    force, held = recording.values("force"), False
    if force is None:
        force, held = recording.values("command"), True
    if force is not None and np.ptp(force) == 0:
        force = None
    position = recording.channels["position"]
    noise = position_noise(position.values, position.quantum)
    return Signals(
        position=position.values,
        command=force,
        hand=recording.values("hand"),
        reference=recording.values("reference"),
        sample_time=sample_time,
        is_command=held,
        actuator=actuator if held else None,
        noise=noise,
        velocity=_velocity(position.values, noise, sample_time),
    )


def _velocity(position: Floats, noise: float, sample_time: float) -> Floats:
    """Return the velocity behind the highest cut-off at which its noise is a hundredth of it."""
    omega = np.linspace(0, np.pi / sample_time, 4096)
    v, cutoff = position, HIGHEST / sample_time
    for _ in range(7):
        v = derivatives(position, cutoff, sample_time)[1]
        unsure = noise * sqrt(float(np.mean((omega * smooth(omega, cutoff)) ** 2)))
        if unsure < 0.01 * float(np.sqrt(np.mean(v**2))):
            break
        cutoff /= 2
    return v


def position_noise(position: Floats, quantum: float | None) -> float:
    """Return the standard deviation of a position sample: of its rounding, and of what stands above half of Nyquist.

    Parameters
    ----------
    position : m
    quantum : as stated, m; None for the least step between samples
    """
    step = np.abs(np.diff(position))
    least = float(step[step > 0].min(initial=np.inf)) if quantum is None else quantum
    rounding = least / sqrt(12) if np.isfinite(least) else 0.0
    third = np.diff(position, 3)
    spectrum = np.abs(np.fft.rfft(third * np.hanning(third.size))) ** 2
    theta = np.linspace(0, np.pi, spectrum.size)
    top = spectrum[-spectrum.size // 4 :] / (2 * np.sin(theta[-spectrum.size // 4 :] / 2)) ** 6
    white = sqrt(float(np.median(top)) / log(2) / (0.375 * third.size))
    return max(rounding, white) if quantum is not None or white > 0 else rounding
