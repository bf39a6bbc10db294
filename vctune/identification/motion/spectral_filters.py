"""Filter columns in the frequency domain without phase."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.model.device import Device
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS

Complex = NDArray[np.complex128]
Response = Callable[[Floats], Any]  # A frequency response, real or complex, as a function of omega, rad/s
HIGHEST = 0.08  # Greatest cut-off as a share of the sampling rate
REACH = 1.1  # Reach of the low-pass's kernel in time, in units of 1/cut-off
LONGEST = 64  # Greatest permitted stride
BEHIND = 1 << 16  # Number of zeros after a long column


@dataclass(frozen=True, slots=True)
class Spectrum:
    """The spectrum of a column that is followed by zeros."""

    lines: Complex  # complex spectrum, shape (size // 2 + 1,)
    samples: int  # number of samples of the column without the zeros and with the zeros
    size: int
    sample_time: float  # T, s

    def omega(self, every: int = 1) -> Floats:
        """Return the frequencies up to the Nyquist frequency of every `every`-th sample, rad/s."""
        numbers = np.arange(self.size // (2 * every) + 1, dtype=np.float64)
        return numbers * (2 * np.pi / (self.size * self.sample_time))


def spectrum(values: Floats, sample_time: float) -> Spectrum:
    """Return the spectrum of a column, for any number of filters."""
    from scipy.fft import next_fast_len

    needed = values.size + min(values.size, BEHIND)
    size = LONGEST * next_fast_len(ceil(needed / LONGEST), real=True)
    return Spectrum(np.fft.rfft(values, size), values.size, size, sample_time)


def smooth(omega: Floats, cutoff_hz: float) -> Floats:
    """Return a Gaussian low-pass whose power is halved at its cut-off."""
    return np.exp(-0.5 * log(2) * (omega / (2 * np.pi * cutoff_hz)) ** 2)


def stride(cutoff_hz: float, sample_time: float) -> int:
    """Return the stride n after a low-pass. Every n-th sample suffices, with an aliasing of 1e-6."""
    every = 1
    while every < LONGEST and 2 * every * cutoff_hz * sample_time <= HIGHEST * (1 + 1e-9):
        every *= 2
    return every


def filtered(column: Spectrum, response: Response, every: int = 1) -> Floats:
    """Return a column after a filter. Within the kernel's reach of its ends, the column depends on the zeros outside
    the log."""
    omega = column.omega(every)
    values = np.fft.irfft(column.lines[: omega.size] * response(omega), column.size // every)
    return np.asarray(values[: ceil(column.samples / every)] / every)


def edge(cutoff_hz: float, delay: float, sample_time: float) -> int:
    """Return the number of samples at each end of a filtered column that depend on the zeros outside the log."""
    return ceil((REACH / cutoff_hz + abs(delay)) / sample_time) + 1


def drive(device: Device, omega: Floats) -> Complex:
    """Return A H e^(-s delay) of a device, the response of the motor's force to the held command."""
    at = device_response(device, omega, FLOATS).drive
    return np.asarray(at.re - 1j * omega * at.lag)
