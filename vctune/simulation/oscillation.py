"""Tell from a trace whether the handle is calm, settles after a disturbance, or goes on oscillating."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from vctune.document.records.part import Nullable, RecordPart
from vctune.model.numbers.arithmetic import Floats

if TYPE_CHECKING:
    from vctune.simulation.run import Traces

SLOW = 20.0  # Frequency, in cycles of the hand's motion, up to which a motion is the hand's own
LEAST = 1e-3  # Least size of an oscillation, as a share of the hand's travel
COUNTS = 2.0  # Least size of an oscillation, in counts of the encoder
SOME, MANY = 3, 16  # Number of large turns in a row of a disturbance, and of an oscillation that goes on
BETWEEN = 8  # Number of times per sample at which a trace is interpolated, so that its turns show
SHAKES = 1e-3  # Share of a count, and of the greatest command, within which a handle in a hand that stays is at rest
LASTS = 0.8  # Share of its size that such an oscillation keeps from its first quarter to its last


class Motion(RecordPart):
    """What the handle does beside the hand's own motion: it is calm, settles after a disturbance, or buzzes; in a hand
    that stays it rests, settles or buzzes."""

    kind: Literal["calm", "settles", "buzzes", "rests"]
    frequency_hz: Nullable  # of an oscillation that goes on
    amplitude_m: Nullable  # its size, half of the distance between its turns
    rests: bool | None  # whether the handle comes to rest; null in a hand that moves


def motion_of(position: Floats, sample_time: float, cycle: float, travel: float, count: float) -> Motion:
    """Return what a trace of the handle's position does; `cycle` is the hand's time to and fro, s, `count` one of the
    encoder, m."""
    corner = 2 * SLOW * sample_time / cycle  # over the Nyquist frequency
    if len(position) < 64 or corner >= 0.5:
        return _moving("calm")
    from scipy.signal import butter, sosfiltfilt

    quick = sosfiltfilt(butter(2, corner, "highpass", output="sos"), position)
    least = max(LEAST * travel, COUNTS * count)
    runs = _runs(quick, least)
    lasting = [run[first : first + MANY] for run in runs for first in range(len(run) - MANY + 1)]
    lasting = [turns for turns in lasting if _lasts(np.abs(quick[turns]))]
    if not lasting:
        return _moving("settles" if any(len(run) >= SOME for run in runs) else "calm")
    turns = max(lasting, key=lambda turns: float(np.median(np.abs(quick[turns]))))
    hz = (MANY - 1) / (2 * sample_time * (turns[-1] - turns[0]))
    return _moving("buzzes", float(hz), float(np.median(np.abs(quick[turns]))))


def _moving(kind: Literal["calm", "settles", "buzzes"], hz: float | None = None, size: float | None = None) -> Motion:
    """Return what a handle does in a hand that moves."""
    return Motion(kind=kind, frequency_hz=hz, amplitude_m=size, rests=None)


def at_rest(traces: Traces, last: NDArray[np.bool_], travel: float, count: float) -> Motion:
    """Return what a handle does in a hand that stays, from the last part of a run; `count` is one of the encoder, m.

    It rests if it does not move by more than `SHAKES` of a count, or of a share of the travel, and its motor's command
    does not change either: the command answers each step of the encoder, however little the handle moves."""
    from scipy.interpolate import CubicHermiteSpline

    time, motor = traces.time[last], traces.motor[last]
    within = np.linspace(time[0], time[-1], BETWEEN * (len(time) - 1) + 1)
    position = CubicHermiteSpline(time, traces.position[last], traces.velocity[last])(within)
    amplitude, commanded = float(np.ptp(position)) / 2, float(np.ptp(motor))
    if amplitude <= SHAKES * (count or LEAST * travel) and commanded <= SHAKES * float(np.abs(traces.motor).max()):
        return Motion(kind="rests", frequency_hz=None, amplitude_m=amplitude, rests=True)
    halves = [float(np.ptp(half)) for half in np.array_split(position, 2)]
    kind: Literal["settles", "buzzes"] = "buzzes" if halves[1] >= LASTS * halves[0] else "settles"
    hz = strongest_hz(traces.position[last], time[1] - time[0])
    return Motion(kind=kind, frequency_hz=hz, amplitude_m=amplitude, rests=False)


def strongest_hz(position: Floats, sample_time: float) -> float:
    """Return the strongest frequency of a trace, Hz, between the lines of its spectrum."""
    waved = (position - position.mean()) * np.hanning(len(position))
    padded = 4 * len(position)
    spectrum = np.abs(np.fft.rfft(waved, padded))
    return float((1 + np.argmax(spectrum[1:])) / (padded * sample_time))


def _runs(quick: Floats, least: float) -> list[NDArray[np.intp]]:
    """Return the samples of the turns in a row that are larger than a least size."""
    ends = np.flatnonzero(np.signbit(quick[1:]) != np.signbit(quick[:-1])) + 1
    parts = [part for part in np.split(np.arange(len(quick)), ends) if part.size]
    turns = np.array([part[np.argmax(np.abs(quick[part]))] for part in parts])
    large = np.abs(quick[turns]) > least
    breaks = np.flatnonzero(large[1:] != large[:-1]) + 1
    return [run for run in np.split(turns, breaks) if abs(quick[run[0]]) > least]


def _lasts(sizes: Floats) -> bool:
    """Return whether an oscillation keeps its size, from the sizes of its turns."""
    quarter = len(sizes) // 4
    return bool(np.median(sizes[-quarter:]) >= LASTS * np.median(sizes[:quarter]))
