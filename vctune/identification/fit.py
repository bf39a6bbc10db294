"""Fit a stepped device to a log by multiple shooting: Gauss-Newton over the rows of segments whose first states are
free (README, section 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.identification.stepped import Drive, Numbers, stepped

# Positive numbers, moved by their logarithms
SCALED = ("mass", "handle_mass", "frequency_hz", "damping_ratio", "lag", "stribeck")
NOT_NEGATIVE = ("damping", "damping_back", "coulomb", "stiction")
STEPS, TRIED, ENOUGH = 40, 10, 1e-5  # Gauss-Newton steps, those near an end, and the least relative gain of a step
LONGEST_STEP, LONGEST_DELAY = 0.7, 2.0  # Greatest change in a step: of a logarithm, and of a delay in rows
LEAST_DAMPED, MOST_DAMPED = 1e-7, 1e4  # Range of Marquardt's damping
ORDER = 12  # Of the filter that makes a residual white
QUANTILE = 0.99  # Of a number's distribution at the end of its interval
SEGMENTS = 8  # Least number of segments


@dataclass(frozen=True, slots=True)
class Task:
    """A log in segments, with all that is fitted to it."""

    drive: Drive
    read: Floats  # what was read, in standard deviations of its noise, shape (rows, readings)
    unit: Floats  # those standard deviations, SI units, shape (readings,)
    starts: NDArray[np.integer]  # first rows of the segments
    rows: int  # of a segment
    fixed: Numbers = field(default_factory=dict)  # numbers that are not fitted
    white: tuple[float, ...] = (1.0,)  # filter that makes the residual white
    beside: Mapping[str, Floats] = field(default_factory=dict)  # motions (rows,) that a number adds to what is read

    def whitened(self, values: Floats) -> Floats:
        """Return values of shape (rows, readings, ..., segments) after the filter, without its first rows."""
        from scipy.signal import lfilter

        return values if len(self.white) == 1 else np.asarray(lfilter(self.white, [1.0], values, axis=0)[ORDER:])

    def measured(self) -> Floats:
        """Return what was read in each segment, shape (rows, readings, segments)."""
        return np.asarray(self.read[self.starts + np.arange(self.rows)[:, None]].transpose(0, 2, 1))

    def stepped(self, devices: Sequence[Numbers], first: Floats) -> Floats:
        """Return the readings of devices, in standard deviations of the noise."""
        known = [{**self.fixed, **each} for each in devices]
        read = stepped(self.drive, known, first, self.starts, self.rows)
        for name, motion in self.beside.items():
            times = np.array([each[name] for each in devices])
            read[:, 0] += times[:, None] * motion[self.starts + np.arange(self.rows)[:, None]][:, None]
        return read / self.unit[:, None, None]

    def typical(self, numbers: Numbers) -> dict[str, float]:
        """Return the step of a derivative by each number."""
        T, mass, push = self.drive.T, numbers.get("mass", 1.0), self.drive.greatest
        known = {"mass": 3e-3, "handle_mass": 0.01, "frequency_hz": 3e-3, "damping_ratio": 0.05, "lag": 0.02}
        known |= {key: 0.01 * numbers.get(key, 0.0) + 1e-3 * mass for key in ("damping", "damping_back")}
        known |= {
            "offset": 2e-3 * push,
            "coulomb": 2e-3 * push,
            "stiction": 2e-3 * push,
            "stribeck": 0.05,
            "cosine": 0.1 * mass,
            "gain": 1e-3,
            "delay": 0.05 * T,
            "sensor_delay": 0.05 * T,
        }
        known |= {key: 0.02 * abs(numbers.get(key, 0.0)) + 0.1 * mass for key in ("stiffness", "sine")}
        known |= {key: float(self.unit[0] / (np.std(motion) + 1e-300)) for key, motion in self.beside.items()}
        return {key: known[key] for key in numbers}


@dataclass(frozen=True)
class Fit:
    """The best device near a start."""

    task: Task
    numbers: dict[str, float]
    first: Floats  # states at the starts of the segments
    residual: Floats  # white, in standard deviations of the noise, shape (rows, readings, segments)
    slopes: Floats  # of the residual by the steps of the numbers, first states projected out, (segments, rows, numbers)
    steps: dict[str, float]

    @property
    def known(self) -> dict[str, float]:
        """The numbers, fitted or not."""
        return {**self.task.fixed, **self.numbers}

    @cached_property
    def left(self) -> Floats:
        """The residual without its filter, in deviations of the noise, shape (rows, readings, segments)."""
        return np.asarray(self.task.measured() - self.task.stepped([self.numbers], self.first[None])[:, :, 0])

    @property
    def cost(self) -> float:
        """The sum of the squares of the residual."""
        return float(np.sum(self.residual**2))

    @property
    def size(self) -> float:
        """The root mean square of the residual per degree of freedom: 1 if the noise is all that is left."""
        lost = self.first.size + len(self.numbers)
        return float(np.sqrt(self.cost / max(self.residual.size - lost, 1)))

    @cached_property
    def inverse(self) -> Floats:
        """The inverse of the normal matrix."""
        normal = np.einsum("sij,sik->jk", self.slopes, self.slopes)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-12 * normal.max()))
        return np.asarray(
            np.linalg.pinv(normal / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size)
        )

    @cached_property
    def scores(self) -> Floats:
        """What each segment pulls the numbers by, to first order, shape (segments, numbers)."""
        flat = self.residual.reshape(-1, self.residual.shape[-1]).T
        return np.asarray(np.einsum("sij,si->sj", self.slopes, flat) @ self.inverse)

    def sigmas(self) -> dict[str, float]:
        """Return the standard deviations: the sandwich over segments, at least that of a white residual.

        Of few segments it is itself uncertain: Student's quantile takes the place of the normal one.
        """
        from scipy.special import ndtri, stdtrit

        count = len(self.scores)
        unsure = float(stdtrit(max(count - 1, 1), QUANTILE) / ndtri(QUANTILE))
        robust = np.sum(self.scores**2, axis=0) * count / max(count - 1, 1) * unsure**2
        plain = np.diag(self.inverse) * max(self.size, 1.0) ** 2
        return in_units(self.numbers, self.steps, np.sqrt(np.maximum(robust, plain)))

    def inflation(self) -> float:
        """Return the factor by which correlation between the rows of a segment increases a variance."""
        robust, plain = np.sum(self.scores**2, axis=0), np.diag(self.inverse) * self.size**2
        told = plain > 0
        return max(1.0, float(np.median(robust[told] / plain[told]))) if told.any() else 1.0


def noise_is_all(fit: Fit, deviations: float = 3.0) -> bool:
    """Return whether the residual is the noise of the readings, within some deviations of its size."""
    return fit.size < 1 + deviations / np.sqrt(2 * fit.residual.size)


def moved(numbers: Numbers, by: Numbers) -> dict[str, float]:
    """Return numbers after changes, logarithms of the positive ones."""
    return {
        name: value * float(np.exp(by[name])) if name in SCALED else float(value + by[name])
        for name, value in numbers.items()
    }


def in_units(numbers: Numbers, steps: Numbers, by: Floats) -> dict[str, float]:
    """Return changes of numbers, given in steps, in SI units."""
    return {
        name: float(change) * step * (numbers[name] if name in SCALED else 1.0)
        for (name, step), change in zip(steps.items(), by, strict=True)
    }


def first_states(task: Task, numbers: Numbers) -> Floats:
    """Return the free states at the starts of the segments as cubics through their first rows show them."""
    near, drive = min(24, task.rows), task.drive
    rows = task.measured()[:near] * task.unit[:, None]
    cubic = [np.polynomial.polynomial.polyfit(np.arange(near) * drive.T, one, 3) for one in rows.transpose(1, 0, 2)]
    still = np.zeros_like(cubic[0][0])
    motor, handle = (each[:2] if drive.reads[0] == 0 else (still, each[0]) for each in (cubic[0], cubic[-1]))
    free = drive.free({**task.fixed, **numbers})
    return np.array([*motor, *handle])[free].reshape(len(free), task.starts.size)


def fitted(
    task: Task, numbers: Numbers, first: Floats | None = None, steps: int = STEPS, enough: float = ENOUGH
) -> Fit:
    """Return the least-squares fit from a start, by Levenberg's and Marquardt's method.

    The first states of the segments are projected out of the residual and of its slopes, one segment at a time.
    """
    at, measured = dict(numbers), task.measured()
    z = first_states(task, at) if first is None else first
    T, free, count = task.drive.T, len(z), len(at)
    place = task.unit[0] * (1.0 if task.drive.reads[0] == 0 else T)
    of_state = task.drive.free({**task.fixed, **at})
    by_state = np.array(
        [place if state % 2 == 0 else 0.1 * place / T + 0.02 * np.std(z[i]) for i, state in enumerate(of_state)]
    )

    def at_point(at: Numbers, z: Floats) -> tuple[Floats, Floats, dict[str, float]]:
        """Return the residual, its slopes by numbers and first states, and the steps of the numbers."""
        steps_of = task.typical(at)
        ahead = [moved(at, {name: steps_of[name] * (name == which) for name in at}) for which in at]
        states = np.repeat(z[None], count + free + 1, axis=0)
        states[count + np.arange(free), np.arange(free)] += by_state[:, None]
        readings = task.stepped([*ahead, *[at] * (free + 1)], states)
        slopes = task.whitened(readings[:, :, :-1] - readings[:, :, -1:])
        return task.whitened(measured - readings[:, :, -1]), slopes, steps_of

    left, slopes, steps_of = at_point(at, z)
    damped, accepted, fresh = 1e-3, 0, True
    for _ in range(3 * steps):
        if fresh:
            table = slopes.transpose(3, 0, 1, 2).reshape(slopes.shape[3], -1, count + free)
            products = table.transpose(0, 2, 1) @ table
            pulls = np.einsum("sij,si->sj", table, left.reshape(-1, left.shape[-1]).T)
            own, of_first = products[:, :count, :count].sum(axis=0), products[:, count:, count:]
            shared, pull = products[:, :count, count:], pulls[:, :count].sum(axis=0)
        some = 1e-9 * np.einsum("sii->s", of_first)[:, None, None] + 1e-300  # where friction holds, a speed is not seen
        more = of_first * (1 + damped * np.eye(free)) + some * np.eye(free)
        solved = np.linalg.solve(more, np.concatenate([shared.transpose(0, 2, 1), pulls[:, count:, None]], axis=2))
        normal = own - np.einsum("sij,sjk->ik", shared, solved[:, :, :-1])
        right = pull - np.einsum("sij,sj->i", shared, solved[:, :, -1])
        diagonal = np.diag(own) * damped + 1e-12 * own.max() + 1e-300
        stays = np.array([name in NOT_NEGATIVE and at[name] <= 0 and p < 0 for name, p in zip(at, right, strict=True)])
        matrix = np.where(stays[:, None] | stays, np.eye(count) * own.max(), normal + np.diag(diagonal))
        by = np.linalg.solve(matrix, np.where(stays, 0.0, right))
        change = {name: float(each) * steps_of[name] for name, each in zip(at, by, strict=True)}
        short = min([1.0, *(_limit(name, T) / abs(each) for name, each in change.items() if each)])
        trial = moved(at, {name: short * each for name, each in change.items()})
        trial |= {name: max(trial[name], 0.0) for name in NOT_NEGATIVE if name in trial}
        z_trial = z + (solved[:, :, -1] - short * solved[:, :, :-1] @ by).T * by_state[:, None]
        found = at_point(trial, z_trial)
        before, after = float(np.sum(left**2)), float(np.sum(found[0] ** 2))
        fresh = after < before
        damped = max(damped / 5, LEAST_DAMPED) if fresh else damped * 5
        if fresh:
            at, z, (left, slopes, steps_of), accepted = trial, z_trial, found, accepted + 1
        if (fresh and before - after < enough * before) or damped > MOST_DAMPED or accepted == steps:
            break
    table = slopes.transpose(3, 0, 1, 2).reshape(slopes.shape[3], -1, count + free)
    base = np.linalg.qr(table[:, :, count:])[0]
    alone = table[:, :, :count] - base @ (base.transpose(0, 2, 1) @ table[:, :, :count])
    return Fit(task, at, z, left, alone, steps_of)


def _limit(name: str, T: float) -> float:
    if name in SCALED:
        return LONGEST_STEP
    return LONGEST_DELAY * T if name.endswith("delay") else np.inf


def whitened(fit: Fit) -> Fit:
    """Return the fit after a filter that makes its residual white.

    A taper shows the whole range of a link's noise, which drifts. The residual of a mechanism is an error of its model:
    without a taper, leakage keeps the weights of the frequencies within bounds.
    """
    from scipy.linalg import solve_toeplitz

    left = fit.left * (np.hanning(fit.task.rows)[:, None, None] if fit.task.drive.servo else 1.0)
    size, rows = left / np.sqrt(np.mean(left**2)), len(left)
    lags = np.array([float(np.mean(size[k:] * size[: rows - k])) for k in range(ORDER + 1)])
    lags[0] *= 1 + 1e-6
    filtered = (1.0, *(-solve_toeplitz(lags[:-1], lags[1:])))
    return fitted(replace(fit.task, white=tuple(map(float, filtered))), fit.numbers, fit.first, TRIED)
