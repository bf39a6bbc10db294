"""Compute the exact motion of a servo at the instants of a log: delay, low-pass and integration of a held velocity."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats

Complex = NDArray[np.complex128]


def modes(bandwidth_hz: float, order: int) -> tuple[float, complex, complex]:
    """Return the lag, a pole, and a weight."""
    w = 2 * pi * bandwidth_hz
    if order == 1:
        return 1 / w, complex(-w), complex(1 / w)
    pole = w * complex(-1, 1) / sqrt(2)
    return sqrt(2) / w, pole, 2 * w**2 / (pole**2 * 2 * (pole + w / sqrt(2)))


def interpolating_velocity(time: Floats, command: Floats) -> Floats:
    """Return the held velocity with which a position command is reached one sample later."""
    steps = np.diff(time)
    travel = np.diff(command, prepend=command[0])
    velocity = travel / np.append(steps, steps[-1])
    velocity[0] = velocity[1]
    return velocity


def positions(time: Floats, velocity: Floats, delay: float, bandwidth_hz: float, order: int) -> Floats:
    """Return the positions of a servo at the instants of a log. The positions near the start of the log are not
    exact."""
    lag, pole, residue = modes(bandwidth_hz, order)
    steps = np.diff(time)
    path = np.concatenate([[0.0], np.cumsum(velocity[:-1] * steps)])
    left = _decaying(np.diff(velocity, prepend=velocity[0]), np.exp(pole * steps))
    at = time - delay
    row = np.clip(np.searchsorted(time, at, side="right") - 1, 0, time.size - 1)
    since = at - time[row]
    mode = left[row] * np.exp(pole * np.maximum(since, 0.0))
    return np.asarray(path[row] + velocity[row] * (since - lag) + (residue * mode).real)


def _decaying(jumps: Floats, factors: Complex) -> Complex:
    """Return m with m[k] = factors[k - 1] m[k - 1] + jumps[k]. Each pass of the loop doubles the number of summed
    terms."""
    m, through = jumps.astype(complex), np.concatenate([[0.0], factors])
    span = 1
    while span < m.size and np.abs(through).max() > 1e-17:
        m[span:] = m[span:] + through[span:] * m[:-span]
        through = np.concatenate([np.zeros(span), through[span:] * through[:-span]])
        span *= 2
    return m


def sampled_response(omega: Floats, T: float, delay: float, bandwidth_hz: float, order: int) -> Complex:
    """Return the exact response from a held velocity to the velocity between two samples of the position."""
    lag, pole, residue = modes(bandwidth_hz, order)
    whole = np.ceil(delay / T)
    since, w = whole * T - delay, np.exp(-1j * omega * T)
    both = [residue / 2, pole] if order == 2 else [residue, pole]
    pairs = [both, [np.conj(each) for each in both]] if order == 2 else [both]
    left = sum((1 - w) * r * np.exp(p * since) / (1 - np.exp(p * T) * w) for r, p in pairs)
    return np.asarray(w**whole * (T * w + (1 - w) * (since - lag + left)) / T)
