"""Check a recording before any fit. The message on each fault names the row, the column and a remedy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.interpolate import CubicSpline

from vctune.document.recording import SERVO_COMMANDS, Channel, Floats, Recording
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError, Mistake

LEAST_SAMPLES = 500  # Least number of samples
SAMPLE_TIMES = (1e-6, 0.05)  # Range of sample times that a haptic loop can have, s
SPEEDS = {False: 30.0, True: 3000.0}  # Greatest speed of a device, m/s, or rad/s if it is rotary
GREATEST_FORCE = 1e4  # Greatest force of a haptic device, N or N m
FEW_STEPS = 30  # Least span of the motion in resolution steps
SATURATED = 0.2  # Greatest permitted share of samples at a limit


@dataclass(frozen=True, slots=True)
class Evenness:
    """Limits on the timing of a log, in sample times."""

    jitter: float  # greatest permitted standard deviation of a step
    gap: float  # length of a step above which a sample is missing


# Greatest number of samples of the loop between two rows, and greatest error of a step, in samples of the loop
MOST_SKIPPED, EXACT = 8, 0.02
# Limits for a loop that an interrupt runs, and for the communication link of a robot
LOOP, LINK = Evenness(0.05, 1.5), Evenness(0.25, 1.9)


def on_even_rows(recording: Recording) -> Recording:
    """Return a log on the rows of a faster loop if its times are exact, each step a few samples of that loop.

    A position between two rows is a cubic's, the command's and each force's is linear. Any other log stays as it is.
    """
    time = recording.channels["time"].values
    if len(recording) < LEAST_SAMPLES or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
        return recording
    steps = np.diff(time)
    base = _common_step(steps)
    if base is None or np.ptp(steps) < 0.5 * base or steps.max() > MOST_SKIPPED * base:
        return recording
    even = time[0] + base * np.arange(round(float(time[-1] - time[0]) / base) + 1)
    channels = {}
    for role, channel in recording.channels.items():
        smooth = role in ("position", "handle")
        values = CubicSpline(time, channel.values)(even) if smooth else np.interp(even, time, channel.values)
        moves = np.abs(np.diff(channel.values))  # the resolution no longer shows between the rows
        quantum = channel.quantum or (float(moves[moves > 0].min(initial=np.inf)) if smooth else None)
        channels[role] = replace(channel, values=even if role == "time" else values, quantum=quantum)
    return replace(recording, channels=channels)


def _common_step(steps: Floats) -> float | None:
    """Return the greatest time of which each step is a small whole multiple; None if there is none."""
    least = float(steps.min())
    for parts in range(1, MOST_SKIPPED + 1):
        base = least / parts
        counts = np.round(steps / base)
        base = float(steps.sum() / counts.sum())
        if np.abs(steps / base - counts).max() < EXACT:
            return base
    return None


def check(recording: Recording, sample_time: float | None, *, servo: bool = False) -> float:
    """Return the sample time of a usable recording, s."""
    _refuse(recording, _too_short(recording))
    T, faults = _sample_time(recording, sample_time, LINK if servo else LOOP)
    _refuse(recording, faults)
    _refuse(recording, [fault for role in recording.channels for fault in _column(recording, role, T)])
    return T


def remarks(recording: Recording) -> list[Note]:
    """Return remarks on a usable recording."""
    remarks = []
    for role in ("command", "force"):
        if role in recording.channels and (share := _at_limit(recording.channels[role])) > 0:
            header = recording.channels[role].header
            text = f"{header} is at its greatest value in {share:.1%} of the samples: it may be saturated"
            remarks.append(Note("remark-saturated", f"{recording.name}: {text}"))
    if recording.ignored:
        text = f"{recording.name}: columns that were not used: {', '.join(recording.ignored)}"
        remarks.append(Note("remark-unused", text))
    return remarks


def _refuse(recording: Recording, faults: list[Mistake]) -> None:
    if faults:
        raise InputError(recording.source, faults)


def _too_short(recording: Recording) -> list[Mistake]:
    """Return the fault of a recording with too few samples."""
    if len(recording) >= LEAST_SAMPLES:
        return []
    return [
        Mistake(
            "log-samples", "", f"has {len(recording)} samples; record at least {LEAST_SAMPLES}, better some seconds"
        )
    ]


def _sample_time(recording: Recording, stated: float | None, even: Evenness) -> tuple[float, list[Mistake]]:
    """Return the sample time, s, and the fault of the time column."""
    time = recording.channels.get("time")
    if time is None:
        assert stated is not None
        return stated, []
    T = float(np.median(np.diff(time.values)))
    fault = _backwards(recording, time) or _implausible(time, T, stated) or _uneven(recording, time, T, even)
    mean = float(f"{np.mean(np.diff(time.values)):.9g}")
    return mean if stated is None else stated, [fault] if fault else []


def _backwards(recording: Recording, time: Channel) -> Mistake | None:
    """Return the fault of a time column that does not increase; None if it increases."""
    back = np.flatnonzero(np.diff(time.values) <= 0)
    if not back.size:
        return None
    row = int(back[0])
    before, after = time.values[row : row + 2]
    how = "stands still" if before == after else "runs backwards"
    message = f"{how}, from {before:.9g} s to {after:.9g} s; sort or cut the log"
    return Mistake("log-samples", time.header, message, recording.first_line + 1 + row)


def _implausible(time: Channel, T: float, stated: float | None) -> Mistake | None:
    """Return the fault of a sample time that no haptic loop has, or that contradicts the stated one; else None."""
    if not SAMPLE_TIMES[0] <= T <= SAMPLE_TIMES[1]:
        likely = [unit for unit, scale in (("ms", 1e-3), ("us", 1e-6)) if 1e-5 <= T * scale <= 0.02]
        remedy = (
            f'; is it in {likely[0]}? write time = {{ column = "{time.header}", unit = "{likely[0]}" }}'
            if likely
            else ""
        )
        return Mistake(
            "log-samples", time.header, f"has a step of {T:g} s, which is no sample time of a haptic loop{remedy}"
        )
    if stated is not None and abs(T / stated - 1) > 0.01:
        return Mistake(
            "log-samples", time.header, f"has a step of {T:g} s and sample_time is {stated:g} s; correct one of them"
        )
    return None


def _uneven(recording: Recording, time: Channel, T: float, even: Evenness) -> Mistake | None:
    """Return the fault of a log whose time has gaps or too much jitter; None if its time is even."""
    steps = np.diff(time.values)
    row = int(np.argmax(np.abs(steps - T)))
    gaps = np.flatnonzero(steps > even.gap * T)
    if gaps.size:
        row, lost = int(gaps[0]), steps[gaps[0]] / T - 1
        message = f"has {gaps.size} gaps, the first of {lost:.3g} samples; cut the log there, or record without loss"
    elif (jitter := float(np.std(steps)) / T) > even.jitter:
        message = f"jitters by {jitter:.1%} of the sample time; log the time of sampling, not that of writing"
    else:
        return None
    return Mistake("log-samples", time.header, message, recording.first_line + 1 + row)


def _column(recording: Recording, role: str, T: float) -> Iterator[Mistake]:
    """Yield the faults of a column: it never changes, changes too rarely, is impossible, or stays at a limit."""
    channel = recording.channels[role]
    if role == "time":
        return
    if np.ptp(channel.values) == 0:
        # a hand may move the device while the motor is idle
        idle = role in ("command", "force") and "hand" in recording.channels
        if not idle:
            yield Mistake(
                "log-signal",
                channel.header,
                f"is {channel.values[0]:g} in every row; record it, or leave the column out",
            )
        return
    repeats = _rows_per_change(channel.values)
    if repeats > 1 and role not in SERVO_COMMANDS:
        message = (
            f"changes only in every {repeats}th row: it was recorded at a lower rate; log it at {T:g} s, or decimate"
        )
        yield Mistake("log-signal", channel.header, message)
    unit = recording.units.force.replace(" ", "")  # spelled as in headers
    if role in ("position", "handle", "position_command"):
        yield from _place(recording, channel, role, T)
    elif role == "velocity_command":
        yield from _speed(recording, channel)
    elif (peak := float(np.abs(channel.values).max())) > GREATEST_FORCE:
        yield Mistake(
            "log-signal", channel.header, f"reaches {peak:.3g} {unit}: is it in m{unit}? write its unit or scale"
        )
    elif _at_limit(channel) > SATURATED:
        yield Mistake(
            "log-signal", channel.header, f"is at its limit in {_at_limit(channel):.0%} of the rows; drive more gently"
        )


def _place(recording: Recording, channel: Channel, role: str, T: float) -> Iterator[Mistake]:
    """Yield the fault of a position: it contains counts, its motion is impossible, or it hardly moves."""
    raw = channel.values / channel.scale
    units = recording.units
    speed = float(np.abs(np.diff(channel.values)).max()) / T
    if abs(channel.scale) >= 1e-3 and np.all(raw == np.round(raw)) and np.ptp(raw) > 2 * pi:
        yield Mistake(
            "log-signal",
            channel.header,
            f"has only whole numbers, up to {np.abs(raw).max():g}: counts? write scale = {units.position} per count",
        )
    elif speed > SPEEDS[recording.rotary]:
        yield Mistake(
            "log-signal",
            channel.header,
            f"moves at up to {speed:.3g} {units.speed}: is it in m{units.position}, or not a position? write its unit "
            "or scale",
        )
    elif role == "position":
        steps = np.abs(np.diff(channel.values))
        quantum = channel.quantum or float(steps[steps > 0].min())
        if np.ptp(channel.values) < FEW_STEPS * quantum:
            message = f"moves by {np.ptp(channel.values) / quantum:.3g} of its resolution {quantum:g}; move it further"
            yield Mistake("log-signal", channel.header, message)


def _speed(recording: Recording, channel: Channel) -> Iterator[Mistake]:
    """Yield the fault of a commanded velocity that no device has."""
    peak, unit = float(np.abs(channel.values).max()), recording.units.speed
    if peak > SPEEDS[recording.rotary]:
        yield Mistake(
            "log-signal", channel.header, f"reaches {peak:.3g} {unit}: is it in m{unit}? write its unit or scale"
        )


def _rows_per_change(values: Floats) -> int:
    """Return the greatest number of rows of which all distances between changes are multiples; 1 with fewer than 50
    changes."""
    changes = np.flatnonzero(np.diff(values))
    if changes.size < 50:
        return 1
    apart = np.diff(changes)
    return int(np.gcd.reduce(apart))


def _at_limit(channel: Channel) -> float:
    """Return the share of samples that are at the limit of the column."""
    size = np.abs(channel.values)
    limit = channel.limit if channel.limit is not None else float(size.max())
    at = size >= limit * (1 - 1e-9)
    if channel.limit is None:
        at[1:-1] &= at[:-2] | at[2:]
        if at.sum() < 3:
            return 0.0
    return float(at.mean())
