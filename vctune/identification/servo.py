"""Study the log of a vendor's servo: both orders of its low-pass, and the servos that the log does not reject (README,
section 8)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import ceil, exp, inf, isfinite, log, pi, sqrt

import numpy as np

from vctune.document.recording import SERVO_COMMANDS, Floats, Recording
from vctune.document.records.identification_json import Estimate, NumberRecord
from vctune.document.text.errors import Note, coded
from vctune.identification.box import joint_factor, unexplained
from vctune.identification.checks import position_noise, quantum_of
from vctune.identification.fit import TRIED, Fit, Task, fitted, whitened
from vctune.identification.limits import limits_of
from vctune.identification.remainder import halves, motion_of, share_left, spectrum
from vctune.identification.search import FITTED, WHITE, in_segments, starts_of
from vctune.identification.stepped import LAGS, SHORTEST, Complex, Drive, Numbers, response
from vctune.identification.study import SERVO_KEYS, Lines, Study, number, of_orders, record_of

SEGMENT = (inf, 1 / 16)  # Of the log: a slow motion shows its latency over seconds
LAG_SHARES = (0.1, 0.4, 0.8)  # Of the latency that are the lag in the first starts
SETTLING_LAGS = 6.0  # Time after which motion before the log has no effect, in lags of the servo
LONGEST_LAG = 800.0  # In rows
DECISIVE_GAIN = 10.0  # Gain in -2 log likelihood, for independent residuals, that decides between the orders
ROUNDED = 3.0  # Deviations of a residual's size that rounding may have
AGREE = 0.3  # Difference of the latencies of one servo, in rows
AHEAD = 0.25  # Greatest time by which a motion may seem to precede its command, in rows
MAX_SHARE, GAIN_RANGE = 0.5, (0.8, 1.25)  # Of the motion that is left, and of motion over command; else refused
SWAPPED = 0.1  # Share of the motion that is left, below which two columns that are taken for each other are swapped
SIGNIFICANT, LEAST_YIELDING = 4.0, 0.005  # Deviations, and share of the motion, with which a servo yields
CORNERS, STEEPNESSES = 60, (4, 8, 16, 32)  # Of the low-passes that remove rounding
AT_ENDS = 40  # Rows that tell the slope of a rounded column at its ends
CRAWL = 2.5  # Steps of a rounded column that moves slowly, in quanta
TOLD = 2.0  # Ratio of the ends of a lag's interval, above which halves of a log tell nothing of it
WINDOWS = 10  # Least number of windows that show a jitter
BEYOND = 40  # Frequencies at which the disc covers the other order
LATENCY = coded("a delay and a lag are alike in this motion", "limit-latency")
JITTER = coded("jitter", "limit-jitter")


@dataclass(frozen=True, slots=True)
class ServoFit:
    """The servo of one order that is nearest to a log, and those that the log does not reject."""

    fit: Fit
    ends: list[dict[str, float]]  # of the servos that the log does not reject
    most: float  # cost below which it rejects none
    share: float  # of the motion that is left
    latest: float  # latency that the motion permits at most, s

    @property
    def numbers(self) -> dict[str, float]:
        """Gain, delay and lag; no delay is negative."""
        return self.fit.known

    @property
    def order(self) -> int:
        """The order of the low-pass."""
        return self.fit.task.drive.servo

    @property
    def likelihood(self) -> float:
        """-2 log likelihood, for independent residuals."""
        return self.fit.residual.size * log(self.fit.cost)

    def hertz(self, lag: float) -> float:
        """Return the bandwidth of a lag."""
        return LAGS[self.order] / (2 * pi * lag)

    def response(self, hertz: Floats) -> Complex:
        """Return the sampled response of the fitted servo, its gain aside."""
        return response(self.fit.task.drive, self.numbers | {"gain": 1.0}, hertz)


def smoothed(values: Floats, quantum: float) -> Floats:
    """Return a column without what its rounding adds, which would pass for a slow servo.

    Of some low-passes of its cosine transform, the one with the least expected error if rounding is white (Stein's
    unbiased estimate).
    """
    from scipy.fft import dct, idct
    from scipy.interpolate import CubicHermiteSpline

    row, near = np.arange(values.size), np.arange(AT_ENDS)
    slopes = [np.polyfit(near, each, 2)[1] for each in (values[:AT_ENDS], -values[: -AT_ENDS - 1 : -1])]
    cubic = CubicHermiteSpline(row[[0, -1]], values[[0, -1]], slopes)(row)  # a cosine transform has level ends
    parts, share = dct(values - cubic, norm="ortho"), row / values.size

    def keeps(corner: float, steepness: int) -> Floats:
        return np.asarray(1 / (1 + (share / corner) ** steepness))

    def error(low_pass: tuple[float, int]) -> float:
        kept = keeps(*low_pass)
        return float(np.sum(((1 - kept) * parts) ** 2) + quantum**2 / 6 * np.sum(kept))

    corners = np.geomspace(1 / values.size, 10.0, CORNERS)
    return np.asarray(cubic + idct(keeps(*min(product(corners, STEEPNESSES), key=error)) * parts, norm="ortho"))


def servo_fits(task: Task, crawls: bool) -> tuple[list[ServoFit], bool]:
    """Return the fits of both orders, the likelier first, and whether two starts end at the same servo."""
    T, n, start = task.drive.T, len(task.drive.input), starts_of(task)[0].numbers
    slow = start["damping"] or 1.0
    latency, gain = start["delay"] + T + max(start["mass"] / slow, 0.0), 1 / slow
    best, agree = list[Fit](), False
    for order in (1, 2):
        one, found = replace(task, drive=replace(task.drive, servo=order)), list[Fit]()
        for share in LAG_SHARES:
            numbers = {"gain": gain, "delay": (1 - share) * latency, "lag": share * latency}
            found.append(fitted(in_segments(one, SEGMENT, FITTED, _settled(numbers, T, n)), numbers))
        first, *others = sorted(found, key=lambda each: each.size)
        agree |= any(abs(_latency(each.numbers) - _latency(first.numbers)) < AGREE * T for each in others)
        best.append(first)
    settled = max(_settled(each.numbers, T, n) for each in best)
    best = [fitted(in_segments(each.task, SEGMENT, FITTED, settled), each.numbers) for each in best]
    shares = [share_left(each) for each in best]
    if max(each.size for each in best) > WHITE:
        best = [whitened(whitened(each)) for each in best]
    fits = [_bounded(each, share, crawls) for each, share in zip(best, shares, strict=True)]
    return sorted(fits, key=lambda each: each.likelihood), agree


def _latency(numbers: Numbers) -> float:
    return numbers["delay"] + numbers["lag"]


def _settled(numbers: Numbers, T: float, rows: int) -> int:
    """Return the first row that no motion before the log moves."""
    late = max(numbers["delay"], 0.0) + SETTLING_LAGS * numbers["lag"]
    return min(ceil(late / T) + 2, rows // 4)


def _bounded(fit: Fit, share: float, crawls: bool) -> ServoFit:
    """Return the fit with a delay that is not negative, and the ends of the lags that the log does not reject.

    Rounding of a column that crawls is no noise: the log then rejects no servo that leaves as little as rounding does.
    """
    by = {"delay": 1.0, "lag": fit.numbers["lag"]}
    steps = np.array([fit.steps[name] * by.get(name, 0.0) for name in fit.numbers])
    unsure = max(fit.size, 1.0) * sqrt(fit.inflation() * float(steps @ fit.inverse @ steps))
    latency = _latency(fit.numbers)
    latest = latency + joint_factor(2) * unsure
    if fit.numbers["delay"] < 0:
        numbers = {"gain": fit.numbers["gain"], "lag": max(latency, fit.task.drive.T)}
        fit = fitted(replace(fit.task, fixed={"delay": 0.0}), numbers, fit.first)
    most = fit.cost + (joint_factor(2) * max(fit.size, 1.0)) ** 2 * fit.inflation()
    if crawls:
        most = max(most, fit.residual.size * (1 + ROUNDED / sqrt(2 * fit.residual.size)) ** 2)
    step = min(max(fit.sigmas()["lag"] / fit.numbers["lag"], 0.02), 0.7)
    return ServoFit(fit, [_end(fit, most, side * step) for side in (-1, 1)], most, share, latest)


def _at_lag(fit: Fit, lag: float) -> Fit:
    """Return the best servo with another lag."""
    start = {"gain": fit.numbers["gain"], "delay": _latency(fit.known) - lag}
    found = fitted(replace(fit.task, fixed={"lag": lag}), start, fit.first, TRIED, 1e-4)
    if found.numbers["delay"] >= 0:
        return found
    fixed = {"lag": lag, "delay": 0.0}
    return fitted(replace(fit.task, fixed=fixed), {"gain": start["gain"]}, fit.first, TRIED, 1e-4)


def _end(fit: Fit, most: float, step: float) -> dict[str, float]:
    """Return the servo at an end of the lags, where the cost is `most`; the sign of the first step says which end."""
    from scipy.optimize import brentq

    inside, end = log(fit.numbers["lag"]), log((SHORTEST if step < 0 else LONGEST_LAG) * fit.task.drive.T)
    while True:
        further = inside + step if (inside + step - end) * step < 0 else end
        found = _at_lag(fit, exp(further))
        if found.cost > most:
            break
        if further == end:
            return found.known
        inside, step = further, 2 * step

    def beyond(logarithm: float) -> float:
        return _at_lag(fit, exp(logarithm)).cost - most if logarithm != inside else -most

    at = brentq(beyond, inside, further, xtol=0.05 * abs(further - inside))
    return _at_lag(fit, exp(float(at))).known


def _jitter(fit: Fit, interpolated: bool) -> float:
    """Return the standard deviation of a link's delay, s, from the motion that windows of rows leave unexplained."""
    task, T = fit.task, fit.task.drive.T
    window = max(ceil(2 * fit.numbers["lag"] / T) + 2, 4)
    rows = (task.rows - 1) // window * window
    if task.drive.reads != (0,) or rows * task.starts.size < WINDOWS * window:
        return 0.0
    moves, noise = fit.left[: rows + 1, 0] * task.unit[0], task.unit[0] ** 2
    speed = task.drive.input[task.starts + np.arange(rows + 1)[:, None]]
    # a late position command shifts the motion once, by its speed; a velocity command for good, by its jump
    by = speed[1:] if interpolated else np.diff(speed, axis=0)
    change = moves[1:] - moves.mean(axis=0) if interpolated else np.diff(moves, axis=0)
    beyond = change.reshape(-1, window, change.shape[1]).sum(axis=1) ** 2
    beyond -= noise * (window if interpolated else 2)
    total, unsure = float(beyond.sum()), float(np.sqrt(np.sum((beyond - beyond.mean()) ** 2)))
    return sqrt(total / float(np.sum(by**2))) if total > 3 * unsure > 0 else 0.0


def servo_task(recording: Recording, T: float, command: str, read: str) -> tuple[Task, dict[str, float]]:
    """Return a log as one segment, its command without its rounding, and the quanta of the positions that crawl."""
    has, crawling = recording.channels, dict[str, float]()
    told = has[command].values
    for role in (command, read):
        quantum, moves = quantum_of(has[role]), np.abs(np.diff(has[role].values))
        if quantum is not None and "position" in role and float(np.median(moves[moves > 0])) < CRAWL * quantum:
            crawling[role] = quantum
        if quantum is not None and role == command:
            told = smoothed(told, quantum)
    if command == "position_command":  # which the servo interpolates over the next row
        told = np.diff(told, prepend=told[0]) / T
    y = has[read].values
    unit = max(position_noise(has[read]), 1e-9 * float(np.ptp(y)))
    drive = Drive(T, told, None, False, 1, (0 if read == "position" else 1,))
    return Task(drive, y[:, None] / unit, np.array([unit]), np.arange(1), 1), crawling


def servo_study(recording: Recording, T: float) -> Study:
    """Fit both orders of a servo to a recording and decide between them."""
    name, channels = recording.name, recording.channels
    command = next(role for role in SERVO_COMMANDS if role in channels)
    read = "position" if "position" in channels else "velocity"
    header, place = channels[command].header, channels[read].header
    task, crawling = servo_task(recording, T, command, read)
    crawls = bool(crawling)
    try:
        with np.errstate(all="ignore"):
            (fit, other), agree = servo_fits(task, crawls)
    except (ValueError, np.linalg.LinAlgError):  # no part of the motion fits the command
        question = f"is {header} the command of another axis or of another time than {place}?"
        raise unexplained(recording, f"the motion does not follow the command anywhere: {question}", header) from None
    _refuse_limited(recording, fit, header, place, told_position=command == "position_command")
    _refuse(recording, fit, agree, header, place, turned=fit.share > MAX_SHARE and _turned(recording, T, command, read))
    if command in crawling and fit.fit.size > WHITE:
        quantum = f"is rounded to {crawling[command]:.2g} {recording.units.position}"
        message = f"{quantum}, of which it moves few in a row, and this hides the servo: log it finer, or move faster"
        raise unexplained(recording, message, header)
    gap = DECISIVE_GAIN * max(each.fit.inflation() for each in (fit, other))
    order_is_known = other.likelihood - fit.likelihood > gap and not (crawls and other.fit.cost < fit.most)
    fits, numbers, sigma = [fit] if order_is_known else [fit, other], fit.numbers, fit.fit.sigmas()
    jitter = _jitter(fit.fit, interpolated=command == "position_command")
    latency, gain, unit = _latency(numbers), numbers["gain"], fit.fit.task.unit[0]
    said = [
        number("delay", numbers["delay"], sigma.get("delay", 0.0)),
        number("bandwidth, Hz", fit.hertz(numbers["lag"]), fit.hertz(numbers["lag"]) * sigma["lag"] / numbers["lag"]),
        number("motion over command", gain, sigma["gain"]),
        number("jitter of the delay", jitter),
        number("noise of a reading", unit),
    ]
    candidates, remarks = of_orders(
        name, [(one.order, one.fit.cost, one.share) for one in (fit, other)], known=order_is_known
    )
    if jitter > 0.01 * T:
        text = f"{name}: the delay jitters by {jitter:.2g} s from command to command, which its interval includes; "
        remarks.append(Note("remark-jitter", f"{text}proofs assume a constant delay"))
    if min(each.ends[0]["lag"] for each in fits) < 1.01 * SHORTEST * T:
        text = f"{name}: shows a latency of {latency:.3g} s, and not how much of it is a low-pass: record a sweep "
        remarks.append(Note("remark-latency-only", f"{text}up to a tenth of the sampling rate or higher"))
    if abs(gain - 1) > max(SIGNIFICANT * sigma["gain"], 2e-3):
        text = f"{name}: moves {gain:.4g} times as far as it is told, which a servo does not: unmodelled covers it"
        remarks.append(Note("warn-gain", text))
    force = recording.values("hand" if "hand" in channels else "force")
    if force is not None and np.ptp(force) > 0:
        yields, compliances = _yielding(recording, fit, force)
        said, remarks = [*said, *compliances], [*remarks, *yields]
    curves = motion_of(fit.fit)
    record = record_of(
        recording, T, kind=f"a servo told its {command.partition('_')[0]}, order {fit.order}", used=curves.time.size,
        residual_share=fit.share, chi2=fit.fit.size**2, numbers=said,
        derived=[number("latency, hold aside", latency)], candidates=candidates,
    )  # fmt: skip
    estimates = [each for one in fits for each in _estimates(name, one, jitter)]
    hertz = np.geomspace(1e-3, 0.499, BEYOND) / T
    lines = [] if crawls else [_lines(fit)]
    if not order_is_known:  # the disc must cover both
        made = fit.response(hertz)
        lines += [Lines(hertz, one.response(hertz), np.zeros(BEYOND), made, fit.fit.task.drive) for one in fits]
    orders = {one.order: one.likelihood / max(1.0, gap / DECISIVE_GAIN) for one in (fit, other)}
    return Study(recording, record, estimates, lines, curves, remarks, servo_orders=orders)


def _estimates(source: str, one: ServoFit, jitter: float) -> Iterator[Estimate]:
    """Yield the delay and the bandwidth of one order, each as far as the log rejects none, or its halves differ."""
    sigma, apart, factor = one.fit.sigmas(), halves(one.fit), joint_factor(2)
    is_told = one.ends[1]["lag"] < TOLD * one.ends[0]["lag"]
    for name, key in SERVO_KEYS.items():
        *ends, value = (one.hertz(each["lag"]) if name == "lag" else each[name] for each in [*one.ends, one.numbers])
        low, high = min(*ends, value), max(*ends, value)
        scale, late = (value / one.numbers["lag"], 0.0) if name == "lag" else (1.0, jitter)
        more = max(scale * (apart.get(name, 0.0) - 2 * sigma.get(name, 0.0)), 0.0) * is_told + late
        unsure = min(scale * sigma.get(name, 0.0), min(value - low, high - value) / factor)
        beyond = value - low - factor * unsure + more, high - value - factor * unsure + more
        reason = JITTER if late > 0.5 * max(beyond) else LATENCY
        yield Estimate(key, value, unsure, f"{source}: order {one.order}", beyond, reason)


def _refuse_limited(recording: Recording, fit: ServoFit, header: str, place: str, *, told_position: bool) -> None:
    """Refuse a recording whose motion stays at a limit of speed or acceleration that its command exceeds."""
    if fit.fit.size < WHITE:
        return
    with np.errstate(all="ignore"):
        limits = limits_of(fit.fit, told_position=told_position)
    if limits is None:
        return
    units = recording.units
    values = (("speed", limits.speed, units.speed), ("acceleration", limits.acceleration, units.acceleration))
    texts = [f"{name}, at about {value:.2g} {unit}" for name, value, unit in values if isfinite(value)]
    message = (
        f"the robot saturates in {' and in '.join(texts)}: {place} stays at this limit where {header} asks for more, "
        "and such a log tells no delay and no bandwidth: record smaller or slower motions, below the limit"
    )
    raise unexplained(recording, message, header)


def _turned(recording: Recording, T: float, command: str, read: str) -> bool:
    """Return whether the command follows the motion as a servo does, if the two columns are taken for each other."""
    has = recording.channels
    turned = replace(recording, channels={**has, command: has[read], read: has[command]})
    try:
        with np.errstate(all="ignore"):
            (fit, _), _ = servo_fits(servo_task(turned, T, command, read)[0], crawls=False)
    except (ValueError, np.linalg.LinAlgError):
        return False
    return fit.share < SWAPPED and GAIN_RANGE[0] < fit.numbers["gain"] < GAIN_RANGE[1]


def _refuse(recording: Recording, fit: ServoFit, agree: bool, header: str, place: str, *, turned: bool) -> None:
    """Refuse a recording whose motion does not follow its command, or follows it with an impossible gain."""
    gain, latest, T = fit.numbers["gain"], fit.latest, fit.fit.task.drive.T
    if turned:
        message = f"{header} follows {place} as a motion follows its command: are the two columns swapped?"
    elif latest < -AHEAD * T:
        message = (
            f"{place} moves at least {-1e3 * latest:.3g} ms before {header} tells it to: the two were not sampled "
            "together, or the command is logged late"
        )
    elif fit.share > MAX_SHARE:
        message = (
            f"{fit.share:.0%} of the motion of {place} does not follow {header}: is it the command of another axis, or "
            "was the robot moved by something else?"
        )
    elif gain < 0:
        message = f"{place} moves against {header}; turn one sign by scale = -1"
    elif not GAIN_RANGE[0] < gain < GAIN_RANGE[1]:
        message = f"{place} moves {gain:.4g} times as far as {header} says; write the unit or scale of one of them"
    elif not agree and fit.fit.size > WHITE:
        message = f"two searches end at different servos, and {fit.share:.1%} of the motion is left: record longer"
    else:
        return
    raise unexplained(recording, message, header)


def _yielding(recording: Recording, fit: ServoFit, force: Floats) -> tuple[list[Note], list[NumberRecord]]:
    """Return a warning if a part of the motion follows the force, and compliance and mobility, fitted beside the
    rest."""
    one, units, T = fit.fit, recording.units, fit.fit.task.drive.T
    task, names = one.task, (("compliance", units.compliance), ("mobility", units.mobility))
    ways = (force, np.cumsum(force) * T) if task.drive.reads == (0,) else (np.gradient(force, T), force)
    task = replace(task, beside=dict(zip(("compliance", "mobility"), ways, strict=True)))
    yielding = fitted(task, one.numbers | {"compliance": 0.0, "mobility": 0.0}, one.first, TRIED)
    found, sigma = (np.array([each[name] for name, _ in names]) for each in (yielding.numbers, yielding.sigmas()))
    rows = task.starts + np.arange(task.rows)[:, None]
    motion = np.array([np.std(each[rows] - each[rows].mean(axis=0)) for each in ways])
    share = np.abs(found) * motion / np.std(task.measured()[:, 0] * task.unit[0])
    significant = (np.abs(found) > SIGNIFICANT * sigma) & (share > LEAST_YIELDING)
    texts = [f"{found[i]:.3g} {unit}" for i, (_, unit) in enumerate(names) if significant[i]]
    warning = (
        f"{recording.name}: the servo yields: {(share * significant).max():.1%} of its motion goes with the force, "
        f"{' and '.join(texts)}. Such a device is outside the model, in which the motion follows the command alone: no "
        "claim about the file holds for it"
    )
    records = [number(f"{names[i][0]}, {names[i][1]}", found[i], sigma[i]) for i in range(2)]
    return [Note("warn-yields", warning)] if texts else [], records


def _lines(fit: ServoFit) -> Lines:
    """Return the measured response where the log shows it."""
    hertz, ratio, spread = spectrum(fit.fit)
    made = fit.response(hertz)
    return Lines(hertz, ratio * fit.numbers["gain"] * made, spread, made, fit.fit.task.drive)
