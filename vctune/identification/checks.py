"""Check a recording before any fit. The message on each fault names the row, the column and a remedy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import log, log10, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import SERVO_COMMANDS, Channel, Floats, Recording
from vctune.document.text.errors import InputError, Mistake, Note

LEAST_SAMPLES = 200  # Least number of samples
MANY_SAMPLES, LEAST_SECONDS = 500, 1.0  # A log of fewer samples is at least so long
COMMANDS = ("command", *SERVO_COMMANDS)
SAMPLE_TIMES = (1e-6, 0.05)  # Range of sample times that a haptic loop can have, s
SPEEDS = {False: 30.0, True: 3000.0}  # Greatest speed of a device, m/s, or rad/s if it is rotary
GREATEST_FORCE = 1e4  # Greatest force of a haptic device, N or N m
FEW_STEPS = 30  # Least span of the motion in resolution steps
JUMP = 20.0  # Steps of a position that jumps, in neighbouring steps and in quanta
PEAK_STEPS = 10  # Greatest fall beside a rounded peak, in steps of its rounding: nine, and the rounding of its foot
SATURATED = 0.2  # Greatest permitted share of samples at a limit
ROUND_LEVELS = 30  # Least number of levels of a column that is called rounded
MOST_HELD = 10  # Most rows of a log in one of a loop that a remark takes for possible
LEVELS = 10  # Least number of steps of its resolution that a command spans, unless it jumps between a few levels


# Greatest number of samples of the loop between two rows, and greatest error of a step, in samples of the loop
MOST_SKIPPED, EXACT = 8, 0.02
# Greatest deviation of a step and length above which a sample is missing, in sample times: for a loop that an interrupt
# runs, and for the communication link of a robot
LOOP, LINK = (0.05, 1.5), (0.25, 1.9)


def usable(recording: Recording, sample_time: float | None, *, servo: bool) -> Recording:
    """Return the longest stretch of a log without a gap or a step back, on even rows, and only those of the loop."""
    even = on_even_rows(recording, servo=servo)
    if "time" not in even.channels or len(even) < LEAST_SAMPLES:
        return even
    steps = np.diff(even.channels["time"].values)
    T = float(np.median(steps))
    faults = np.flatnonzero((steps <= 0) | (steps > (LINK if servo else LOOP)[1] * T))
    ends = np.concatenate([[0], faults + 1, [len(even)]])
    at = int(np.argmax(np.diff(ends)))
    first, end = int(ends[at]), int(ends[at + 1])
    if faults.size and end - first >= LEAST_SAMPLES:
        lines = [recording.first_line + row for row in (first, end - 1)]
        text = f"{recording.name}: its time has {faults.size} gaps or steps back; lines {lines[0]} to {lines[1]}, "
        note = Note("remark-cut", f"{text}{end - first} of {len(even)} rows, are the longest part without one")
        part = replace(_rows(recording, slice(first, end)), first_line=lines[0], notes=(*recording.notes, note))
        even = on_even_rows(part, servo=servo)
    return even if sample_time is None else _rows_of_loop(even, sample_time, T)


def _rows(recording: Recording, rows: slice) -> Recording:
    channels = {role: replace(each, values=each.values[rows]) for role, each in recording.channels.items()}
    return replace(recording, channels=channels)


def _rows_of_loop(recording: Recording, sample_time: float, T: float) -> Recording:
    """Return the rows in which a loop that is slower than its log has written its command; all if it is not."""
    every = round(sample_time / T)
    command = next((recording.channels[role] for role in COMMANDS if role in recording.channels), None)
    if every < 2 or command is None or abs(sample_time / (every * T) - 1) > EXACT / every:
        return recording
    written = (np.flatnonzero(np.diff(command.values)) + 1) % every
    if not written.size or np.any(written != written[0]):
        return recording
    text = f"{recording.name}: {command.header} changes in every {every}th row only, when a loop of {sample_time:g} s "
    notes = (*recording.notes, Note("remark-finer", f"{text}writes it: these rows are used"))
    return replace(_rows(recording, slice(int(written[0]), None, every)), notes=notes)


def on_even_rows(recording: Recording, *, servo: bool) -> Recording:
    """Return a log on even rows: those of a steady rate, if its times lie within a third of a row of them; those of a
    faster loop, if its times are exact, each step a few samples of that loop; or those of a link that wanders.

    A position between two rows is a cubic's, a force is linear, and a velocity command is held. Any other log stays as
    it is.
    """
    time = recording.channels["time"].values if "time" in recording.channels else np.zeros(0)
    if len(time) < LEAST_SAMPLES or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
        return recording
    steps, n = np.diff(time), time.size
    T, base = float(np.polyfit(np.arange(n), time, 1)[0]), None if servo else _common_step(steps)
    if base is not None and np.ptp(steps) >= 0.5 * base and steps.max() <= MOST_SKIPPED * base:
        even = time[0] + base * np.arange(round(float(time[-1] - time[0]) / base) + 1)
    else:
        off = time - time[0] - T * np.arange(n)
        if np.ptp(off) <= 2 * T / 3:
            T = float(f"{T:.{int(1.5 * log10(n))}g}") if np.ptp(off) > EXACT * T else T  # jitter hides further digits
            even = time[0] + float(off.max() + off.min()) / 2 + T * np.arange(n)
            channels = {**recording.channels, "time": replace(recording.channels["time"], values=even)}
            return replace(recording, channels=channels)
        if not servo or np.std(steps) > LINK[0] * T or steps.max() > LINK[1] * T:
            return recording
        even = np.linspace(time[0], time[-1], n)
        T = float(even[1] - even[0])
    from scipy.interpolate import CubicSpline

    channels = {}
    for role, channel in recording.channels.items():
        smooth = role in ("position", "handle", "velocity")
        values = CubicSpline(time, channel.values)(even) if smooth else np.interp(even, time, channel.values)
        if role == "velocity_command":
            path = np.append(0.0, np.cumsum(channel.values[:-1] * steps))
            values = np.diff(np.interp(even, time, path), append=path[-1] + T * channel.values[-1]) / T
        quantum = _step(channel) if smooth else channel.quantum  # which no longer shows between the rows
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
    """Return the time between the rows of a usable recording, s: the stated sample time, unless its loop is faster."""
    if recording.is_response and sample_time is not None:
        return sample_time
    if len(recording) < LEAST_SAMPLES:
        message = f"has {len(recording)} samples; record at least {LEAST_SAMPLES}, better some seconds"
        raise InputError.of(recording.source, "log-samples", message)
    time, T = recording.channels.get("time"), sample_time
    if time is not None:
        step, mean = float(np.median(np.diff(time.values))), float(f"{np.mean(np.diff(time.values)):.9g}")
        row, message = _fault_of_time(time, step, sample_time, LINK if servo else LOOP)
        if message:
            line = None if row is None else recording.first_line + 1 + row
            raise InputError(recording.source, [Mistake("log-samples", time.header, message, line)])
        T = mean if sample_time is None or step > 1.01 * sample_time else sample_time
    assert T is not None
    if len(recording) < MANY_SAMPLES and len(recording) * T < LEAST_SECONDS:
        text = f"has {len(recording)} samples in {len(recording) * T:.3g} s, which tell too little of a device"
        message = f"{text}; record at least {MANY_SAMPLES}, or {LEAST_SECONDS:g} s, better some seconds"
        raise InputError.of(recording.source, "log-samples", message)
    faults = [
        Mistake("log-signal", channel.header, message)
        for role, channel in recording.channels.items()
        if role != "time"
        for message in _faults_of_column(recording, role, T)
    ]
    if faults:
        raise InputError(recording.source, faults)
    return T


def remarks(recording: Recording) -> list[Note]:
    """Return remarks on a usable recording."""
    remarks = list(recording.notes)
    for role in ("command", "force"):
        if role in recording.channels and (share := _at_limit(recording.channels[role])) > 0:
            header = recording.channels[role].header
            text = f"{header} is at its greatest value in {share:.1%} of the samples: it may be saturated"
            remarks.append(Note("remark-saturated", f"{recording.name}: {text}"))
        if role in recording.channels and 1 < (rows := _rows_per_change(recording.channels[role].values)) <= MOST_HELD:
            text = (
                f"{recording.channels[role].header} changes in every {rows}th row only: if the loop is so slow, write"
            )
            remarks.append(Note("remark-held", f"{recording.name}: {text} its sample_time into a log.toml"))
    if recording.ignored:
        text = f"{recording.name}: columns that were not used: {', '.join(recording.ignored)}"
        remarks.append(Note("remark-unused", text))
    return remarks


def _fault_of_time(time: Channel, T: float, stated: float | None, even: tuple[float, float]) -> tuple[int | None, str]:
    """Return the row and the fault of a time column; "" without a fault."""
    steps = np.diff(time.values)
    back, gaps = np.flatnonzero(steps <= 0), np.flatnonzero(steps > even[1] * T)
    if back.size:
        before, after = time.values[back[0] : back[0] + 2]
        how = "stands still" if before == after else "runs backwards"
        return int(back[0]), f"{how}, from {before:.9g} s to {after:.9g} s; sort or cut the log"
    if not SAMPLE_TIMES[0] <= T <= SAMPLE_TIMES[1]:
        likely = [unit for unit, scale in (("ms", 1e-3), ("us", 1e-6)) if 1e-5 <= T * scale <= 0.02]
        remedy = f'; is it in {likely[0]}? write time = {{ column = "{time.header}", unit = "{likely[0]}" }}'
        return None, f"has a step of {T:g} s, which is no sample time of a haptic loop{remedy if likely else ''}"
    if stated is not None and T / stated < 0.99:
        text = f"has a step of {T:g} s and sample_time is {stated:g} s, and no command is held so long"
        return None, f"{text}; correct one of them, or leave sample_time out"
    if gaps.size:
        lost = f"{steps[gaps[0]] / T - 1:.3g} samples; cut the log there, or record without loss"
        return int(gaps[0]), f"has {gaps.size} gaps, the first of {lost}"
    if (jitter := float(np.std(steps)) / T) > even[0]:
        text = f"jitters by {jitter:.1%} of the sample time; log the time of sampling, not that of writing; "
        text += "if it is that of sampling, interpolate the columns onto even rows"
        return int(np.argmax(np.abs(steps - T))), text
    return None, ""


def _faults_of_column(recording: Recording, role: str, T: float) -> Iterator[str]:
    """Yield the faults of a column: it never changes, changes too rarely, is impossible, or stays at a limit."""
    channel, units = recording.channels[role], recording.units
    if np.ptp(channel.values) == 0:
        # a hand may move the device while the motor is idle
        if role not in ("command", "force") or "hand" not in recording.channels:
            yield f"is {channel.values[0]:g} in every row; record it, or leave the column out"
        return
    repeats, peak = _rows_per_change(channel.values), float(np.abs(channel.values).max())
    if role in COMMANDS:  # may be held over several rows
        yield from _faults_of_levels(channel)
    elif repeats > 1 and np.unique(channel.values).size >= LEVELS:
        yield f"changes only in every {repeats}th row: it was recorded at a lower rate; log it at {T:g} s, or decimate"
    force = units.force.replace(" ", "")  # spelled as in headers
    if role in ("position", "handle", "position_command"):
        yield from _faults_of_place(recording, channel, role, T)
    elif role == "velocity_command":
        if peak > SPEEDS[recording.rotary]:
            yield f"reaches {peak:.3g} {units.speed}: is it in m{units.speed}? write its unit or scale"
    elif peak > GREATEST_FORCE:
        yield f"reaches {peak:.3g} {force}: is it in m{force}? write its unit or scale"
    elif (share := _at_limit(channel)) > SATURATED:
        yield f"is at its limit in {share:.0%} of the rows; drive more gently"


def _faults_of_place(recording: Recording, channel: Channel, role: str, T: float) -> Iterator[str]:
    """Yield the fault of a position: it contains counts, its motion is impossible, or it hardly moves."""
    raw, steps, units = channel.values / channel.scale, np.abs(np.diff(channel.values)), recording.units
    speed, span = float(steps.max()) / T, float(np.ptp(channel.values))
    quantum = _step(channel)
    if abs(channel.scale) >= 1e-3 and np.all(raw == np.round(raw)) and np.ptp(raw) > 2 * pi:
        counts = f"up to {np.abs(raw).max():g}: counts? write scale = {units.position} per count"
        yield f"has only whole numbers, {counts}"
    elif (jumps := _jumps(steps, quantum)).size:
        row = int(jumps[0])
        jump = f"jumps by {steps[row]:.3g} {units.position} in line {recording.first_line + 1 + row}"
        yield f"{jump}, unlike before and after: were two logs joined, or counts lost? cut the log there"
    elif speed > SPEEDS[recording.rotary]:
        question = f"is it in m{units.position}, or not a position? write its unit or scale"
        yield f"moves at up to {speed:.3g} {units.speed}: {question}"
    elif role == "position" and span < FEW_STEPS * quantum:
        moved = f"moves by {span / quantum:.3g} of its resolution {quantum:g}"
        yield f"{moved}; move it further, or is it swapped with the command?"


def _jumps(steps: Floats, quantum: float) -> NDArray[np.integer]:
    """Return the steps of a position that are far greater than their neighbours, and than all others."""
    around = np.maximum(np.append(0.0, steps[:-1]), np.append(steps[1:], 0.0))
    alone = steps > JUMP * np.maximum(around, quantum)
    return np.flatnonzero(alone & (steps > JUMP / 4 * np.max(steps, where=~alone, initial=0.0)))


def _faults_of_levels(channel: Channel) -> Iterator[str]:
    """Yield the fault of a command that was rounded to a few levels, unlike one that jumps between a few."""
    moves, step = np.abs(np.diff(channel.values)), _step(channel)
    moves, levels = moves[moves > 0.5 * step], float(np.ptp(channel.values)) / step
    if 2.5 < levels < LEVELS and np.mean(moves < 1.5 * step) > 0.9:
        text = f"has too few levels, {levels + 1:.0f} in steps of {step:.3g}"
        yield f"{text}; log it before it is rounded, or move further"


def _step(channel: Channel) -> float:
    """Return the resolution of a column: the stated one, or its least step; inf if it has none."""
    moves = np.abs(np.diff(channel.values))
    return channel.quantum or float(moves[moves > 1e-9 * np.ptp(channel.values)].min(initial=np.inf))


def quantum_of(channel: Channel) -> float | None:
    """Return the resolution of a rounded column: the stated one, or the step of which all others are multiples; None of
    one that is not rounded, or that jumps between some levels."""
    if channel.quantum is not None:
        return channel.quantum
    values = np.unique(channel.values)
    span = float(values[-1] - values[0])
    steps = np.diff(values)
    least = float(steps[steps > 1e-9 * span].min(initial=np.inf))
    if values.size < ROUND_LEVELS or not ROUND_LEVELS < span / least < 1e6:
        return None
    even = np.abs(steps / least - np.round(steps / least)).max() < 0.01
    return least if even else None


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
    if channel.limit is None and np.unique(channel.values).size < LEVELS:
        return 0.0  # jumps between a few levels, as a binary sequence does
    if channel.limit is not None:
        return float((size >= channel.limit * (1 - 1e-9)).mean())
    held = _rows_per_change(channel.values)
    values = channel.values[(int(np.flatnonzero(np.diff(channel.values))[0]) + 1) % held :: held]
    size = np.abs(values)
    at = size >= size.max() * (1 - 1e-9)
    at[1:-1] &= at[:-2] | at[2:]
    edges = np.flatnonzero(np.diff(np.concatenate(([False], at, [False]))))
    for first, end in edges.reshape(-1, 2):
        if _rounded_peak(values * np.sign(values[first]), int(first), int(end), _step(channel)):
            at[first:end] = False
    return float(at.mean()) if at.sum() >= 3 else 0.0


def _rounded_peak(values: Floats, first: int, end: int, step: float) -> bool:
    """Return whether rows at the greatest value are the rounded peak of a smooth signal, not one that is cut.

    Such a peak is a parabola: within its rounding over its own length, and within nine times as much at three times
    the length. A signal that is cut falls from the limit by far more.
    """
    beside = [values[at] for at in (2 * first - end, 2 * end - first - 1) if 0 <= at < values.size]
    return bool(beside) and float(values[first] - max(beside)) <= PEAK_STEPS * step


def position_noise(channel: Channel) -> float:
    """Return the standard deviation of a position sample: the larger of its rounding and of the noise above three
    quarters of the Nyquist frequency."""
    third, least = np.diff(channel.values, 3), _step(channel)
    rounding = least / sqrt(12) if np.isfinite(least) else 0.0
    spectrum = np.abs(np.fft.rfft(third * np.hanning(third.size))) ** 2
    theta = np.linspace(0, np.pi, spectrum.size)
    top = spectrum[-spectrum.size // 4 :] / (2 * np.sin(theta[-spectrum.size // 4 :] / 2)) ** 6
    return max(rounding, sqrt(float(np.median(top)) / log(2) / (0.375 * third.size)))
