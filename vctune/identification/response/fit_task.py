"""Define the fit of a candidate structure to a response: the errors for given parameters, and the search for the least
errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.identification.motion.spectral_filters import drive
from vctune.identification.response.physics import SCALED, Candidate, compliances, device_of, held_compliance
from vctune.identification.response.response import Complex, Lines, Response
from vctune.model.device import Device
from vctune.model.parts import Actuator

Ints = NDArray[np.int64]
FLOOR = (1e-5, 10.0)  # Range of the model-error floor, relative to the response
EVALUATIONS = 100  # Greatest number of evaluations in a search
LOG_RANGE = 5.0  # Greatest change of a positive parameter in one search, as a natural logarithm
OUTLYING = 1.0  # Greatest relative spread of a line that the fit uses


@dataclass(frozen=True, slots=True)
class FitTask:
    """A response and a candidate structure. Together they give the residuals for any parameters."""

    measured: Response  # the measured response, the candidate structure, and the actuator before the motor
    candidate: Candidate
    actuator: Actuator | None
    left_out: Ints | None = None  # lines to skip; None to use all lines
    aliased: Complex | float = 1.0  # ratio of the sampled to the continuous response to the command

    def numbers(self, at: Floats) -> dict[str, float]:
        """Return the parameters of the candidate at a point of the search."""
        by_name = zip(self.candidate.names, at, strict=True)
        return {name: float(np.exp(value)) if name in SCALED else float(value) for name, value in by_name}

    def outputs(self, at: Floats) -> tuple[Device, Complex, Complex]:
        """Return the device at a point of the search, and the responses of its position and its handle, m/N."""
        numbers, measured = self.numbers(at), self.measured
        omega = measured.position.omega
        device = device_of(numbers, measured.sample_time, self.actuator)
        rubbed = numbers["coulomb"] * measured.friction
        motor, handle = compliances(device, omega)
        if measured.input == "force":
            pushed = np.exp(-1j * omega * device.delay) - rubbed
            return device, motor * pushed, handle * pushed
        pushed = drive(device, omega) * self.aliased - rubbed
        return device, motor * pushed, handle * pushed

    def sampled(self, at: Floats) -> FitTask:
        """Return the task with the aliasing computed at a point. The aliasing hardly depends on the parameters."""
        if self.measured.input == "force":
            return self
        device, omega = self.outputs(at)[0], self.measured.position.omega
        continuous = compliances(device, omega)[0] * drive(device, omega)
        with np.errstate(all="ignore"):
            return replace(self, aliased=held_compliance(device, omega) / continuous)

    @property
    def computable(self) -> bool:
        """Whether the aliasing is finite."""
        return bool(np.isfinite(self.aliased).all())

    def errors(self, at: Floats) -> tuple[Complex, Floats, Ints]:
        """Return the relative errors of the used lines, the relative spreads of these lines, and the outputs to which
        they belong."""
        _, motor, handle = self.outputs(at)
        pairs: list[tuple[Complex, Lines]] = [(motor, self.measured.position)]
        if self.measured.handle is not None:
            pairs.append((handle, self.measured.handle))
        used = [lines.spread < OUTLYING for _, lines in pairs]
        if self.left_out is not None:
            used = [mask & ~np.isin(np.arange(mask.size), self.left_out) for mask in used]
        errors = [(model / lines.ratio - 1)[mask] for (model, lines), mask in zip(pairs, used, strict=True)]
        spreads = [lines.spread[mask] for (_, lines), mask in zip(pairs, used, strict=True)]
        owners = [np.full(mask.sum(), i) for i, mask in enumerate(used)]
        return np.concatenate(errors), np.concatenate(spreads), np.concatenate(owners)

    def residuals(self, at: Floats, model_errors: Floats) -> Floats:
        """Return the errors divided by their standard deviations, first all real parts, then all imaginary parts."""
        errors, spread, owners = self.errors(at)
        weighed = errors * sqrt(2) / np.hypot(spread, np.maximum(model_errors, FLOOR[0])[owners])
        return np.concatenate([weighed.real, weighed.imag])


def point(numbers: Mapping[str, float], candidate: Candidate) -> Floats:
    """Return the parameters of a candidate in the form of the search, in which the parameters of `SCALED` are
    logarithms."""
    return np.array([log(numbers[name]) if name in SCALED else numbers[name] for name in candidate.names])


def solved_from(task: FitTask, start: Floats, model_errors: Floats) -> Floats:
    """Return the point with the least weighted squares that the search finds from a start."""
    from scipy.optimize import least_squares

    names, T = task.candidate.names, task.measured.sample_time
    scale = scale_of(start, names, task.measured)
    lower = np.array([-2 * T if name == "delay" else 0.0 for name in names])
    upper = np.full(start.size, np.inf)
    logs = np.array([name in SCALED for name in names])
    lower[logs], upper[logs] = start[logs] - LOG_RANGE, start[logs] + LOG_RANGE
    inside = np.maximum(start, lower + 1e-9 * scale)
    solved = least_squares(
        task.residuals, inside, args=(model_errors,), bounds=(lower, upper), x_scale=scale, max_nfev=EVALUATIONS
    )
    return np.asarray(solved.x)


def scale_of(at: Floats, names: tuple[str, ...], measured: Response) -> Floats:
    """Return the size of a typical change of each parameter, which the search uses as unit."""
    numbers = dict(zip(names, at, strict=True))
    drag = np.exp(numbers["mass"]) * float(measured.position.omega[0])
    pushed = 1 / float(np.median(np.abs(measured.friction)) + 1e-300)
    sizes = {"damping": drag, "handle_damping": drag, "coulomb": pushed, "delay": measured.sample_time}
    return np.array([0.1 if name in SCALED else 0.01 if name == "damping_ratio" else sizes[name] for name in names])
