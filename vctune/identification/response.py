"""Fit to the lines of a periodic excitation the device that explains them (README, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from math import ceil, hypot, log, pi, sqrt

import numpy as np

from vctune.analysis.sampled_loop import pulse_transfer
from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import CandidateRecord, Estimate, NumberRecord
from vctune.document.schema.rules import FASTEST
from vctune.document.text.errors import Note
from vctune.identification.box import COULOMB_SHARE, box, jackknife, left_to_the_hand, pulled
from vctune.identification.spectra import Response, response
from vctune.identification.study import Complex, Lines, Study, number, record_of
from vctune.model.device import Device
from vctune.model.hands import LeastOperator
from vctune.model.loop.device_response import device_response, mechanism
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure


def drive(device: Device, omega: Floats) -> Complex:
    """Return A H e^(-s delay), the response of the motor's force to the held command."""
    at = device_response(device, omega, FLOATS).drive
    return np.asarray(at.re - 1j * omega * at.lag)


def compliances(device: Device, omega: Floats) -> tuple[Complex, Complex]:
    """Return the responses of motor and handle to a force on the motor, m/N."""
    at = device_response(replace(device, delay=0.0, actuator=None, velocity=None), omega, FLOATS)
    s = 1j * omega
    Z_1 = at.damping + s * at.mass
    if at.spring is None:
        return 1 / (s * Z_1), 1 / (s * Z_1)
    y = omega**2 * at.spring.y_c + 1j * omega * at.spring.y_k
    Z_2 = (at.spring.damping or 0.0) + s * at.spring.mass
    motor = 1 / (s * (Z_1 + Z_2 / (1 + y * Z_2)))
    return motor, motor / (1 + y * Z_2)


def held_compliance(device: Device, omega: Floats) -> Complex:
    """Return the exact response of the motor at the samples to a command that is held between them, m/N."""
    T = device.sample_time
    early = max(0, ceil(-float(device.delay) / T))
    there = replace(device, delay=float(device.delay) + early * T, velocity=None)
    return np.asarray(pulse_transfer(there, omega, position=True)[1] * np.exp(1j * omega * T * early))


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
class Task:
    """A response and a structure that the device may have: together they give the residuals for any parameters."""

    measured: Response
    actuator: Actuator | None  # the one that the user states
    masses: int
    lag: bool  # whether there is a first-order actuator between command and motor
    damped_handle: bool  # whether the handle has its own damping, which a problem file cannot state
    sprung: bool = False  # whether a spring pulls on the motor, which a problem file cannot state either
    left_out: tuple[int, ...] = ()  # lines to skip
    # ratio of the sampled to the continuous response to the command, which hardly depends on the parameters; None if it
    # is to be computed
    aliased: Complex | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return (
            *RIGID,
            *SPRING * (self.masses == 2),
            *("handle_damping",) * self.damped_handle,
            *("lag",) * self.lag,
            *("stiffness",) * self.sprung,
        )

    def __str__(self) -> str:
        parts = ["one mass", "two masses"][self.masses - 1], "actuator" * self.lag, "damped handle" * self.damped_handle
        return ", ".join(part for part in (*parts, "spring" * self.sprung) if part)

    def numbers(self, at: Floats) -> dict[str, float]:
        """Return the parameters at a point of the search."""
        by_name = zip(self.names, at, strict=True)
        return {name: float(np.exp(value)) if name in SCALED else float(value) for name, value in by_name}

    def device(self, at: Floats) -> Device:
        """Return the device at a point of the search."""
        numbers, structure = self.numbers(at), None
        if self.masses == 2:
            load = LeastOperator(0.0, numbers["handle_damping"]) if self.damped_handle else None
            structure = Structure(numbers["handle_mass"], numbers["frequency_hz"], numbers["damping_ratio"], load)
        actuator = Actuator(1 / (2 * pi * numbers["lag"])) if self.lag else self.actuator
        T = self.measured.sample_time
        return Device(numbers["mass"], numbers["damping"], T, numbers["delay"], actuator=actuator, structure=structure)

    def outputs(self, at: Floats) -> Complex:
        """Return the responses of position and handle at a point of the search, m/N, as in `Response.ratio`."""
        measured, device = self.measured, self.device(at)
        motor, handle = compliances(device, measured.omega)
        late = None if self.aliased is None else motor * drive(device, measured.omega) * self.aliased
        late = pushed(measured, device) if late is None else late
        moved = late - motor * self.numbers(at)["coulomb"] * measured.friction
        moved = moved / (1 + self.numbers(at).get("stiffness", 0.0) * motor)
        return np.array([moved, moved * handle / motor][: len(measured.ratio)])

    def errors(self, at: Floats) -> tuple[Complex, Floats]:
        """Return the relative errors of the lines, and their spreads, infinite for a line that the fit skips."""
        with np.errstate(all="ignore"):
            errors = self.outputs(at) / self.measured.ratio - 1
        spread = np.where(self.measured.spread < OUTLYING, self.measured.spread, np.inf)
        spread[:, list(self.left_out)] = np.inf
        return np.nan_to_num(errors, nan=1e30, posinf=1e30, neginf=-1e30), spread

    def residuals(self, at: Floats, model_errors: Floats) -> Floats:
        """Return real and imaginary parts of the errors, divided by their standard deviations."""
        errors, spread = self.errors(at)
        weighed = errors * sqrt(2) / np.hypot(spread, np.maximum(model_errors, FLOOR[0])[: len(spread), None])
        return np.ravel(weighed[np.isfinite(spread)].view(float))

    def solved(self, start: Floats, model_errors: Floats) -> tuple[Floats, Floats]:
        """Return the point with the least weighted squares from a start, and the standard deviations there if all
        residuals were independent."""
        from scipy.optimize import least_squares

        measured, names, device = self.measured, self.names, self.device(start)
        with np.errstate(all="ignore"):
            continuous = compliances(device, measured.omega)[0] * drive(device, measured.omega)
            is_held = measured.input == "command"
            here = replace(self, aliased=pushed(measured, device) / continuous if is_held else None)
        drag = self.numbers(start)["mass"] * float(measured.omega[0])
        typical = {"damping": drag, "handle_damping": drag, "delay": measured.sample_time, "damping_ratio": 0.01}
        typical["stiffness"] = drag * float(measured.omega[0])
        typical["coulomb"] = 1 / float(np.median(np.abs(measured.friction)) + 1e-300)
        scale, logs = np.array([typical.get(name, 0.1) for name in names]), np.array([name in SCALED for name in names])
        lower = np.array([-2 * measured.sample_time if name == "delay" else 0.0 for name in names])
        bounds = np.where(logs, start - LOG_RANGE, lower), np.where(logs, start + LOG_RANGE, np.inf)
        inside = np.maximum(start, bounds[0] + 1e-9 * scale)
        solved = least_squares(
            here.residuals, inside, args=(model_errors,), bounds=bounds, x_scale=scale, max_nfev=EVALUATIONS
        )
        scaled = solved.jac * scale
        plain = np.sqrt(np.maximum(np.diag(np.linalg.pinv(scaled.T @ scaled, hermitian=True)), 0.0)) * scale
        return np.asarray(solved.x), plain


def pushed(measured: Response, device: Device) -> Complex:
    """Return the response of a device's motor to the input of a recording, m/N."""
    if measured.input == "command":
        return held_compliance(device, measured.omega)
    return np.asarray(compliances(device, measured.omega)[0] * np.exp(-1j * measured.omega * device.delay))


@dataclass(frozen=True, slots=True)
class ResponseFit:
    """The fit of a structure."""

    task: Task
    at: Floats  # parameters in the form of the search
    plain: Floats  # their standard deviations for independent residuals
    model_errors: Floats  # relative, of position and handle, with which chi2 per degree of freedom is 1
    chi2: float  # with the noise alone, per degree of freedom

    @property
    def numbers(self) -> dict[str, float]:
        """The parameters."""
        return self.task.numbers(self.at)

    def sigmas(self) -> dict[str, float]:
        """Return the standard deviations of the parameters by a jackknife over blocks of neighbouring lines."""
        blocks = np.array_split(np.arange(self.task.measured.omega.size), BLOCKS)
        tasks = [replace(self.task, left_out=tuple(block)) for block in blocks]
        points = [task.solved(self.at, self.model_errors)[0] for task in tasks]
        sigma = np.maximum(np.sqrt((BLOCKS - 1) * np.var(points, axis=0)), self.plain)
        by_name = zip(self.numbers.items(), sigma, strict=True)
        return {name: float(each) * (value if name in SCALED else 1.0) for (name, value), each in by_name}

    def resonates(self) -> bool:
        """Return whether a resonance is pronounced and within the measured band, and the handle lighter than the
        device."""
        if self.task.masses == 1:
            return True
        numbers, omega = self.numbers, self.task.measured.omega
        inside = omega[0] < 2 * np.pi * numbers["frequency_hz"] < omega[-1]
        return inside and numbers["damping_ratio"] < MAX_DAMPING_RATIO and numbers["handle_mass"] < numbers["mass"]

    def criterion(self, model_errors: Floats) -> float:
        """Return chi2 with given model errors, plus a penalty for each free parameter (Bayes's criterion)."""
        residuals = self.task.residuals(self.at, model_errors)
        value = float(residuals @ residuals) + self.at.size * log(residuals.size)
        return value * DECISIVE_FACTOR ** (self.task.masses - 1 + 0.5 * self.task.sprung)


def fit_response(measured: Response, actuator: Actuator | None) -> list[ResponseFit]:
    """Return the fits of all structures, the chosen one first: the simplest that explains a response about as well as
    the best one. None is left if no structure explains it."""
    lags = (False, True) if measured.input == "command" and actuator is None else (False,)
    tasks = [
        Task(measured, actuator, masses, lag, damped)
        for masses, lag, damped in product((1, 2), lags, (False, True))
        if masses == 2 or not damped
    ]
    tasks += [
        replace(task, sprung=True) for task in tasks if not task.damped_handle and not (task.lag and task.masses == 2)
    ]
    found = [fit for fit in map(_fitted, tasks) if fit is not None and fit.resonates()]
    reference = np.min([fit.model_errors for fit in found], axis=0) if found else np.zeros(2)
    return sorted(found, key=lambda fit: fit.criterion(reference))


def _fitted(task: Task) -> ResponseFit | None:
    """Return the fit of a structure: its best parameters with the model errors that explain the residual."""
    starts, errors = _starts(task), np.full(2, START_FLOOR)
    if not starts or task.residuals(starts[0], errors).size <= starts[0].size:
        return None
    solutions = [task.solved(start, errors)[0] for start in starts]
    at = min(solutions, key=lambda solution: float(np.sum(task.residuals(solution, errors) ** 2)))
    nearest = task.residuals(task.solved(at, np.zeros(2))[0], np.zeros(2))
    plain = np.zeros(at.size)
    for _ in range(ROUNDS):
        before, errors = errors, _model_errors(task, at)
        at, plain = task.solved(at, errors)
        if np.allclose(before, errors, rtol=1e-3):
            break
    return ResponseFit(task, at, plain, errors, float(nearest @ nearest) / (nearest.size - at.size))


def _model_errors(task: Task, at: Floats) -> Floats:
    """Return the model error of each output with which its chi2 equals its share of the degrees of freedom."""
    from scipy.optimize import brentq

    errors, spread = task.errors(at)
    used, model_errors = np.isfinite(spread), np.zeros(2)
    for output, mine in enumerate(used):
        power, noise = 2 * np.abs(errors[output, mine]) ** 2, spread[output, mine] ** 2
        dof = 2 * mine.sum() - at.size * mine.sum() / used.sum()

        def excess(logarithm: float, power: Floats = power, noise: Floats = noise, dof: float = dof) -> float:
            return float(np.sum(power / (noise + np.exp(2 * logarithm)))) - dof

        low, high = np.log(FLOOR)
        if excess(low) > 0:
            model_errors[output] = np.exp(brentq(excess, low, high)) if excess(high) < 0 else FLOOR[1]
    return model_errors


def _starts(task: Task) -> list[Floats]:
    """Return the starts of the search: for two masses, a few resonances and shares of the handle."""
    omega, ratio, T = task.measured.omega, task.measured.ratio[0], task.measured.sample_time
    inertia, phase = 1 / np.abs(omega**2 * ratio), np.unwrap(np.angle(-ratio))
    late = max(0.0, -float(phase @ omega / (omega @ omega)) - T / 2)
    starts = [{"damping": 0.0, "coulomb": 0.0, "delay": late, "lag": T, "handle_damping": 0.0, "stiffness": 0.0}]
    starts[0]["mass"] = float(np.median(inertia))
    if task.sprung:  # the slowest lines show the spring, the fastest the mass, and both resonate at the greatest
        mass, peak = float(np.median(inertia[inertia.size // 2 :])), float(omega[np.argmax(np.abs(ratio))])
        starts = [starts[0] | {"mass": mass, "stiffness": k} for k in (0.5 / float(np.abs(ratio[0])), mass * peak**2)]
    if task.masses == 2:
        total = float(np.median(inertia[: max(3, inertia.size // 10)]))
        peaks = [i for i in range(1, inertia.size - 1) if inertia[i] == inertia[max(0, i - 3) : i + 4].min()]
        spring = {"mass": total, "damping_ratio": 0.02}
        starts = [
            starts[-1] | spring | {"handle_mass": share * total, "frequency_hz": float(omega[i] / (2 * np.pi))}
            for i in sorted(peaks, key=lambda i: inertia[i])[:3]
            for share in (0.1, 0.5)
        ]
    return [np.array([log(each[name]) if name in SCALED else each[name] for name in task.names]) for each in starts]


def fit_drive(omega: Floats, drive: Complex, T: float) -> tuple[float, float, float, float]:
    """Return lag and delay from the held command to the measured force, s, and their standard deviations. The force is
    one at an instant, or free of images above the Nyquist frequency, whichever explains it better."""
    from scipy.optimize import least_squares

    def errors(at: Floats, instant: bool) -> Floats:
        lag, delay, w = float(np.exp(at[0])), float(at[1]) * T, np.exp(-1j * omega * T)
        whole = np.ceil(delay / T)
        left = np.exp(-(whole * T - delay) / lag) * (1 - w) / (1 - np.exp(-T / lag) * w)
        smooth = np.exp(-1j * omega * (delay + T / 2)) / (1 + 1j * omega * lag)
        return np.ravel(((w**whole * (1 - left) if instant else smooth) / drive - 1).view(float))

    early = omega <= 2 * omega[omega.size // 8]
    phase = -np.unwrap(np.angle(drive[early]))
    late = max(float(phase @ omega[early]) / float(np.sum(omega[early] ** 2)) - T / 2, T)
    tried = product((0.1, 0.4, 0.8), (True, False))
    solved = min(
        (least_squares(errors, [np.log(share * late), (1 - share) * late / T], args=(how,)) for share, how in tried),
        key=lambda each: float(each.cost),
    )
    starts = np.unique(np.linspace(0, solved.fun.size, BLOCKS, endpoint=False).astype(int))
    sigma = np.sqrt(np.diag(jackknife(solved.jac, solved.fun, starts)))
    seen = np.linalg.norm(solved.jac[:, 0]) > UNSEEN * sqrt(solved.fun.size)
    lag = float(np.exp(solved.x[0])) * seen
    return lag, float(solved.x[1]) * T, lag * float(sigma[0]), float(sigma[1]) * T


def periodic_study(recording: Recording, T: float, actuator: Actuator | None, *, held: bool = False) -> Study | None:
    """Study a periodic excitation; None if the recording is none, or no device explains it. If `held`, a spring may
    pull, which stays outside the device as a hand does."""
    measured = None if "hand" in recording.channels else response(recording, T)
    fits = [] if measured is None else fit_response(measured, actuator)
    if measured is None or not fits:
        return None
    fit, name, omega, units = fits[0], recording.name, measured.omega, recording.units
    task, device, numbers, sigma = fit.task, fit.task.device(fit.at), fit.numbers, fit.sigmas()
    records = [number(each, value, sigma[each]) for each, value in numbers.items()]
    found, source = list[Estimate](), f"{name}: response"
    highest = f"{name}: nothing was measured above {omega[-1] / (2 * pi):.4g} Hz, where unmodelled keeps its last value"
    remarks = [Note("remark-highest-line", highest)]
    if task.sprung and not held:
        raise pulled(recording, numbers["stiffness"], numbers["mass"])
    if task.sprung:
        remarks.append(left_to_the_hand(recording, numbers["stiffness"], numbers["mass"]))

    def add(key: str, value: float, sigma: float, suffix: str = "", excess: float = 0.0) -> None:
        found.append(Estimate(key, value, sigma, source + suffix, (excess, excess)))

    add("mass", numbers["mass"], sigma["mass"])
    delay, late, lag = numbers["delay"], sigma["delay"], (numbers.get("lag", 0.0), sigma.get("lag", 0.0))
    behind = box([Estimate("delay", delay, late, "")], T)[0] if measured.input == "force" else None
    if measured.drive is not None:
        through, delayed, *unsure = fit_drive(omega, measured.drive, T)
        lag, delay, late = (through, unsure[0]), delay + delayed, hypot(late, unsure[1])
        records.append(number("command to force, lag", *lag))
        records.append(number("command to force, delay", delayed + T / 2, unsure[1]))
    if lag[0] > max(SIGNIFICANT * lag[1], T / (2 * pi * FASTEST)):
        add("actuator.bandwidth_hz", 1 / (2 * pi * lag[0]), lag[1] / (2 * pi * lag[0] ** 2))
    elif task.lag or measured.drive is not None:
        delay, late = delay + lag[0], hypot(late, lag[1])
        text = f"{name}: the actuator's lag, {lag[0] / T:.2f} samples, is not significant: it is left out, and the "
        remarks.append(Note("remark-no-lag", f"{text}delay includes it"))
    add("delay", delay, late)
    plain = [each for each in fits if str(each.task) == str(replace(task, damped_handle=False))]
    for each in [*plain, fit] if task.damped_handle else [fit]:
        suffix, its = f", {each.task}" if task.damped_handle else "", each.numbers
        unsure_by = sigma if each is fit else each.sigmas()
        deviation = hypot(unsure_by["damping"], unsure_by.get("handle_damping", 0.0))
        excess = COULOMB_SHARE * its["coulomb"] / measured.speed
        add("damping", its["damping"] + its.get("handle_damping", 0.0), deviation, suffix, excess)
        if task.masses == 2:
            add("structure.damping_ratio", its["damping_ratio"], unsure_by["damping_ratio"], suffix)
    for key in SPRING[:2] if task.masses == 2 else ():
        add(f"structure.{key}", numbers[key], sigma[key])
    if task.damped_handle:
        text = (
            f"{name}: the handle has a damping of its own, {numbers['handle_damping']:.3g} {units.damping}, which a "
            "problem file cannot state: the intervals of both dampings contain it and the fit without it, and "
            "unmodelled covers the rest"
        )
        remarks.append(Note("remark-handle-damping", text))
    ratio, fitted = measured.ratio[0], task.outputs(fit.at)[0]
    motor = compliances(device, omega)[0]
    rubbed, free = motor * numbers["coulomb"] * measured.friction, 1 + numbers.get("stiffness", 0.0) * motor
    lines = Lines(
        omega / (2 * pi), ratio * free + rubbed, measured.spread[0], fitted * free + rubbed,
        lambda other: pushed(measured, other), behind,
    )  # fmt: skip
    candidates = [
        CandidateRecord(
            structure=str(each.task), chosen=each is fit, chi2=each.chi2,
            model_error=[float(share) for share in each.model_errors],
        )
        for each in sorted(fits, key=lambda each: (each.task.masses, each.task.names))
    ]  # fmt: skip
    record = record_of(
        recording, T,
        kind=f"{measured.periods} periods of {measured.period * T:g} s, {omega.size} lines",
        used=measured.period * measured.periods,
        residual_share=float(np.sqrt(np.mean(np.abs(fitted / ratio - 1) ** 2))),
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
