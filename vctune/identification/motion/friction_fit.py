"""Fit friction for the simulation: Coulomb friction, and Stribeck's curve if the data show it (README, section 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.motion.covariance import robust_covariance
from vctune.identification.motion.motion import MEMORY, SYMMETRIC, FittedSamples, MotionFit, motion_fit
from vctune.identification.motion.signals import Signals
from vctune.identification.motion.spectral_filters import filtered, smooth, spectrum, stride

CLEAR = 4.0  # Required significance of the rise at low speed, in standard deviations
TRIED = 24  # Number of velocities that the fit tries for the curve, from a hundredth to a half of the peak speed
WITHIN = 12  # Greatest rise of Stribeck's curve, as a multiple of the Coulomb friction


@dataclass(frozen=True, slots=True)
class FrictionFound:
    """Friction in the form that the simulation uses."""

    coulomb: float  # friction at high speed, N
    stiction: float | None = None  # friction at vanishing speed, N, and speed of the transition, m/s
    stribeck_velocity: float | None = None


def friction_of(signals: Signals, fit: MotionFit, known: dict[str, float]) -> FrictionFound | None:
    """Return the friction that a motion shows; None if the motion shows no friction."""
    coulomb = fit.value("coulomb")
    if coulomb <= 2 * fit.sigma("coulomb"):
        return None
    delays = known | {name: fit.value(name) for name in ("delay", "sensor_delay") if name in fit.names}
    whole, samples = motion_fit(signals, fit.cutoff_hz, SYMMETRIC, delays, slow=0.0)
    power_of_speed = {speed: _risen(signals, whole, samples, speed)[1].power for speed in _speeds(signals.velocity)}
    sensitivity, best = _risen(signals, whole, samples, min(power_of_speed, key=lambda speed: power_of_speed[speed]))
    sigma = _sigma(samples, sensitivity, best)
    if not (CLEAR * sigma < best.rise < WITHIN * best.coulomb) or best.coulomb <= 0:
        return FrictionFound(coulomb)
    return FrictionFound(best.coulomb, best.coulomb + best.rise, best.speed)


@dataclass(frozen=True, slots=True)
class _Risen:
    """The fit with a rise of the friction towards low speed; `power` is the sum of the squares of its residual."""

    power: float
    rise: float
    coulomb: float
    speed: float
    residual: Floats


def _speeds(v: Floats) -> Sequence[float]:
    top = float(np.abs(v).max())
    return [float(each) for each in np.exp(np.linspace(log(0.01 * top), log(0.5 * top), TRIED))]


def _risen(signals: Signals, fit: MotionFit, samples: FittedSamples, speed: float) -> tuple[Floats, _Risen]:
    """Return the sensitivity to a rise of the friction towards low speed, and the fit with this rise."""
    T, cutoff, v = signals.sample_time, fit.cutoff_hz, signals.velocity
    column = spectrum(np.sign(v) * np.exp(-((v / speed) ** 2)), T)
    rise = filtered(column, lambda w: smooth(w, cutoff), stride(cutoff, T))[samples.rows]
    Z = np.column_stack([samples.sensitivity, rise])
    theta = np.linalg.lstsq(Z, samples.measured, rcond=None)[0]
    residual = samples.measured - Z @ theta
    coulomb = float(theta[fit.names.index("coulomb")])
    return Z, _Risen(float(residual @ residual), float(theta[-1]), coulomb, speed, residual)


def _sigma(samples: FittedSamples, Z: Floats, risen: _Risen) -> float:
    """Return the standard deviation of the rise."""
    reach = round(min(MEMORY / samples.step, 0.1 * len(Z)))
    covariance = robust_covariance(Z * risen.residual[:, None], Z.T @ Z, reach)
    return sqrt(max(float(covariance[-1, -1]), 0.0))
