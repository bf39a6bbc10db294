"""Check the fit of a motion by three other methods (README, section 2)."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.schema.log_schema import ClassicalTable
from vctune.document.text.codes import Code
from vctune.identification.motion.motion import DIRECTIONAL, MEMORY, FittedSamples, MotionFit, regressors_of
from vctune.identification.motion.signals import Signals, acceleration, speed, ways
from vctune.identification.motion.spectral_filters import filtered, smooth, spectrum, stride

RESAMPLINGS = 400  # Number of resamplings
SEED = 1


@dataclass(frozen=True, slots=True)
class Check:
    """An estimate of a parameter by another method."""

    code: Code  # code of the method
    name: str  # name of the parameter and of the method
    value: float  # estimate, SI units
    sigma: float | None  # standard deviation of this estimate; None if the method gives no standard deviation


def bootstrap(fit: MotionFit, samples: FittedSamples) -> Check | None:
    """Return the mass and its deviation from randomly drawn blocks of the log; None if the log has fewer than two
    blocks."""
    length = max(1, round(MEMORY / samples.step))
    count = samples.rows.size // length
    if count < 2:
        return None
    Z, y = samples.sensitivity[: count * length], samples.left[: count * length]
    blocks = Z.reshape(count, length, -1)
    squares = np.einsum("bli,blj->bij", blocks, blocks)
    crossed = np.einsum("bli,bl->bi", blocks, y.reshape(count, length))
    drawn = np.random.default_rng(SEED).integers(0, count, (RESAMPLINGS, count))
    estimates = np.array(
        [np.linalg.lstsq(squares[rows].sum(axis=0), crossed[rows].sum(axis=0), rcond=None)[0][0] for rows in drawn]
    )
    value, sigma = fit.value("mass") + float(estimates.mean()), float(estimates.std(ddof=1))
    return Check("check-blocks", "mass, blocks of the log at random", value, sigma)


def instrumental(signals: Signals, fit: MotionFit, samples: FittedSamples) -> Check | None:
    """Return the mass by instrumental variables, with the reference as instrument; None without a reference."""
    if signals.reference is None:
        return None
    T, cutoff = signals.sample_time, fit.cutoff_hz
    every, low_pass = stride(cutoff, T), lambda omega: smooth(omega, cutoff)
    reference = spectrum(signals.reference - signals.reference.mean(), T)
    a, columns = acceleration(reference, cutoff, every), ways(speed(reference, cutoff))
    reference_columns = regressors_of(a, lambda way: filtered(spectrum(columns[way], T), low_pass, every), DIRECTIONAL)
    instruments, regressors = (
        np.column_stack([column[samples.rows] for column in reference_columns]),
        samples.sensitivity[:, : len(DIRECTIONAL)],
    )
    theta = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ samples.measured, rcond=None)[0]
    return Check("check-instrument", "mass, reference as instrument", float(theta[0]), None)


@dataclass(frozen=True, slots=True)
class Classical:
    """The inverse model by ordinary least squares, with the standard deviations that this method claims."""

    checks: tuple[Check, ...]  # mass, damping, Coulomb friction and offset
    residual_share: float  # norm of the residual divided by the norm of the force


def classical(recording: Recording, sample_time: float, recipe: ClassicalTable) -> Classical | None:
    """Return the classical inverse model: a filter in both directions, central differences, decimation, white
    residuals."""
    from scipy.signal import butter, decimate, filtfilt

    force = recording.values("command") if "command" in recording.channels else recording.values("force")
    if force is None:
        return None
    b, a = butter(4, 2 * recipe.filter_hz * sample_time)
    position = filtfilt(b, a, recording.channels["position"].values)
    v = np.gradient(position, sample_time)
    acceleration = np.gradient(v, sample_time)
    columns: list[Floats] = [acceleration, v, np.sign(v), np.ones(v.size)]
    if recipe.decimate > 1:

        def shorter(values: Floats) -> Floats:
            return np.asarray(decimate(values, recipe.decimate, ftype="fir"))

        columns, force = [shorter(each) for each in columns], shorter(force)
    Z, y = np.column_stack(columns)[EDGE:-EDGE], force[EDGE:-EDGE]
    theta = np.linalg.lstsq(Z, y, rcond=None)[0]
    residual = y - Z @ theta
    variance = float(residual @ residual) / (y.size - theta.size) * np.diag(np.linalg.inv(Z.T @ Z))
    names = ("mass", "damping", "coulomb", "offset")
    checks = tuple(
        Check("check-classical", f"{name}, classical recipe", float(value), sqrt(float(each)))
        for name, value, each in zip(names, theta, variance, strict=True)
    )
    return Classical(checks, float(np.linalg.norm(residual) / np.linalg.norm(y)))


EDGE = 5  # Number of decimated samples at each end that the filters distort; the fit omits them
