"""Fit physics to a response by weighted least squares with a model-error floor; chi2 decides the order (README, section
3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.motion.covariance import robust_covariance
from vctune.identification.response.fit_task import FLOOR, FitTask, point, scale_of, solved_from
from vctune.identification.response.physics import SCALED, Candidate
from vctune.identification.response.response import Complex, Response
from vctune.model.device import Device
from vctune.model.parts import Actuator

START_FLOOR = 0.1
"""Model error with which the search starts. Half or twice this error leads to the same fits."""
ROUNDS = 20
CLEARER = 2.0
"""Factor by which a second mass must reduce chi2. Model errors of neighbouring lines are similar, and friction bends a
response slightly everywhere. A resonance reduces chi2 by a factor of a hundred."""
DAMPED = 0.5
"""Damping ratio above which a peak does not count as a resonance."""
UNKNOWN = 1e-12
"""Number added to the diagonal of the information, whose entries are 1. A number that no line determines then gets a
huge deviation."""
BLOCKS = 8
"""Number of blocks of neighbouring lines. The code omits one block at a time, so that the intervals allow for model
errors that extend over many lines."""


@dataclass(frozen=True, slots=True)
class ResponseFit:
    """The fit of a candidate.

    Attributes
    ----------
    candidate : fitted structure
    numbers : numbers by name, SI units
    names : names of the free numbers in the order of `covariance`
    covariance : diagonal matrix, shape (p, p), with the larger of the variances from correlated and from independent
        residuals
    model_errors : relative model errors of position and handle with which chi2 per degree of freedom is 1; 0 where
        noise alone explains the residual
    chi2 : chi2 with the noise alone, per degree of freedom
    lines : number of lines of all outputs
    speed : root mean square speed of the motor, m/s
    device : device with the fitted numbers
    position, handle : responses of the model at the lines, m/N
    """

    candidate: Candidate
    numbers: Mapping[str, float]
    names: tuple[str, ...]
    covariance: Floats
    model_errors: Floats
    chi2: float
    lines: int
    speed: float
    device: Device
    position: Complex
    handle: Complex | None

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a number."""
        at = self.names.index(name)
        return sqrt(max(float(self.covariance[at, at]), 0.0))


def fit_response(
    measured: Response, actuator: Actuator | None = None
) -> tuple[ResponseFit, tuple[ResponseFit, ...]] | None:
    """Return the simplest candidate that explains a response as well as the best one does, and all candidates.

    Return None if there are too few lines.

    Parameters
    ----------
    measured : averaged response of a periodic recording
    actuator : actuator between command and motor; None if it is not known
    """
    lags = (False, True) if measured.input == "command" and actuator is None else (False,)
    shapes = ((1, False), (2, False), (2, True))
    candidates = [Candidate(masses, lag, load) for masses, load in shapes for lag in lags]
    fits = [fit for candidate in candidates if (fit := _fitted(measured, candidate, actuator)) is not None]
    fits = [fit for fit in fits if _resonates(fit, measured)]
    if not fits:
        return None
    reference = np.min([fit.model_errors for fit in fits], axis=0)
    costs = {fit.candidate: _criterion(measured, fit, actuator, reference) for fit in fits}
    best = [
        min((fit for fit in fits if fit.candidate.masses == masses), key=lambda fit: costs[fit.candidate], default=None)
        for masses in (1, 2)
    ]
    found = [fit for fit in best if fit is not None]
    rigid, flexible = found[0], found[-1]
    return (flexible if CLEARER * costs[flexible.candidate] < costs[rigid.candidate] else rigid), tuple(fits)


def _resonates(fit: ResponseFit, measured: Response) -> bool:
    """Return whether the resonance of a fit is pronounced and within the measured band; False for a rigid fit."""
    if fit.candidate.masses == 1:
        return True
    omega, at = measured.position.omega, 2 * np.pi * fit.numbers["frequency_hz"]
    handle = fit.numbers["handle_mass"] < fit.numbers["mass"]
    return bool(omega[0] < at < omega[-1] and fit.numbers["damping_ratio"] < DAMPED and handle)


def _criterion(measured: Response, fit: ResponseFit, actuator: Actuator | None, model_errors: Floats) -> float:
    """Return chi2 with the best candidate's model error, plus a penalty for each free number (Bayes's criterion)."""
    task = FitTask(measured, fit.candidate, actuator)
    at = point(fit.numbers, fit.candidate)
    residuals = task.sampled(at).residuals(at, model_errors)
    return float(residuals @ residuals) + len(fit.names) * log(residuals.size)


def _fitted(measured: Response, candidate: Candidate, actuator: Actuator | None) -> ResponseFit | None:
    task = FitTask(measured, candidate, actuator)
    starts = [point(start, candidate) for start in _starts(measured, candidate)]
    if not starts or task.residuals(starts[0], np.zeros(2)).size <= starts[0].size:
        return None
    model_errors = np.full(2, START_FLOOR)
    found = [solved_from(task, start, model_errors) for start in starts]
    at = min(found, key=lambda each: float(np.sum(task.residuals(each, model_errors) ** 2)))
    task = task.sampled(at)
    nearest = solved_from(task, at, np.zeros(2))
    chi2 = float(np.sum(task.residuals(nearest, np.zeros(2)) ** 2)) / (task.residuals(at, model_errors).size - at.size)
    for _ in range(ROUNDS):
        before, model_errors = model_errors, _floors(task, at)
        at = solved_from(task, at, model_errors)
        task = task.sampled(at)
        if np.allclose(before, model_errors, rtol=1e-3):
            break
    return _result(task, at, model_errors, chi2)


def _floors(task: FitTask, at: Floats) -> Floats:
    """Return the model error of each output with which its chi2 equals its share of the degrees of freedom."""
    errors, spread, owners = task.errors(at)
    model_errors = np.zeros(2)
    for owner in range(2):
        mine = owners == owner
        if not mine.any():
            continue
        power, noise = 2 * np.abs(errors[mine]) ** 2, spread[mine] ** 2
        dof = 2 * mine.sum() - at.size * mine.mean()
        low, high = FLOOR
        if float(np.sum(power / (noise + low**2))) <= dof:
            continue
        for _ in range(40):
            middle = sqrt(low * high)
            low, high = (middle, high) if float(np.sum(power / (noise + middle**2))) > dof else (low, middle)
        model_errors[owner] = high
    return model_errors


def _starts(measured: Response, candidate: Candidate) -> list[dict[str, float]]:
    """Return the starts of the search: the mass from the lowest lines, the spring at each peak of |omega^2 G|."""
    lines = measured.position
    inertia = 1 / np.abs(lines.omega**2 * lines.ratio)
    few = max(3, inertia.size // 10)
    rest = {"damping": 0.0, "coulomb": 0.0, "delay": 0.0, "lag": measured.sample_time, "handle_damping": 0.0}
    if candidate.masses == 1:
        return [rest | {"mass": float(np.median(inertia))}]
    whole = float(np.median(inertia[:few]))
    hertz = lines.omega / (2 * np.pi)
    peaks = [i for i in range(1, inertia.size - 1) if inertia[i] == inertia[max(0, i - 3) : i + 4].min()]
    peaks = sorted(peaks, key=lambda i: inertia[i])[:3]
    light = {"mass": whole, "damping_ratio": 0.02}
    return [
        rest | light | {"handle_mass": share * whole, "frequency_hz": float(hertz[i])}
        for i in peaks
        for share in (0.1, 0.5)
    ]


def _result(task: FitTask, at: Floats, model_errors: Floats, chi2: float) -> ResponseFit:
    numbers = task.numbers(at)
    device, motor, handle = task.outputs(at)
    natural = np.array([1 / numbers[name] if name in SCALED else 1.0 for name in task.candidate.names])
    sensitivity = _sensitivity(task, at, model_errors) * natural
    residuals = task.residuals(at, model_errors)
    free = np.flatnonzero(np.linalg.norm(sensitivity, axis=0) > 0)
    sensitivity = sensitivity[:, free]
    scaled = sensitivity / (norms := np.linalg.norm(sensitivity, axis=0))
    half = residuals.size // 2
    scores = (scaled[:half] * residuals[:half, None]) + (scaled[half:] * residuals[half:, None])
    information = scaled.T @ scaled + UNKNOWN * np.eye(free.size)
    independent = np.linalg.inv(information)
    correlated = robust_covariance(scores, information, round(sqrt(half)))
    sigma = np.zeros(at.size)
    variance = np.maximum(np.diag(correlated), np.diag(independent))
    sigma[free] = np.sqrt(np.maximum(variance, 0.0)) / norms
    sigma = np.maximum(sigma, _deleted(task, at, model_errors) / natural)
    return ResponseFit(
        task.candidate,
        numbers,
        task.candidate.names,
        np.diag(sigma**2),
        model_errors,
        chi2,
        half,
        task.measured.speed,
        device,
        motor,
        handle if task.measured.handle is not None else None,
    )


def _deleted(task: FitTask, at: Floats, model_errors: Floats) -> Floats:
    """Return the standard deviations of the point. The function omits one block of neighbouring lines at a time."""
    blocks = np.array_split(np.arange(task.measured.position.omega.size), BLOCKS)
    left = np.array([solved_from(replace(task, left_out=block), at, model_errors) for block in blocks if block.size])
    return np.sqrt((len(left) - 1) * np.var(left, axis=0))


def _sensitivity(task: FitTask, at: Floats, model_errors: Floats) -> Floats:
    steps = 1e-5 * scale_of(at, task.candidate.names, task.measured)
    columns = []
    for i, step in enumerate(steps):
        moved = np.zeros(at.size)
        moved[i] = step
        up = task.residuals(at + moved, model_errors)
        if task.candidate.names[i] in SCALED or at[i] > step or task.candidate.names[i] == "delay":
            columns.append((up - task.residuals(at - moved, model_errors)) / (2 * step))
        else:
            columns.append((up - task.residuals(at, model_errors)) / step)
    return np.column_stack(columns)
