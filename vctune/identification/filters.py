"""Filters without phase, by their frequency response: the same for every column, so that none leads another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.model.arithmetic import FLOATS
from vctune.model.device import Device
from vctune.model.device_response import device_response

Complex = NDArray[np.complex128]
Response = Callable[[Floats], Any]
"""A frequency response, real or complex, of omega, rad/s."""
HIGHEST = 0.08
"""Greatest cut-off as a share of the sampling rate: what is left at the Nyquist frequency is 1e-6. Twice: 1 %."""
REACH = 1.1
"""Reach of the kernel in units of 1/cut-off: beyond it is less than 1e-14 of its height."""


def smooth(omega: Floats, cutoff_hz: float) -> Floats:
    """Return a Gaussian low-pass whose power is halved at its cut-off.

    Parameters
    ----------
    omega : rad/s
    cutoff_hz : Hz
    """
    return np.exp(-0.5 * log(2) * (omega / (2 * np.pi * cutoff_hz)) ** 2)


def filtered(values: Floats, response: Response, sample_time: float) -> Floats:
    """Return a column behind a filter of any response; its ends, a reach of the kernel long, are not of the log.

    Parameters
    ----------
    values : shape (n,)
    response : of omega, rad/s
    sample_time : s
    """
    n = values.size
    size = 1 << (2 * n - 1).bit_length()
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(size, sample_time), dtype=np.float64)
    return np.fft.irfft(np.fft.rfft(values, size) * response(omega), size)[:n]


def edge(cutoff_hz: float, delay: float, sample_time: float) -> int:
    """Return how many samples at each end of a filtered column are not of the log alone.

    Parameters
    ----------
    cutoff_hz : of the low-pass, Hz
    delay : by which the column is shifted, s
    sample_time : s
    """
    return ceil((REACH / cutoff_hz + abs(delay)) / sample_time) + 1


def drive(device: Device, omega: Floats) -> Complex:
    """Return A H e^(-s delay) of a device, from the held command to the motor's force.

    Parameters
    ----------
    device : its sample time, delay, hold and actuator are used
    omega : rad/s
    """
    rest = replace(device, structure=None, velocity=None, force_sensor=None)
    at = device_response(rest, omega, FLOATS).drive
    return np.asarray(at.re - 1j * omega * at.lag)
