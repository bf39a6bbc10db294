"""Average the lines of a periodic excitation, and fit to them the device that explains them (README, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from math import hypot, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Channel, Floats, Recording
from vctune.document.records.identification_json import CandidateRecord, Estimate, NumberRecord
from vctune.document.schema.rules import FASTEST
from vctune.document.text.codes import Note
from vctune.identification.box import COULOMB_SHARE, box, jackknife
from vctune.identification.physics import compliances, drive, held_compliance
from vctune.identification.study import Complex, Lines, Study, number, record_of
from vctune.model.device import Device
from vctune.model.hands import LeastOperator
from vctune.model.loop.device_response import mechanism
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure

LEAST_PERIODS, LEAST_LINES = 4, 8
REPEATS = 0.9  # Least correlation of a column with itself one period later
EXCITED, ABOVE_NOISE = 0.05, 5.0  # Least amplitude of a line, over the greatest, and in deviations of its mean
FINER, MOST_POINTS = 32, 1 << 21  # Points per sample for the direction of motion, and in half a period
HIGHEST_LINE = 0.45  # Frequency of the highest line, as a share of the sampling rate
RIGID = ("mass", "damping", "coulomb", "delay")
SPRING = ("handle_mass", "frequency_hz", "damping_ratio")
SCALED = ("mass", "handle_mass", "frequency_hz", "lag")  # Positive parameters, of which the search moves logarithms
FLOOR, START_FLOOR = (1e-5, 10.0), 0.1  # Range of the relative model error, and the one of the first search
EVALUATIONS, ROUNDS = 100, 20  # of a search; of parameters and model errors in turn
LOG_RANGE = 5.0  # Greatest change of a positive parameter in one search, as a logarithm
OUTLYING = 1.0  # Greatest relative spread of a line that the fit uses
DECISIVE_FACTOR = 2.0  # Factor by which a second mass must reduce the criterion
MAX_DAMPING_RATIO = 0.5  # Damping ratio above which a peak is no resonance
BLOCKS = 8  # Number of blocks of neighbouring lines that the jackknife leaves out
UNSEEN = 1e-4  # Relative change of a response for twice the lag below which there is none
SIGNIFICANT = 3.0  # Least significance, in standard deviations, of a lag that the file states


@dataclass(frozen=True, slots=True)
class Ratio:
    """A response at the excited lines."""

    omega: Floats  # rad/s
    ratio: Complex  # output over input, averaged over periods
    spread: Floats  # its relative standard deviation, real and imaginary part together


@dataclass(frozen=True, slots=True)
class Response:
    """The lines of a periodic recording."""

    period: int  # length of a period in samples
    periods: int
    input: str  # "force" or "command", by which position and handle are divided
    position: Ratio  # m/N
    handle: Ratio | None
    drive: Ratio | None  # from command to force
    friction: Complex  # lines of a Coulomb friction of 1 N, divided by those of the input, 1/N
    speed: float  # root mean square speed of the motor, m/s
    sample_time: float


def response(recording: Recording, T: float) -> Response | None:
    """Return the averaged lines of a recording; None if it is not periodic, or has too few lines."""
    excited = recording.values("command")
    excited = recording.values("force") if excited is None else excited
    period = None if excited is None else find_period(excited)
    if excited is None or period is None:
        return None
    of = "force" if "force" in recording.channels else "command"
    first = len(recording) % period + period
    spectra = {role: _spectra(channel.values, period, first) for role, channel in recording.channels.items()}
    for role in {"position", "handle"} & set(spectra):
        spectra[role] = _without_drift(recording.channels[role].values, period, first)
    lines = _excited(_spectra(excited, period, first), period)
    if lines.size < LEAST_LINES:
        return None
    omega = np.asarray(2 * np.pi * lines / (period * T), dtype=np.float64)
    mean = spectra["position"].mean(axis=0)
    direction = _direction(mean) / spectra[of].mean(axis=0)

    def over(role: str, below: str) -> Ratio:
        rounding = _rounding(recording.channels[role], period)
        outputs, inputs = spectra[role][:, lines], spectra[below][:, lines]
        ratio, count = outputs.mean(axis=0) / inputs.mean(axis=0), len(outputs)
        variance = (np.abs(outputs - ratio * inputs) ** 2).sum(axis=0) / (count - 1) / count
        return Ratio(omega, ratio, np.sqrt(variance + rounding**2) / np.abs(outputs.mean(axis=0)))

    return Response(
        period,
        len(spectra[of]),
        of,
        over("position", of),
        over("handle", of) if "handle" in spectra else None,
        over("force", "command") if {"force", "command"} <= set(spectra) else None,
        direction[lines],
        float(np.linalg.norm(omega * mean[lines])) * np.sqrt(2) / period,
        T,
    )


def find_period(values: Floats) -> int | None:
    """Return the period of a column in samples; None unless the column repeats at least `LEAST_PERIODS` times."""
    centred = values - values.mean()
    n, power = centred.size, float(centred @ centred)
    if power == 0:
        return None
    size = 1 << (2 * n - 1).bit_length()
    summed = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)[: n // LEAST_PERIODS + 1]
    correlation = summed * (n / (n - np.arange(summed.size))) / power
    ahead = np.flatnonzero(correlation < 0.5)  # beyond the peak of the correlation around 0
    if not ahead.size:
        return None
    start = int(ahead[0])
    best = float(correlation[start:].max(initial=0.0))
    if best < REPEATS:
        return None
    first = int(np.flatnonzero(correlation[start:] > best - 0.02 * (1 - best) - 0.002)[0]) + start
    top = first + int(np.argmax(correlation[first : first + max(2, first // 50)]))
    return top if 2 * LEAST_LINES < top <= n // LEAST_PERIODS else None


def _spectra(values: Floats, period: int, first: int) -> Complex:
    """Return the spectrum of each period, shape (periods, period // 2 + 1)."""
    return np.asarray(np.fft.rfft(values[first:].reshape(-1, period), axis=1))


def _without_drift(values: Floats, period: int, first: int) -> Complex:
    """Return the spectra of a position from its second difference, which hardly drifts."""
    second = np.zeros(values.size)
    second[1:-1] = np.diff(values, 2)
    second[-1] = second[-1 - period]
    factor = 2 * np.cos(2 * np.pi * np.arange(period // 2 + 1) / period) - 2
    factor[0] = 1.0
    return np.asarray(_spectra(second, period, first) / factor)


def _excited(spectra: Complex, period: int) -> NDArray[np.int64]:
    """Return the indices of the lines that stand out of the noise and beside the greatest."""
    mean, noise = np.abs(spectra.mean(axis=0)), spectra.std(axis=0, ddof=1) / np.sqrt(len(spectra))
    numbers = np.arange(mean.size)
    inside = (numbers > 0) & (numbers < HIGHEST_LINE * period)
    return np.flatnonzero(inside & (mean > EXCITED * mean[inside].max()) & (mean > ABOVE_NOISE * noise))


def _direction(position: Complex) -> Complex:
    """Return the lines of the velocity's sign, whose changes may lie between samples."""
    count = position.size
    finer = max(2, min(FINER, MOST_POINTS // count))
    fine = np.zeros((count - 1) * finer + 1, dtype=complex)
    fine[:count] = 1j * np.arange(count) * position * (np.arange(count) < HIGHEST_LINE * 2 * (count - 1))
    return np.asarray(np.fft.rfft(np.sign(np.fft.irfft(fine)))[:count] / finer)


def _rounding(channel: Channel, period: int) -> float:
    """Return the error of a line due to rounding. It is equal in each period, so averaging does not reduce it."""
    quantum = channel.quantum
    if quantum is None:
        steps = np.abs(np.diff(channel.values))
        quantum = float(steps[steps > 1e-9 * np.ptp(channel.values)].min(initial=np.inf))
    return quantum * np.sqrt(period / 12) if np.isfinite(quantum) else 0.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """A structure that the device may have."""

    masses: int
    lag: bool  # whether there is a first-order actuator between command and motor
    damped_handle: bool = False  # whether the handle has its own damping, which a problem file cannot state

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the structure's parameters."""
        parts = RIGID, SPRING * (self.masses == 2), ("handle_damping",) * self.damped_handle, ("lag",) * self.lag
        return sum(parts, ())

    def __str__(self) -> str:
        parts = ["one mass", "two masses"][self.masses - 1], "actuator" * self.lag, "damped handle" * self.damped_handle
        return ", ".join(part for part in parts if part)


@dataclass(frozen=True, slots=True)
class Task:
    """A response and a candidate: together they give the residuals for any parameters."""

    measured: Response
    candidate: Candidate
    actuator: Actuator | None
    left_out: NDArray[np.int64] | tuple[int, ...] = ()  # lines to skip
    aliased: Complex | float = 1.0  # ratio of the sampled to the continuous response to the command

    def numbers(self, at: Floats) -> dict[str, float]:
        """Return the parameters of the candidate at a point of the search."""
        by_name = zip(self.candidate.names, at, strict=True)
        return {name: float(np.exp(value)) if name in SCALED else float(value) for name, value in by_name}

    def device(self, at: Floats) -> Device:
        """Return the device at a point of the search."""
        numbers, structure = self.numbers(at), None
        if self.candidate.masses == 2:
            load = LeastOperator(0.0, numbers["handle_damping"]) if self.candidate.damped_handle else None
            structure = Structure(numbers["handle_mass"], numbers["frequency_hz"], numbers["damping_ratio"], load)
        actuator = Actuator(1 / (2 * pi * numbers["lag"])) if self.candidate.lag else self.actuator
        T = self.measured.sample_time
        return Device(numbers["mass"], numbers["damping"], T, numbers["delay"], actuator=actuator, structure=structure)

    def outputs(self, at: Floats) -> tuple[Complex, Complex]:
        """Return the responses of position and handle at a point of the search, m/N."""
        measured, omega, device = self.measured, self.measured.position.omega, self.device(at)
        late = np.exp(-1j * omega * device.delay) if measured.input == "force" else drive(device, omega) * self.aliased
        pushed = late - self.numbers(at)["coulomb"] * measured.friction
        motor, handle = compliances(device, omega)
        return motor * pushed, handle * pushed

    def sampled(self, at: Floats) -> Task:
        """Return the task with the aliasing computed at a point. The aliasing hardly depends on the parameters."""
        if self.measured.input == "force":
            return self
        device, omega = self.device(at), self.measured.position.omega
        with np.errstate(all="ignore"):
            return replace(
                self, aliased=held_compliance(device, omega) / (compliances(device, omega)[0] * drive(device, omega))
            )

    def errors(self, at: Floats) -> tuple[Complex, Floats, NDArray[np.int64]]:
        """Return the relative errors of the used lines, their spreads, and the outputs to which they belong."""
        rows = []
        for owner, (model, lines) in enumerate(
            zip(self.outputs(at), (self.measured.position, self.measured.handle), strict=True)
        ):
            if lines is not None:
                used = (lines.spread < OUTLYING) & ~np.isin(np.arange(lines.spread.size), self.left_out)
                errors = (model / lines.ratio - 1)[used]
                rows.append((errors, lines.spread[used], np.full(errors.size, owner)))
        errors, spreads, owners = (np.concatenate(column) for column in zip(*rows, strict=True))
        return errors, spreads, owners

    def residuals(self, at: Floats, model_errors: Floats) -> Floats:
        """Return the errors divided by their standard deviations, first all real parts, then all imaginary parts."""
        errors, spread, owners = self.errors(at)
        weighed = errors * sqrt(2) / np.hypot(spread, np.maximum(model_errors, FLOOR[0])[owners])
        return np.concatenate([weighed.real, weighed.imag])

    def units(self, at: Floats) -> Floats:
        """Return the size of a typical change of each parameter, which the search uses as unit."""
        measured = self.measured
        drag = self.numbers(at)["mass"] * float(measured.position.omega[0])
        pushed = 1 / float(np.median(np.abs(measured.friction)) + 1e-300)
        sizes = {"damping": drag, "handle_damping": drag, "coulomb": pushed, "delay": measured.sample_time}
        sizes["damping_ratio"] = 0.01
        return np.array([sizes.get(name, 0.1) for name in self.candidate.names])

    def solved(self, start: Floats, model_errors: Floats) -> tuple[Floats, Floats]:
        """Return the point with the least weighted squares from a start, and the standard deviations there if all
        residuals were independent."""
        from scipy.optimize import least_squares

        scale, names = self.units(start), self.candidate.names
        lower = np.array([-2 * self.measured.sample_time if name == "delay" else 0.0 for name in names])
        upper = np.full(start.size, np.inf)
        logs = np.array([name in SCALED for name in names])
        lower[logs], upper[logs] = start[logs] - LOG_RANGE, start[logs] + LOG_RANGE
        inside = np.maximum(start, lower + 1e-9 * scale)
        solved = least_squares(
            self.residuals, inside, args=(model_errors,), bounds=(lower, upper), x_scale=scale, max_nfev=EVALUATIONS
        )
        scaled = solved.jac * scale
        plain = np.sqrt(np.maximum(np.diag(np.linalg.pinv(scaled.T @ scaled, hermitian=True)), 0.0)) * scale
        return np.asarray(solved.x), plain


@dataclass(frozen=True, slots=True)
class ResponseFit:
    """The fit of a candidate."""

    task: Task
    at: Floats  # parameters in the form of the search
    plain: Floats  # their standard deviations for independent residuals
    model_errors: Floats  # relative, of position and handle, with which chi2 per degree of freedom is 1
    chi2: float  # with the noise alone, per degree of freedom

    def sigmas(self) -> dict[str, float]:
        """Return the standard deviations of the parameters by a jackknife over blocks of neighbouring lines."""
        blocks = np.array_split(np.arange(self.task.measured.position.omega.size), BLOCKS)
        points = [replace(self.task, left_out=block).solved(self.at, self.model_errors)[0] for block in blocks]
        sigma = np.maximum(np.sqrt((BLOCKS - 1) * np.var(points, axis=0)), self.plain)
        numbers = self.task.numbers(self.at)
        return {
            name: float(each) * (numbers[name] if name in SCALED else 1.0)
            for name, each in zip(self.task.candidate.names, sigma, strict=True)
        }

    def resonates(self) -> bool:
        """Return whether a resonance is pronounced and within the measured band, and the handle lighter than the
        device."""
        numbers, omega = self.task.numbers(self.at), self.task.measured.position.omega
        if self.task.candidate.masses == 1:
            return True
        inside = omega[0] < 2 * np.pi * numbers["frequency_hz"] < omega[-1]
        return inside and numbers["damping_ratio"] < MAX_DAMPING_RATIO and numbers["handle_mass"] < numbers["mass"]

    def criterion(self, model_errors: Floats) -> float:
        """Return chi2 with given model errors, plus a penalty for each free parameter (Bayes's criterion)."""
        residuals = self.task.sampled(self.at).residuals(self.at, model_errors)
        return float(residuals @ residuals) + self.at.size * log(residuals.size)


def fit_response(measured: Response, actuator: Actuator | None) -> list[ResponseFit]:
    """Return the fits of all candidates, the chosen one first: the simplest that explains a response about as well as
    the best one. None is left if no candidate explains it."""
    lags = (False, True) if measured.input == "command" and actuator is None else (False,)
    candidates = [Candidate(*each) for each in product((1, 2), lags, (False, True))]
    fits = [_fitted(measured, each, actuator) for each in candidates if each.masses == 2 or not each.damped_handle]
    found = [fit for fit in fits if fit is not None and fit.resonates()]
    if not found:
        return []
    reference = np.min([fit.model_errors for fit in found], axis=0)
    costs = [fit.criterion(reference) * DECISIVE_FACTOR ** (fit.task.candidate.masses - 1) for fit in found]
    chosen = found[int(np.argmin(costs))]
    return [chosen, *(fit for fit in found if fit is not chosen)]


def _fitted(measured: Response, candidate: Candidate, actuator: Actuator | None) -> ResponseFit | None:
    """Return the fit of a candidate: its best parameters with the model errors that explain the residual."""
    task = Task(measured, candidate, actuator)
    starts, errors = _starts(task), np.full(2, START_FLOOR)
    if not starts or task.residuals(starts[0], errors).size <= starts[0].size:
        return None
    solutions = [task.solved(start, errors)[0] for start in starts]
    at = min(solutions, key=lambda solution: float(np.sum(task.residuals(solution, errors) ** 2)))
    task = task.sampled(at)
    if not np.isfinite(task.aliased).all():
        return None
    nearest = task.residuals(task.solved(at, np.zeros(2))[0], np.zeros(2))
    for _ in range(ROUNDS):
        before, errors = errors, _model_errors(task, at)
        at, plain = task.solved(at, errors)
        task = task.sampled(at)
        if not np.isfinite(task.aliased).all():
            return None
        if np.allclose(before, errors, rtol=1e-3):
            break
    return ResponseFit(task, at, plain, errors, float(nearest @ nearest) / (nearest.size - at.size))


def _model_errors(task: Task, at: Floats) -> Floats:
    """Return the model error of each output with which its chi2 equals its share of the degrees of freedom."""
    errors, spread, outputs = task.errors(at)
    model_errors = np.zeros(2)
    for output in np.unique(outputs):
        mine = outputs == output
        power, noise = 2 * np.abs(errors[mine]) ** 2, spread[mine] ** 2
        dof = 2 * mine.sum() - at.size * mine.mean()
        low, high = FLOOR
        if float(np.sum(power / (noise + low**2))) <= dof:
            continue
        for _ in range(40):
            middle = sqrt(low * high)
            low, high = (middle, high) if float(np.sum(power / (noise + middle**2))) > dof else (low, middle)
        model_errors[output] = high
    return model_errors


def _starts(task: Task) -> list[Floats]:
    """Return the starts of the search: for two masses, a few resonances and shares of the handle."""
    measured, lines = task.measured, task.measured.position
    inertia = 1 / np.abs(lines.omega**2 * lines.ratio)
    phase = np.unwrap(np.angle(-lines.ratio))
    late = max(0.0, -float(phase @ lines.omega / (lines.omega @ lines.omega)) - measured.sample_time / 2)
    common = {"damping": 0.0, "coulomb": 0.0, "delay": late, "lag": measured.sample_time, "handle_damping": 0.0}
    starts = [common | {"mass": float(np.median(inertia))}]
    if task.candidate.masses == 2:
        total = float(np.median(inertia[: max(3, inertia.size // 10)]))
        peaks = [i for i in range(1, inertia.size - 1) if inertia[i] == inertia[max(0, i - 3) : i + 4].min()]
        starts = [
            common
            | {"mass": total, "damping_ratio": 0.02, "handle_mass": share * total}
            | {"frequency_hz": float(lines.omega[i] / (2 * np.pi))}
            for i in sorted(peaks, key=lambda i: inertia[i])[:3]
            for share in (0.1, 0.5)
        ]
    names = task.candidate.names
    return [np.array([log(each[name]) if name in SCALED else each[name] for name in names]) for each in starts]


def fit_drive(lines: Ratio, T: float) -> tuple[float, float, float, float]:
    """Return lag and delay from the held command to the measured force, s, and their standard deviations. The force is
    one at an instant, or free of images above the Nyquist frequency, whichever explains it better."""
    from scipy.optimize import least_squares

    def errors(at: Floats, instant: bool) -> Floats:
        lag, delay, w = float(np.exp(at[0])), float(at[1]) * T, np.exp(-1j * lines.omega * T)
        whole = np.ceil(delay / T)
        left = np.exp(-(whole * T - delay) / lag) * (1 - w) / (1 - np.exp(-T / lag) * w)
        smooth = np.exp(-1j * lines.omega * (delay + T / 2)) / (1 + 1j * lines.omega * lag)
        return np.ravel(((w**whole * (1 - left) if instant else smooth) / lines.ratio - 1).view(float))

    early = lines.omega <= 2 * lines.omega[lines.omega.size // 8]
    phase = -np.unwrap(np.angle(lines.ratio[early]))
    late = max(float(phase @ lines.omega[early]) / float(np.sum(lines.omega[early] ** 2)) - T / 2, T)
    solved = min(
        (
            least_squares(errors, [np.log(share * late), (1 - share) * late / T], args=(instant,))
            for share in (0.1, 0.4, 0.8)
            for instant in (True, False)
        ),
        key=lambda each: float(each.cost),
    )
    starts = np.unique(np.linspace(0, solved.fun.size, BLOCKS, endpoint=False).astype(int))
    sigma = np.sqrt(np.diag(jackknife(solved.jac, solved.fun, starts)))
    seen = np.linalg.norm(solved.jac[:, 0]) > UNSEEN * sqrt(solved.fun.size)
    lag = float(np.exp(solved.x[0])) * seen
    return lag, float(solved.x[1]) * T, lag * float(sigma[0]), float(sigma[1]) * T


def periodic_study(recording: Recording, T: float, actuator: Actuator | None) -> Study | None:
    """Study a periodic excitation; None if the recording is none, or no device explains it."""
    measured = None if "hand" in recording.channels else response(recording, T)
    fits = [] if measured is None else fit_response(measured, actuator)
    if measured is None or not fits:
        return None
    fit, name, omega = fits[0], recording.name, measured.position.omega
    numbers, sigma, candidate = fit.task.numbers(fit.at), fit.sigmas(), fit.task.candidate
    records = [number(each, numbers[each], sigma[each]) for each in candidate.names]
    text, found, remarks = f"{name}: response", list[Estimate](), list[Note]()

    def add(key: str, value: float, sigma: float, suffix: str = "", excess: float = 0.0) -> None:
        found.append(Estimate(key, value, sigma, text + suffix, (excess, excess)))

    add("mass", numbers["mass"], sigma["mass"])
    delay, late, lag = numbers["delay"], sigma["delay"], (numbers.get("lag", 0.0), sigma.get("lag", 0.0))
    behind = box([Estimate("delay", delay, late, "")], T)[0] if measured.input == "force" else None
    if measured.drive is not None:
        through, delayed, *unsure = fit_drive(measured.drive, T)
        lag, delay, late = (through, unsure[0]), delay + delayed, hypot(late, unsure[1])
        records.append(number("command to force, lag", *lag))
        records.append(number("command to force, delay", delayed + T / 2, unsure[1]))
    if lag[0] > max(SIGNIFICANT * lag[1], T / (2 * pi * FASTEST)):
        add("actuator.bandwidth_hz", 1 / (2 * pi * lag[0]), lag[1] / (2 * pi * lag[0] ** 2))
    elif candidate.lag or measured.drive is not None:
        delay, late = delay + lag[0], hypot(late, lag[1])
        what = f"{name}: the actuator's lag, {lag[0] / T:.2f} samples, is not significant: it is left out, and the "
        remarks.append(Note("remark-no-lag", f"{what}delay includes it"))
    add("delay", delay, late)
    of_damping = [fit, *(each for each in fits[1:] if each.task.candidate == replace(candidate, damped_handle=False))]
    for each in of_damping if candidate.damped_handle else [fit]:
        suffix = f", {each.task.candidate}" if candidate.damped_handle else ""
        its, unsure_by = each.task.numbers(each.at), sigma if each is fit else each.sigmas()
        total = its["damping"] + its.get("handle_damping", 0.0)
        deviation = hypot(unsure_by["damping"], unsure_by.get("handle_damping", 0.0))
        add("damping", total, deviation, suffix, COULOMB_SHARE * its["coulomb"] / measured.speed)
        if candidate.masses == 2:
            add("structure.damping_ratio", its["damping_ratio"], unsure_by["damping_ratio"], suffix)
    for key in SPRING[:2] if candidate.masses == 2 else ():
        add(f"structure.{key}", numbers[key], sigma[key])
    highest = f"{name}: nothing was measured above {omega[-1] / (2 * pi):.4g} Hz, where unmodelled keeps its last value"
    remarks.insert(0, Note("remark-highest-line", highest))
    if candidate.damped_handle:
        what = f"{name}: the handle has a damping of its own, {numbers['handle_damping']:.3g} {recording.units.damping}"
        remarks.append(
            Note(
                "remark-handle-damping",
                f"{what}, which a problem file cannot state: the intervals of both dampings contain it and the fit "
                "without it, and unmodelled covers the rest",
            )
        )
    device, (fitted, _) = fit.task.device(fit.at), fit.task.outputs(fit.at)

    def model(other: Device) -> Complex:
        if measured.input == "command":
            return held_compliance(other, omega)
        return np.asarray(compliances(other, omega)[0] * np.exp(-1j * omega * other.delay))

    rubbed = compliances(device, omega)[0] * numbers["coulomb"] * measured.friction
    lines = Lines(
        omega / (2 * pi), measured.position.ratio + rubbed, measured.position.spread, fitted + rubbed, model, behind
    )
    candidates = [
        CandidateRecord(
            structure=str(each.task.candidate), chosen=each is fit, chi2=each.chi2,
            model_error=[float(share) for share in each.model_errors],
        )
        for each in sorted(fits, key=lambda each: (each.task.candidate.masses, each.task.candidate.names))
    ]  # fmt: skip
    record = record_of(
        recording, T,
        kind=f"{measured.periods} periods of {measured.period * T:g} s, {omega.size} lines",
        used=measured.period * measured.periods,
        residual_share=float(np.sqrt(np.mean(np.abs(fitted / measured.position.ratio - 1) ** 2))),
        chi2=fit.chi2, numbers=records, derived=_derived(device, recording), candidates=candidates,
    )  # fmt: skip
    friction = numbers["coulomb"] if numbers["coulomb"] > 2 * sigma["coulomb"] > 0 else None
    return Study(recording, record, "response", found, [lines], remarks=remarks, friction=friction)


def _derived(device: Device, recording: Recording) -> list[NumberRecord]:
    """Return the quantities that describe a structure, such as both masses, the stiffness and the antiresonance."""
    if device.structure is None:
        return []
    parts = mechanism(device, device.structure, FLOATS)
    derived = {
        "motor mass": parts.motor,
        "handle mass": parts.handle,
        "stiffness": parts.stiffness,
        "antiresonance, Hz": sqrt(parts.stiffness / device.structure.handle_mass) / (2 * pi),
        "resonance, Hz": device.structure.frequency_hz,
        f"damping between them, {recording.units.damping}": parts.viscosity,
    }
    return [number(name, value) for name, value in derived.items()]
