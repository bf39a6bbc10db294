"""Any motion: what force is left when mass, viscous and Coulomb friction have had their share (README, section 2).

    F(t - delay) + f_h(t + sensor) = m a + b_+ v_+ + b_- v_- + c_+ [v > 0] - c_- [v < 0]

linear in all but the delays, which are found by Gauss and Newton. Both sides go through the same low-pass, the signs of
the velocity too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.identification.covariance import robust_covariance
from vctune.identification.filters import Complex, drive, edge, filtered, smooth
from vctune.identification.signals import Signals, derivatives
from vctune.model.device import Device

DIRECTIONAL = ("mass", "damping_forwards", "damping_backwards", "coulomb_forwards", "coulomb_backwards")
SYMMETRIC = ("mass", "damping", "coulomb", "offset")
MEMORY = 1.0
"""How long residuals are correlated, s: half and twice change the intervals of the test data by less than a fifth."""
SLOW = 0.05
"""Share of the peak speed below which friction is not Coulomb's and the sign of the velocity is in doubt."""
LEAST_KEPT = 0.3
"""With less than this share of the samples away from turns, turns are kept."""
STEPS = 60
STRIDE = 4.0
"""Most that a delay changes at once, sample times."""
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class MotionFit:
    """A regression.

    Attributes
    ----------
    names : of the numbers, in the order of `values`; the delays last
    values : shape (p,), SI units
    covariance : shape (p, p), of correlated residuals
    cutoff_hz : of the low-pass on both sides
    samples : how many were used, and of the log's samples how many there are
    residual, force : root mean squares, N
    time, measured, fitted : of the samples that were used, s and N
    sensitivity : of the fitted force to each number, shape (samples, p)
    """

    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    cutoff_hz: float
    samples: tuple[int, int]
    residual: float
    force: float
    time: Floats
    measured: Floats
    fitted: Floats
    sensitivity: Floats

    def value(self, name: str) -> float:
        """Return a number by its name."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Return its standard deviation."""
        at = self.names.index(name)
        return sqrt(max(float(self.covariance[at, at]), 0.0))


@dataclass(frozen=True, slots=True)
class _Filtered:
    """Both sides for given delays: force, its slopes by the delays, regressors; and which samples count."""

    force: Floats
    slopes: Floats
    regressors: Floats
    kept: Flags


def motion_fit(
    signals: Signals, cutoff_hz: float, names: Sequence[str], known: Mapping[str, float], slow: float = SLOW
) -> MotionFit:
    """Fit a recording.

    Parameters
    ----------
    signals : Signals
    cutoff_hz : of the low-pass on both sides, at most `HIGHEST` of the sampling rate
    names : `DIRECTIONAL` or `SYMMETRIC`
    known : delays that are not to be found, by "delay" and "sensor_delay", s
    slow : share of the peak speed below which samples are not used

    Returns
    -------
    MotionFit
        Of the numbers in `names` and the delays that are not known.
    """
    delays = _delays(signals, known)
    free = [name for name in delays if name not in known]
    regressors, kept = _regressors(signals, cutoff_hz, names, slow)
    step = signals.sample_time
    for _ in range(STEPS):
        at = _sides(signals, cutoff_hz, delays, free, regressors, kept)
        sensitivity = np.column_stack([at.regressors, -at.slopes])
        solved = np.linalg.lstsq(sensitivity, at.force, rcond=None)[0]
        moved = solved[len(names) :]
        delays = {
            **delays,
            **{
                name: delays[name] + float(np.clip(change, -STRIDE * step, STRIDE * step))
                for name, change in zip(free, moved, strict=True)
            },
        }
        if not free or np.abs(moved).max() < 1e-4 * step:
            break
    at = _sides(signals, cutoff_hz, delays, free, regressors, kept)
    theta = np.linalg.lstsq(at.regressors, at.force, rcond=None)[0]
    residual = at.force - at.regressors @ theta
    sensitivity = np.column_stack([at.regressors, -at.slopes])
    information = sensitivity.T @ sensitivity
    covariance = _covariance(sensitivity, residual, information, kept, cutoff_hz, step)
    time = np.asarray(np.flatnonzero(kept) * step, dtype=np.float64)
    return MotionFit(
        names=(*names, *free),
        values=np.array([*theta, *(delays[name] for name in free)]),
        covariance=covariance,
        cutoff_hz=cutoff_hz,
        samples=(int(kept.sum()), signals.position.size),
        residual=float(np.sqrt(np.mean(residual**2))),
        force=float(np.sqrt(np.mean(at.force**2))),
        time=time,
        measured=at.force,
        fitted=at.regressors @ theta,
        sensitivity=sensitivity,
    )


def _delays(signals: Signals, known: Mapping[str, float]) -> dict[str, float]:
    wanted = {"delay": signals.command, "sensor_delay": signals.hand}
    return {name: known.get(name, 0.0) for name, column in wanted.items() if column is not None}


def _covariance(
    sensitivity: Floats, residual: Floats, information: Floats, kept: Flags, cutoff_hz: float, step: float
) -> Floats:
    """Return the covariance, residuals in their place in time: what was dropped is 0."""
    scores = np.zeros((kept.size, sensitivity.shape[1]))
    scores[kept] = sensitivity * residual[:, None]
    reach = int(min(max(MEMORY, 3 / cutoff_hz) / step, 0.1 * kept.size))
    return robust_covariance(scores, information, reach)


def _sides(
    signals: Signals,
    cutoff_hz: float,
    delays: Mapping[str, float],
    free: Sequence[str],
    regressors: Floats,
    kept: Flags,
) -> _Filtered:
    T = signals.sample_time
    force, slopes = np.zeros(signals.position.size), {}
    if signals.command is not None:
        device = Device(1.0, 0.0, T, 0.0, actuator=signals.actuator)
        late = delays["delay"]

        def driven(omega: Floats) -> Complex:
            through = drive(device, omega) if signals.is_command else 1.0
            return np.asarray(through * np.exp(-1j * omega * late) * smooth(omega, cutoff_hz))

        force = force + filtered(signals.command, driven, T)
        slopes["delay"] = filtered(signals.command, lambda omega: -1j * omega * driven(omega), T)
    if signals.hand is not None:
        early = delays["sensor_delay"]

        def sensed(omega: Floats) -> Complex:
            return np.asarray(np.exp(1j * omega * early) * smooth(omega, cutoff_hz))

        force = force + filtered(signals.hand, sensed, T)
        slopes["sensor_delay"] = filtered(signals.hand, lambda omega: 1j * omega * sensed(omega), T)
    columns = [slopes[name][kept] for name in free]
    return _Filtered(force[kept], np.column_stack(columns) if columns else np.empty((kept.sum(), 0)), regressors, kept)


def _regressors(signals: Signals, cutoff_hz: float, names: Sequence[str], least: float) -> tuple[Floats, Flags]:
    """Return a column for each name, and which samples count: neither at an end nor at a turn."""
    T = signals.sample_time
    a, v = derivatives(signals.position, cutoff_hz, T)[0], signals.velocity
    columns = regressors_of(a, v, names, lambda values: filtered(values, lambda w: smooth(w, cutoff_hz), T))
    kept = np.ones(v.size, dtype=bool)
    margin = edge(cutoff_hz, 4 * T, T)
    kept[:margin] = kept[-margin:] = False
    slow = (np.abs(v) < least * np.abs(v[kept]).max(initial=0.0)).astype(float)
    near = 1 + 2 * int(0.25 / cutoff_hz / T)
    away = kept & (np.convolve(slow, np.ones(near), "same") < 0.5)
    if away.sum() >= LEAST_KEPT * kept.sum():
        kept = away
    return columns[kept], kept


def regressors_of(a: Floats, v: Floats, names: Sequence[str], low_pass: Callable[[Floats], Floats]) -> Floats:
    """Return what each number multiplies, shape (n, p).

    Parameters
    ----------
    a, v : acceleration and velocity, m/s2 and m/s; a is behind the low-pass
    names : `DIRECTIONAL` or `SYMMETRIC`
    low_pass : what the other columns still have to go through
    """
    ahead, back = np.maximum(np.sign(v), 0.0), np.maximum(np.sign(-v), 0.0)
    made: dict[str, Callable[[], Floats]] = {
        "mass": lambda: a,
        "damping": lambda: low_pass(v),
        "damping_forwards": lambda: low_pass(v * ahead),
        "damping_backwards": lambda: low_pass(v * back),
        "coulomb": lambda: low_pass(ahead - back),
        "coulomb_forwards": lambda: low_pass(ahead),
        "coulomb_backwards": lambda: -low_pass(back),
        "offset": lambda: low_pass(np.ones(v.size)),
    }
    return np.column_stack([made[name]() for name in names])
