"""Search the device that a log shows: starts, and the parts that lower the residual (README, section 3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, pi

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.schema.rules import FASTEST, MAX_DELAY_SAMPLES
from vctune.identification.box import DELAY_FLOOR
from vctune.identification.checks import position_noise
from vctune.identification.fit import ENOUGH, SEGMENTS, STEPS, TRIED, Fit, Task, fitted, noise_is_all, whitened
from vctune.identification.remainder import root_mean_square_speed, share_left
from vctune.identification.stepped import Drive

# Length of a segment in the search for the parts, and in the last fit: in seconds, and at most as a share of the log
SHORT, LONG = (0.08, 1 / 40), (0.25, 1 / 16)
LEAST_ROWS, SEARCHED, FITTED = 40, 60, 300  # Least rows of a segment, and most segments in the search and at last
LONGEST = 300_000  # Rows of a log that are used
SMOOTHINGS = (4, 8, 16, 32, 64)  # Deviations of the Gaussians of the first regressions, rows
DELAYS = np.concatenate([np.arange(0.0, 12.0, 0.5), np.arange(12.0, 100.0, 4.0)])  # That the regressions try, rows
LATE = np.arange(100.0, MAX_DELAY_SAMPLES, 8.0)  # More of them for a servo
# Share of the greatest speed below which friction is not Coulomb's; least segments above it, and their least share of
# the log, with which they are the log
SLOW, LEAST_MOVING, MOVING = 0.05, 16, 0.25
FRICTIONS = (1e-3, 0.1, 0.02)  # Coulomb friction of the first starts at least, as a share of the greatest command
STRIBECK = (0.02, 0.06, 0.2)  # First speeds of Stribeck's curve, as shares of the root mean square of the speed
RUBS = 5e-3  # Share of the greatest force below which a first friction is none
GLANCED = 3  # Gauss-Newton steps from each start of a part on trial
CLEAR_GAIN = 15.0  # Least gain of a part that stays
SIGNIFICANT = 4.0  # Deviations from which a lag and a second mass are there
# Of a second mass: greatest resonance, as a share of the sampling rate, and range of its damping ratio
FASTEST_SPRING, LEAST_DAMPING_RATIO, MAX_DAMPING_RATIO = 0.2, 1e-3, 0.5
SHORTEST_LAG = 1 / (2 * pi * FASTEST)  # In rows; a problem file states no shorter one
LEAST_HANDLE = 0.03  # Least mass of a handle, as a share of the device's
WHITE = 1.2  # Size of a residual, in deviations of the noise, above which its spectrum counts
HOPELESS = 3.0  # The same, above which longer segments will not do with less
ALIKE = 0.02  # Relative difference of the costs of fits that are the same device


@dataclass(frozen=True, slots=True)
class Start:
    """A regression of the smoothed columns."""

    share: float  # of the force that it leaves
    numbers: dict[str, float]


def task_of(recording: Recording, T: float, fixed: Mapping[str, float]) -> Task:
    """Return a log in the long segments of the last fit."""
    has = {role: replace(each, values=each.values[:LONGEST]) for role, each in recording.channels.items()}
    states = {"position": 0} if "position" in has else {"velocity": 1}
    states |= {"handle": 2} if "handle" in has else {}
    unit, read = np.array([position_noise(has[role]) for role in states]), [has[role].values for role in states]
    if {"handle", "position"} <= set(has):  # a spring is relaxed in the mean
        read[1] = read[1] - float(np.mean(read[1] - read[0]))
    pushed, hand = has.get("command", has.get("force")), has.get("hand")
    drive = Drive(
        T, np.zeros(len(read[0])) if pushed is None else pushed.values, None if hand is None else hand.values,
        ramp="command" not in has, reads=tuple(states.values()),
    )  # fmt: skip
    task = Task(drive, np.stack(read, 1) / unit, unit, np.arange(1), 1, fixed)
    return in_segments(task, LONG, FITTED)


def in_segments(task: Task, length: tuple[float, float], most: int, first: int = 0) -> Task:
    """Return a task in segments of another length, at most so many of them, evenly over the log from a first row."""
    n, (seconds, share) = len(task.drive.input) - first, length
    rows = min(max(round(min(seconds / task.drive.T, share * n)), LEAST_ROWS), n // SEGMENTS)
    starts = first + np.arange(n // rows) * rows
    starts = starts[np.unique(np.linspace(0, starts.size - 1, most).astype(int))]
    return replace(task, starts=starts, rows=rows, white=(1.0,))


def in_motion(task: Task, length: tuple[float, float], most: int) -> Task | None:
    """Return a task in segments in which the speed keeps its sign and is not small, where friction is what it is near
    rest in no model; None if they are few, or a small part of the log."""
    from scipy.ndimage import gaussian_filter1d

    if task.drive.reads[0] != 0:
        return None
    whole = in_segments(task, length, most)
    rows, place = whole.rows, task.read[:, 0] * task.unit[0]
    speed = np.abs(gaussian_filter1d(place, max(2.0, rows / 16), order=1))
    moves = np.concatenate([[False], speed > SLOW * np.quantile(speed, 0.99), [False]])
    starts = list[int]()
    for begins, ends in np.flatnonzero(np.diff(moves)).reshape(-1, 2):
        count = (ends - begins) // rows
        starts += range(begins + (ends - begins - count * rows) // 2, ends - rows + 1, rows)[:count]
    if len(starts) < LEAST_MOVING or len(starts) * rows < MOVING * len(place):
        return None
    kept = np.unique(np.linspace(0, len(starts) - 1, most).astype(int))
    return replace(whole, starts=np.array(starts)[kept])


def regression(task: Task, smoothing: int) -> Start:
    """Return mass, friction, spring and delay that explain the force best after a Gaussian low-pass of rows.

    Of a servo, the mass is lag over gain and the damping is 1 over gain.
    """
    from scipy.ndimage import gaussian_filter1d

    T, drive, n = task.drive.T, task.drive, len(task.drive.input)
    speed_read = drive.reads[0] == 1
    y = task.read[:, 0] * task.unit[0]

    def smooth(values: Floats, order: int = 0, by: float = smoothing) -> Floats:
        return np.asarray(gaussian_filter1d(values, by, order=order, mode="nearest") / T**order)

    ways = np.sign(smooth(y, 0 if speed_read else 1, max(2.0, smoothing / 3)))
    columns = {"mass": smooth(y, 1 if speed_read else 2), "damping": smooth(y, 0 if speed_read else 1)}
    if not drive.servo:
        columns |= {"coulomb": smooth(ways), "offset": np.ones(n)}
    if not drive.servo and not speed_read:
        columns["stiffness"] = smooth(y)
    cut = slice(4 * smoothing + 8, n - 4 * smoothing - 8, max(1, smoothing // 2))
    table = np.stack(list(columns.values()), 1)[cut]
    size = np.linalg.norm(table, axis=0) + 1e-300
    base, triangle = np.linalg.qr(table / size)
    rows, pushed = np.arange(n), smooth(drive.input)
    hand = 0.0 if drive.hand is None else smooth(drive.hand)[cut]
    free = "delay" not in task.fixed
    found = list[tuple[float, float, Floats]]()
    delays = np.append(DELAYS, LATE) if drive.servo else DELAYS
    for delay in T * delays if free else [task.fixed["delay"]]:
        force = np.interp(rows - delay / T - 0.5 * (not drive.ramp), rows, pushed)[cut] + hand
        along = base.T @ force
        left = float(np.linalg.norm(force - base @ along) / (np.linalg.norm(force) + 1e-300))
        found.append((left, float(delay), np.linalg.solve(triangle, along) / size))
    share, delay, values = min(found, key=lambda each: each[0])
    numbers = dict(zip(columns, map(float, values), strict=True)) | ({"delay": delay} if free else {})
    return Start(share, numbers)


def starts_of(task: Task) -> list[Start]:
    """Return the regressions at several smoothings, the best first."""
    n = len(task.drive.input)
    found = [regression(task, each) for each in SMOOTHINGS if 16 * each + 32 < n]
    return sorted(found, key=lambda each: each.share)


def begun(task: Task, start: Start, friction: float) -> dict[str, float]:
    """Return the numbers from which a search starts; `friction` is a share of the greatest force."""
    numbers = dict(start.numbers)
    numbers |= {"mass": abs(numbers["mass"]), "damping": max(numbers["damping"], 0.0)}
    numbers["coulomb"] = max(numbers["coulomb"], friction * task.drive.greatest)
    if numbers["coulomb"] < RUBS * task.drive.greatest:
        numbers.pop("coulomb")
    if task.drive.hand is not None and "sensor_delay" not in task.fixed:
        numbers["sensor_delay"] = 0.0
    return numbers


def parts_on_trial(fit: Fit, rotary: bool) -> Iterator[list[dict[str, float]]]:
    """Yield the parts that a device may have more than a fit has, each as starts, the cheapest first."""
    numbers, task = fit.numbers, fit.task
    T, push = task.drive.T, task.drive.greatest
    if "damping_back" not in numbers and not noise_is_all(fit, 1.0):
        yield [numbers | {"damping_back": numbers["damping"]}]
    if "lag" not in fit.known and not task.drive.ramp and "delay" in numbers:
        lags = [max(share * numbers["delay"], T / 4) for share in (0.2, 0.5, 0.8)]
        yield [numbers | {"lag": lag, "delay": numbers["delay"] - lag} for lag in lags]
    if "coulomb" not in numbers:
        yield [numbers | {"coulomb": share * push} for share in (0.02, 0.1)]
    if "coulomb" in numbers and "stiction" not in numbers and not noise_is_all(fit, 1.0):
        speed = root_mean_square_speed(fit)
        yield [numbers | {"stiction": 0.2 * numbers["coulomb"], "stribeck": share * speed} for share in STRIBECK]
    if rotary and "stiffness" in numbers:
        others = {name: value for name, value in numbers.items() if name != "stiffness"}
        yield [others | {"sine": numbers["stiffness"], "cosine": 0.0}]
    if "handle_mass" not in numbers and not noise_is_all(fit, 1.0):
        spring = {"handle_mass": 0.3 * numbers["mass"], "damping_ratio": 0.03}
        yield [numbers | spring | {"frequency_hz": hertz} for hertz in resonances(fit)]


def resonances(fit: Fit) -> list[float]:
    """Return frequencies at which a second mass may resonate, Hz: where the residual is greatest, and some others."""
    T, rows = fit.task.drive.T, fit.task.rows
    beyond = np.diff(fit.left[:, 0], 2, axis=0)
    hertz = np.fft.rfftfreq(len(beyond), T)
    power = np.mean(np.abs(np.fft.rfft(beyond * np.hanning(len(beyond))[:, None], axis=0)) ** 2, axis=1)
    inside = (hertz > 2 / (rows * T)) & (hertz < FASTEST_SPRING / T)
    others = np.geomspace(5.0, FASTEST_SPRING / T, 6)[1:-1]
    return [*map(float, hertz[inside][np.argmax(power[inside], keepdims=True)]), *map(float, others)]


def gain(before: Fit, after: Fit) -> float:
    """Return by how much a fit is likelier than one with fewer numbers, beyond what the numbers cost."""
    size, more = before.residual.size, max(len(after.numbers) - len(before.numbers), 1)
    likelier = min(size * log(before.cost / after.cost), (before.cost - after.cost) / max(after.size, 1.0) ** 2)
    return likelier / max(1.0, after.inflation()) - more * log(size)


def with_parts(fit: Fit, rotary: bool) -> Fit:
    """Return the fit with all parts that lower its residual by more than their share, the simplest first."""
    while True:
        for starts in parts_on_trial(fit, rotary):
            one = tried(fit, starts)
            if one is not None and possible(one) and decisive(fit, one) and gain(fit, one) > 0:
                fit = fitted(one.task, one.numbers, one.first, TRIED)
                break
        else:
            return fit


def possible(fit: Fit) -> bool:
    """Return whether friction is less than what drives, and a second mass one that resonates within the band."""
    numbers = fit.numbers
    if (
        numbers.get("coulomb", 0.0) > fit.task.drive.greatest
        or numbers.get("lag", 1.0) < SHORTEST_LAG * fit.task.drive.T
        or ("lag" in numbers and numbers.get("delay", 0.0) < -DELAY_FLOOR * fit.task.drive.T)
    ):
        return False
    if "frequency_hz" not in numbers:
        return True
    inside = 1 / (fit.task.rows * fit.task.drive.T) < numbers["frequency_hz"] < 0.45 / fit.task.drive.T
    heavy = LEAST_HANDLE * numbers["mass"] < numbers["handle_mass"] < numbers["mass"]
    return inside and heavy and LEAST_DAMPING_RATIO < numbers["damping_ratio"] < MAX_DAMPING_RATIO


def decisive(before: Fit, after: Fit) -> bool:
    """Return whether a second mass or a lag, which can stand for one another, halves what is left beyond the noise."""
    more = set(after.numbers) - set(before.numbers)
    return not more & {"handle_mass", "lag"} or after.size**2 - 1 < 0.5 * max(before.size**2 - 1, 0.0)


def tried(fit: Fit, starts: Sequence[dict[str, float]]) -> Fit | None:
    """Return the best of the fits from the three starts that are the best after a few steps; None if all run away."""
    task, first, found = fit.task, fit.first, list[Fit]()
    if "handle_mass" in starts[0] and "handle_mass" not in fit.numbers:
        first = np.concatenate([first, first[-2:] if len(first) > 1 else np.concatenate([0 * first, first])])
    with np.errstate(all="ignore"):
        for start in starts:
            try:
                found.append(fitted(task, start, first, GLANCED))
            except (np.linalg.LinAlgError, ValueError):
                continue
        found = [each for each in found if np.isfinite(each.cost)]
        best = sorted(found, key=lambda each: each.cost)[:3]
        ended = (fitted(task, each.numbers, each.first, TRIED, 1e-3) for each in best)
        return min(ended, key=lambda each: each.cost, default=None)


def last(task: Task, best: Fit, moving: bool) -> tuple[Fit, float]:
    """Return the fit over the whole log, or its segments in motion, and the share of the motion that it leaves.

    Where more than noise is left, short segments, in which the error of a model does not grow, and weights that make
    the residual white fit the log again.
    """
    short = in_motion(task, SHORT, FITTED) if moving else in_segments(task, SHORT, FITTED)
    long = in_motion(task, LONG, FITTED) if moving else task
    assert short is not None
    if long is not None and best.size < HOPELESS and (found := fitted(long, best.numbers)).size < WHITE:
        return found, share_left(found)
    found = fitted(short, best.numbers, None, *((STEPS, ENOUGH) if best.size < HOPELESS else (TRIED, 1e-4)))
    share = share_left(found)
    return (found if found.size < WHITE else whitened(whitened(found))), share


def without_idle(fit: Fit) -> Fit:
    """Return the fit without the parts that do not lower its residual by more than their share."""
    for names in (
        ("handle_mass", "frequency_hz", "damping_ratio"),
        ("lag",),
        ("sine", "cosine"),
        ("stiffness",),
        ("stiction", "stribeck"),
        ("damping_back",),
        ("coulomb",),
    ):
        if names[0] not in fit.numbers or (names[0] == "handle_mass" and 2 in fit.task.drive.reads):
            continue
        kept = {name: value for name, value in fit.numbers.items() if name not in names}
        if "lag" in names:
            kept["delay"] += fit.numbers["lag"]
        weak = names[0] in ("handle_mass", "lag") and fit.numbers[names[0]] < SIGNIFICANT * fit.sigmas()[names[0]]
        less = fitted(fit.task, kept, None if "handle_mass" in names else fit.first, TRIED)
        cured = possible(less) and not possible(fit)
        if weak or cured or gain(less, fit) < CLEAR_GAIN or not decisive(less, fit):
            fit = less
    return fit


def alike(one: Fit, other: Fit) -> bool:
    """Return whether two fits are the same device, within the least widths of a box and their deviations."""
    sigma = one.sigmas()

    def apart(*names: str) -> float:
        return abs(sum(one.numbers.get(name, 0.0) - other.numbers.get(name, 0.0) for name in names))

    near = apart("delay", "lag") < DELAY_FLOOR * one.task.drive.T + 3 * sigma.get("delay", 0.0)
    shares = {"mass": 0.01, "damping": 0.05}
    return near and all(apart(name) < share * one.numbers[name] + 3 * sigma[name] for name, share in shares.items())


@dataclass(frozen=True, slots=True)
class Found:
    """What a search has found."""

    fit: Fit
    others: list[dict[str, float]]  # the numbers with other weights, and beside a lag that is not decisive
    share: float  # of the motion that the fit leaves
    moving: bool  # whether it fits segments in motion alone
    agree: bool  # whether another start ends at the same device


def mechanism_fit(task: Task, rotary: bool) -> Found:
    """Search the device that a log shows; one whose handle was read too is two masses from the start."""
    moving, starts = in_motion(task, SHORT, SEARCHED), starts_of(task)
    short = moving or in_segments(task, SHORT, SEARCHED)
    first = list[Fit]()
    for start, share in zip(starts, FRICTIONS, strict=False):
        numbers = begun(task, start, share)
        spring = {"handle_mass": 0.4 * numbers["mass"], "damping_ratio": 0.03}
        grid = np.geomspace(5.0, FASTEST_SPRING / task.drive.T, 8) if 2 in task.drive.reads else [0.0]
        tries = [numbers | (spring | {"frequency_hz": float(hertz)} if hertz else {}) for hertz in grid]
        best = min((fitted(short, each, None, GLANCED) for each in tries), key=lambda each: each.cost)
        first.append(fitted(short, best.numbers, best.first, TRIED))
    first = [each for each in first if np.isfinite(each.cost)]
    best = with_parts(min(first, key=lambda each: each.cost), rotary)
    agree = False
    for other in sorted(first, key=lambda each: each.cost)[1:]:
        from_other = best.numbers | {name: value for name, value in other.numbers.items() if name in best.numbers}
        if "lag" in best.numbers:
            from_other["delay"] -= from_other["lag"]
        again = tried(best, [from_other])
        if again is not None and again.cost < best.cost * (1 - ALIKE):
            best, agree = again, alike(best, again)
        elif again is not None and alike(best, again):
            agree = True
        if agree:
            break
    fit, share = last(task, best, moving is not None)
    fit = without_idle(fit)
    segments = in_motion(task, SHORT, FITTED) if moving else in_segments(task, SHORT, FITTED)
    others = [fitted(segments or short, fit.numbers, None, TRIED).numbers]
    for parts in parts_on_trial(fit, rotary=False):
        rival = tried(fit, parts) if "lag" in parts[0] and "lag" not in fit.numbers else None
        if rival is not None and possible(rival) and gain(fit, rival) > 0:
            others.append(rival.numbers | {"delay": rival.numbers["delay"] + rival.numbers["lag"]})
    return Found(fit, others, share, moving is not None, agree)
