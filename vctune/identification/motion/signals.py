"""Prepare a recording for a regression: columns, derivatives, and the noise that the encoder causes in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, log, sqrt
from types import MappingProxyType

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.identification.motion.spectral_filters import (
    HIGHEST,
    Spectrum,
    drive,
    edge,
    filtered,
    smooth,
    spectrum,
    stride,
)
from vctune.model.device import Device
from vctune.model.parts import Actuator

WAYS = ("forwards", "backwards", "ahead", "back", "always")  # Names of the regressors of friction

ATTENUATION = 1e-4  # Greatest permitted share of encoder noise in the power of the acceleration


@dataclass(frozen=True, slots=True)
class Signals:
    """A recording, prepared for the regression."""

    position: Floats  # position, m, shape (n,)
    command: Floats | None  # force on the motor, commanded or measured, N
    hand: Floats | None  # sensed force of the hand, N; None without a column of this force
    sample_time: float  # T, s
    is_command: bool  # whether the force is a command, which is held between samples
    actuator: Actuator | None  # actuator after a held command; None if it is not known
    noise: float  # standard deviation of a position sample, m
    velocity: Floats  # velocity after the low-pass with the highest cut-off that the noise permits, m/s
    spectra: Mapping[str, Spectrum]


def signals(
    position: Floats,
    force: Floats | None,
    sample_time: float,
    noise: float,
    velocity: Floats,
    *,
    hand: Floats | None = None,
    is_command: bool = False,
    actuator: Actuator | None = None,
) -> Signals:
    """Return columns with their spectra as `Signals`."""
    columns = {"position": position - position.mean()} | ways(velocity)
    columns |= {} if hand is None else {"hand": hand}
    spectra = {name: spectrum(values, sample_time) for name, values in columns.items()}
    if force is not None:
        pushed = spectrum(force, sample_time)
        if is_command:
            through = drive(Device(1.0, 0.0, sample_time, 0.0, actuator=actuator), pushed.omega())
            pushed = replace(pushed, lines=pushed.lines * through)
        spectra["command"] = pushed
    return Signals(position, force, hand, sample_time, is_command, actuator, noise, velocity, MappingProxyType(spectra))


def ways(velocity: Floats) -> dict[str, Floats]:
    """Return the regressors of friction: velocity and its sign in each direction, and the constant."""
    ahead, back = np.maximum(np.sign(velocity), 0.0), np.maximum(np.sign(-velocity), 0.0)
    columns = (velocity * ahead, velocity * back, ahead, back, np.ones(velocity.size))
    return dict(zip(WAYS, columns, strict=True))


def acceleration(position: Spectrum, cutoff_hz: float, every: int = 1) -> Floats:
    """Return the acceleration after the low-pass, m/s2."""
    return filtered(position, lambda w: -(w**2) * smooth(w, cutoff_hz), every)


def speed(position: Spectrum, cutoff_hz: float) -> Floats:
    """Return the velocity after the low-pass, m/s."""
    return filtered(position, lambda w: 1j * w * smooth(w, cutoff_hz))


def cutoffs(signals: Signals) -> list[float]:
    """Return the cut-offs, Hz, at which the share of the encoder's noise in the acceleration is at most
    `ATTENUATION`."""
    T, usable = signals.sample_time, []
    for halvings in range(7):
        cutoff = HIGHEST / T / 2**halvings
        if edge(cutoff, 0.0, T) * 4 > signals.position.size:
            break
        every = stride(cutoff, T)
        margin = ceil(edge(cutoff, 0.0, T) / every)
        a = acceleration(signals.spectra["position"], cutoff, every)[margin:-margin]
        if acceleration_noise(signals, cutoff) ** 2 < ATTENUATION * float(np.mean(a**2)):
            usable.append(cutoff)
    return usable


def acceleration_noise(signals: Signals, cutoff_hz: float) -> float:
    """Return the standard deviation that the encoder alone causes in the acceleration after the low-pass, m/s2."""
    omega = np.linspace(0, np.pi / signals.sample_time, 4096)
    return signals.noise * sqrt(float(np.mean((omega**2 * smooth(omega, cutoff_hz)) ** 2)))


def signals_of(recording: Recording, sample_time: float, actuator: Actuator | None) -> Signals:
    """Return the columns of a recording that the regression needs."""
    # from the command, the delay includes everything up to the motion; a measured force may come much later
    force, held = recording.values("command"), True
    if force is None:
        force, held = recording.values("force"), False
    if force is not None and np.ptp(force) == 0:
        force = None
    position = recording.channels["position"]
    noise = position_noise(position.values, position.quantum)
    centred = spectrum(position.values - position.values.mean(), sample_time)
    return signals(
        position.values,
        force,
        sample_time,
        noise,
        _velocity(centred, noise),
        hand=recording.values("hand"),
        is_command=held,
        actuator=actuator if held else None,
    )


def _velocity(position: Spectrum, noise: float) -> Floats:
    """Return the velocity after a low-pass with the highest cut-off at which the noise is at most 1 % of the signal."""
    omega = np.linspace(0, np.pi / position.sample_time, 4096)
    cutoff = HIGHEST / position.sample_time
    for _ in range(7):
        v = speed(position, cutoff)
        unsure = noise * sqrt(float(np.mean((omega * smooth(omega, cutoff)) ** 2)))
        if unsure < 0.01 * float(np.sqrt(np.mean(v**2))):
            break
        cutoff /= 2
    return v


def position_noise(position: Floats, quantum: float | None) -> float:
    """Return the standard deviation of a position sample: the larger of its rounding and of the noise above three
    quarters of the Nyquist frequency."""
    step = np.abs(np.diff(position))
    least = float(step[step > 0].min(initial=np.inf)) if quantum is None else quantum
    rounding = least / sqrt(12) if np.isfinite(least) else 0.0
    third = np.diff(position, 3)
    spectrum = np.abs(np.fft.rfft(third * np.hanning(third.size))) ** 2
    theta = np.linspace(0, np.pi, spectrum.size)
    top = spectrum[-spectrum.size // 4 :] / (2 * np.sin(theta[-spectrum.size // 4 :] / 2)) ** 6
    white = sqrt(float(np.median(top)) / log(2) / (0.375 * third.size))
    return max(rounding, white) if quantum is not None or white > 0 else rounding
