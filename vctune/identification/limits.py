"""Find a limit of a robot's speed or acceleration, or of a motor's force, that no device of a fit has (README, section
8)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from math import exp, inf, pi, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.identification.fit import TRIED, Fit, Task, fitted
from vctune.identification.search import starts_of

LONGEST = 4000  # Rows that are compared
FIRST_ROWS = ((0.5, 2.0, 5.0, 10.0, 20.0, 40.0), (1.0, 4.0, 12.0))  # First delays and lags
SHARES = (0.3, 0.5, 0.8, 1.0)  # First limits of the acceleration, as shares of the greatest that the motion shows
USUAL = 0.995  # Quantile that is the greatest of a noisy motion
LOW_PASSES, QUIET = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0), 0.05  # Deviations, rows, and most noise of what they leave
DECISIVE, MORE = 0.5, 0.7  # Greatest ratio of the residuals with and without a limit, and with a second limit beside it
FORCES = (0.95, 0.85, 0.7, 0.55, 0.4, 0.3)  # First limits of a force, as shares of the greatest command
TRIES = 250  # Motions that are compared for each kind of limit


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits that explain a motion; inf for none."""

    speed: float
    acceleration: float


def moved(told: Floats, T: float, start: float, delay: float, lag: float, limits: Limits) -> Floats:
    """Return the speed at each row of a first-order servo whose speed and acceleration are limited."""
    rows = np.arange(told.size)
    wanted = np.clip(np.interp(rows - delay / T, rows, told), -limits.speed, limits.speed)
    share, most = 1 - exp(-T / lag), limits.acceleration * T
    speed, out = start, np.empty_like(wanted)
    for row, goal in enumerate(wanted.tolist()):
        out[row] = speed
        change = share * (goal - speed)
        speed += most if change > most else -most if change < -most else change
    return out


def limits_of(fit: Fit) -> Limits | None:
    """Return the limits without which a servo leaves at least twice as much of the speed; None if there are none."""
    from scipy.optimize import minimize

    drive, read = fit.task.drive, fit.task.read[:LONGEST, 0]
    T, told, noise, order = drive.T, drive.input[:LONGEST], float(fit.task.unit[0]), 1 - drive.reads[0]
    measured, kept_rows = _low_passed(read * noise, noise, order)
    measured /= T**order
    floor = noise**2 / (2 * sqrt(pi) * kept_rows) / (2 * (kept_rows * T) ** 2) ** order  # variance that noise leaves
    speed = float(np.quantile(np.abs(measured), USUAL))
    slopes, rows = _low_passed(read * noise, noise, order + 1)
    acceleration = float(np.quantile(np.abs(slopes), USUAL)) / T ** (order + 1)
    kept = slice(int(8 * rows), -int(8 * rows))

    def left(logarithms: Floats, names: tuple[str, ...]) -> float:
        """Return what a servo with the limits of some names leaves of the speed, its gain aside."""
        delay, lag, *others = map(exp, np.clip(logarithms, -30.0, 30.0))
        limits = Limits(**{"speed": inf, "acceleration": inf} | dict(zip(names, others, strict=True)))
        made, shown = moved(told, T, float(measured[0]), delay, lag, limits)[kept], measured[kept]
        gain = 1.0 if names else float(made @ shown) / (float(made @ made) + 1e-300)
        return float(np.sqrt(np.mean((shown - gain * made) ** 2)))

    def best(names: tuple[str, ...]) -> tuple[float, Limits]:
        tried = {"speed": [speed], "acceleration": [share * acceleration for share in SHARES]}
        grid = product(*([rows * T for rows in each] for each in FIRST_ROWS), *(tried[name] for name in names))
        start = min((np.log(each) for each in grid), key=lambda each: left(each, names))
        simplex = np.vstack([start, start + 0.2 * np.eye(start.size)])
        options = {"initial_simplex": simplex, "maxfev": TRIES}
        found = minimize(left, start, (names,), "Nelder-Mead", options=options)
        values = dict(zip(names, map(exp, found.x[2:]), strict=True))
        return float(found.fun), Limits(values.get("speed", inf), values.get("acceleration", inf))

    def least(*kinds: tuple[str, ...]) -> tuple[float, Limits]:
        return min((best(names) for names in kinds), key=lambda each: each[0])

    without, one, both = least(()), least(("speed",), ("acceleration",)), least(("speed", "acceleration"))
    size, limits = both if both[0] < MORE * one[0] else one
    return limits if size**2 - floor < DECISIVE**2 * max(without[0] ** 2 - floor, 0.0) else None


def _low_passed(values: Floats, noise: float, order: int) -> tuple[Floats, float]:
    """Return a column's derivative by rows after the least low-pass that leaves little noise, and its deviation."""
    from scipy.ndimage import gaussian_filter1d

    for rows in LOW_PASSES:
        found = np.asarray(gaussian_filter1d(values, rows, order=order))
        if noise / rows ** (order + 0.5) < QUIET * float(np.quantile(np.abs(found), USUAL)):
            break
    return found, rows


def force_limit_of(fit: Fit) -> float | None:
    """Return the limit of the motor's force without which a mechanism leaves at least twice as much of the motion, or
    of the force that a regression finds; None if there is none."""
    drive, peak = fit.task.drive, float(np.abs(fit.task.drive.input).max())

    def at(limit: float) -> Task:
        return replace(fit.task, drive=replace(drive, input=np.clip(drive.input, -limit, limit)), white=(1.0,))

    def left(limit: float) -> tuple[float, float]:
        task = at(limit)
        return fitted(task, fit.numbers, fit.first, TRIED, 1e-3).size, starts_of(task)[0].share

    *found, (size, share) = [left(each * peak) for each in (*FORCES, 1.0)]
    best = [min((each[way] / without, i) for i, each in enumerate(found)) for way, without in ((0, size), (1, share))]
    ratio, place = min(best)
    return FORCES[place] * peak if ratio < DECISIVE else None
