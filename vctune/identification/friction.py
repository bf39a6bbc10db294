"""Friction for the simulation: Coulomb's, and Stribeck's curve where the data show one (README, section 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.covariance import robust_covariance
from vctune.identification.filters import filtered, smooth
from vctune.identification.motion import MEMORY, SYMMETRIC, MotionFit, motion_fit
from vctune.identification.signals import Signals

CLEAR = 4.0
"""How many standard deviations the rise at low speed must have: its velocity is chosen after the data were seen."""
TRIED = 24
"""Velocities of the curve that are tried, from a hundredth of the peak speed to a half."""
WITHIN = 12
"""A rise that is more than so many times Coulomb's friction is none of Stribeck's."""


@dataclass(frozen=True, slots=True)
class FrictionFound:
    """Friction as the simulation has it.

    Attributes
    ----------
    coulomb : at high speed, N
    stiction, stribeck_velocity : at vanishing speed, N, and where one becomes the other, m/s; None where the data do
        not show it
    """

    coulomb: float
    stiction: float | None = None
    stribeck_velocity: float | None = None


def friction_of(signals: Signals, fit: MotionFit, known: dict[str, float]) -> FrictionFound | None:
    """Return the friction that a motion shows; None for none.

    Parameters
    ----------
    signals : of the recording
    fit : of its motion, the same both ways
    known : delays that need not be found
    """
    coulomb = fit.value("coulomb")
    if coulomb <= 2 * fit.sigma("coulomb"):
        return None
    delays = known | {name: fit.value(name) for name in ("delay", "sensor_delay") if name in fit.names}
    whole = motion_fit(signals, fit.cutoff_hz, SYMMETRIC, delays, slow=0.0)
    v = signals.velocity
    rows = np.round(whole.time / signals.sample_time).astype(int)
    best = min(
        (_risen(signals, whole, v, rows, float(speed)) for speed in _speeds(v)),
        key=lambda each: each.power,
        default=None,
    )
    if best is None or not (CLEAR * best.sigma < best.rise < WITHIN * best.coulomb) or best.coulomb <= 0:
        return FrictionFound(coulomb)
    return FrictionFound(best.coulomb, best.coulomb + best.rise, best.speed)


@dataclass(frozen=True, slots=True)
class _Risen:
    power: float
    rise: float
    sigma: float
    coulomb: float
    speed: float


def _speeds(v: Floats) -> Sequence[float]:
    top = float(np.abs(v).max())
    return list(np.exp(np.linspace(log(0.01 * top), log(0.5 * top), TRIED)))


def _risen(signals: Signals, fit: MotionFit, v: Floats, rows: np.ndarray, speed: float) -> _Risen:
    """Fit once more with a rise of the friction towards low speed."""
    T, cutoff = signals.sample_time, fit.cutoff_hz
    rise = filtered(np.sign(v) * np.exp(-((v / speed) ** 2)), lambda w: smooth(w, cutoff), T)[rows]
    Z = np.column_stack([fit.sensitivity, rise])
    theta = np.linalg.lstsq(Z, fit.measured, rcond=None)[0]
    left = fit.measured - Z @ theta
    scores = Z * left[:, None]
    covariance = robust_covariance(scores, Z.T @ Z, round(min(MEMORY / T, 0.1 * len(rows))))
    sigma = sqrt(max(float(covariance[-1, -1]), 0.0))
    return _Risen(float(left @ left), float(theta[-1]), sigma, float(theta[fit.names.index("coulomb")]), speed)
