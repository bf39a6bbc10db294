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

START_FLOOR = 0.1  # Model error with which the search starts
ROUNDS = 20  # Greatest number of alternations between fitting the parameters and fitting the model errors
DECISIVE_FACTOR = 2.0  # Factor by which a second mass must reduce chi2
MAX_DAMPING_RATIO = 0.5  # Damping ratio above which a peak does not count as a resonance
REGULARISATION = 1e-12  # Number added to the diagonal of the information matrix, whose diagonal entries are 1
BLOCKS = 8  # Number of blocks of neighbouring lines


@dataclass(frozen=True, slots=True)
class ResponseFit:
    """The fit of a candidate."""

    candidate: Candidate  # fitted structure
    numbers: Mapping[str, float]  # parameters by name, SI units
    names: tuple[str, ...]  # names of the candidate's parameters in the order of `covariance`
    covariance: Floats
    model_errors: Floats  # relative model errors of position and handle with which chi2 per degree of freedom is 1
    chi2: float  # chi2 with the noise alone, per degree of freedom
    lines: int  # number of lines of all outputs
    speed: float  # root mean square speed of the motor, m/s
    device: Device  # device with the fitted parameters
    position: Complex  # responses of the model at the lines, with Coulomb friction, m/N
    handle: Complex | None

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        at = self.names.index(name)
        return sqrt(max(float(self.covariance[at, at]), 0.0))


def fit_response(
    measured: Response, actuator: Actuator | None = None
) -> tuple[ResponseFit, tuple[ResponseFit, ...]] | None:
    """Return the fit of the simplest candidate that explains a response about as well as the best one, and all fits."""
    lags = (False, True) if measured.input == "command" and actuator is None else (False,)
    structures = ((1, False), (2, False), (2, True))
    candidates = [Candidate(masses, lag, damped_handle) for masses, damped_handle in structures for lag in lags]
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
    best_fits = [fit for fit in best if fit is not None]
    rigid, flexible = best_fits[0], best_fits[-1]
    return (flexible if DECISIVE_FACTOR * costs[flexible.candidate] < costs[rigid.candidate] else rigid), tuple(fits)


def _resonates(fit: ResponseFit, measured: Response) -> bool:
    """Return whether the resonance of a fit is pronounced and within the measured band, and the handle lighter than the
    device; True for a rigid fit."""
    if fit.candidate.masses == 1:
        return True
    omega, at = measured.position.omega, 2 * np.pi * fit.numbers["frequency_hz"]
    handle = fit.numbers["handle_mass"] < fit.numbers["mass"]
    return bool(omega[0] < at < omega[-1] and fit.numbers["damping_ratio"] < MAX_DAMPING_RATIO and handle)


def _criterion(measured: Response, fit: ResponseFit, actuator: Actuator | None, model_errors: Floats) -> float:
    """Return chi2 with the best candidate's model error, plus a penalty for each free parameter (Bayes's criterion)."""
    task = FitTask(measured, fit.candidate, actuator)
    at = point(fit.numbers, fit.candidate)
    residuals = task.sampled(at).residuals(at, model_errors)
    return float(residuals @ residuals) + len(fit.names) * log(residuals.size)


def _fitted(measured: Response, candidate: Candidate, actuator: Actuator | None) -> ResponseFit | None:
    """Return the fit of a candidate: its best parameters with the model errors that explain the residual."""
    task = FitTask(measured, candidate, actuator)
    starts = [point(start, candidate) for start in _starts(measured, candidate)]
    if not starts or task.residuals(starts[0], np.zeros(2)).size <= starts[0].size:
        return None
    model_errors = np.full(2, START_FLOOR)
    solutions = [solved_from(task, start, model_errors) for start in starts]
    at = min(solutions, key=lambda solution: float(np.sum(task.residuals(solution, model_errors) ** 2)))
    task = task.sampled(at)
    if not task.computable:
        return None
    nearest = solved_from(task, at, np.zeros(2))
    chi2 = float(np.sum(task.residuals(nearest, np.zeros(2)) ** 2)) / (task.residuals(at, model_errors).size - at.size)
    for _ in range(ROUNDS):
        before, model_errors = model_errors, _model_errors(task, at)
        at = solved_from(task, at, model_errors)
        task = task.sampled(at)
        if not task.computable:
            return None
        if np.allclose(before, model_errors, rtol=1e-3):
            break
    return _result(task, at, model_errors, chi2)


def _model_errors(task: FitTask, at: Floats) -> Floats:
    """Return the model error of each output with which its chi2 equals its share of the degrees of freedom."""
    errors, spread, outputs = task.errors(at)
    model_errors = np.zeros(2)
    for output in range(2):
        of_output = outputs == output
        if not of_output.any():
            continue
        power, noise = 2 * np.abs(errors[of_output]) ** 2, spread[of_output] ** 2
        dof = 2 * of_output.sum() - at.size * of_output.mean()
        low, high = FLOOR
        if float(np.sum(power / (noise + low**2))) <= dof:
            continue
        for _ in range(40):
            middle = sqrt(low * high)
            low, high = (middle, high) if float(np.sum(power / (noise + middle**2))) > dof else (low, middle)
        model_errors[output] = high
    return model_errors


def _starts(measured: Response, candidate: Candidate) -> list[dict[str, float]]:
    """Return the starts of the search."""
    lines = measured.position
    inertia = 1 / np.abs(lines.omega**2 * lines.ratio)
    low_lines = max(3, inertia.size // 10)
    phase = np.unwrap(np.angle(-lines.ratio))
    late = max(0.0, -float(phase @ lines.omega / (lines.omega @ lines.omega)) - measured.sample_time / 2)
    common = {"damping": 0.0, "coulomb": 0.0, "delay": late, "lag": measured.sample_time, "handle_damping": 0.0}
    if candidate.masses == 1:
        return [common | {"mass": float(np.median(inertia))}]
    total_mass = float(np.median(inertia[:low_lines]))
    hertz = lines.omega / (2 * np.pi)
    peaks = [i for i in range(1, inertia.size - 1) if inertia[i] == inertia[max(0, i - 3) : i + 4].min()]
    peaks = sorted(peaks, key=lambda i: inertia[i])[:3]
    lightly_damped = {"mass": total_mass, "damping_ratio": 0.02}
    return [
        common | lightly_damped | {"handle_mass": share * total_mass, "frequency_hz": float(hertz[i])}
        for i in peaks
        for share in (0.1, 0.5)
    ]


def _result(task: FitTask, at: Floats, model_errors: Floats, chi2: float) -> ResponseFit:
    """Return the fit at a point of the search. A parameter without effect on the residuals gets no covariance from
    them."""
    numbers = task.numbers(at)
    device, motor, handle = task.outputs(at)
    to_units = np.array([1 / numbers[name] if name in SCALED else 1.0 for name in task.candidate.names])
    sensitivity = _sensitivity(task, at, model_errors) * to_units
    residuals = task.residuals(at, model_errors)
    free = np.flatnonzero(np.linalg.norm(sensitivity, axis=0) > 0)
    sensitivity = sensitivity[:, free]
    scaled = sensitivity / (norms := np.linalg.norm(sensitivity, axis=0))
    half = residuals.size // 2
    scores = (scaled[:half] * residuals[:half, None]) + (scaled[half:] * residuals[half:, None])
    information = scaled.T @ scaled + REGULARISATION * np.eye(free.size)
    independent = np.linalg.inv(information)
    correlated = robust_covariance(scores, information, round(sqrt(half)))
    sigma = np.zeros(at.size)
    variance = np.maximum(np.diag(correlated), np.diag(independent))
    sigma[free] = np.sqrt(np.maximum(variance, 0.0)) / norms
    sigma = np.maximum(sigma, _jackknife_deviations(task, at, model_errors) / to_units)
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


def _jackknife_deviations(task: FitTask, at: Floats, model_errors: Floats) -> Floats:
    """Return the standard deviations of a point by a jackknife, which omits one block of neighbouring lines at a
    time."""
    blocks = np.array_split(np.arange(task.measured.position.omega.size), BLOCKS)
    estimates = np.array(
        [solved_from(replace(task, left_out=block), at, model_errors) for block in blocks if block.size]
    )
    return np.sqrt((len(estimates) - 1) * np.var(estimates, axis=0))


def _sensitivity(task: FitTask, at: Floats, model_errors: Floats) -> Floats:
    """Return the derivatives of the residuals. A nonnegative parameter near 0 gets a one-sided derivative."""
    steps = 1e-5 * scale_of(at, task.candidate.names, task.measured)
    columns = []
    for i, step in enumerate(steps):
        change = np.zeros(at.size)
        change[i] = step
        up = task.residuals(at + change, model_errors)
        if task.candidate.names[i] in SCALED or at[i] > step or task.candidate.names[i] == "delay":
            columns.append((up - task.residuals(at - change, model_errors)) / (2 * step))
        else:
            columns.append((up - task.residuals(at, model_errors)) / step)
    return np.column_stack(columns)
