"""What a fit of one recording returns, whatever was recorded, and the disc around the devices of the box (README,
section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import (
    Bounded,
    CandidateRecord,
    Estimate,
    NumberRecord,
    RecordingRecord,
)
from vctune.document.text.errors import Note
from vctune.identification.stepped import Complex, Drive, numbers_of, response
from vctune.model.device import Device

TRIED = 600  # Number of devices of the box with which a line is compared
LEAST_RADII, KNOTS = 2, 24  # Least and greatest number of frequencies at which the radius is stated
LEAST = 1e-6  # Least radius, because the logarithmic axes have no 0
MARGIN = 1 + 5e-6  # Relative allowance for the rounding of the numbers in the file


@dataclass(frozen=True, slots=True)
class Lines:
    """A response at some frequencies, and that of a device there."""

    hertz: Floats
    ratio: Complex  # measured response without the effect of Coulomb friction
    spread: Floats  # relative standard deviation
    fitted: Complex
    drive: Drive  # how the device was moved
    delay: Bounded | None = None  # delay behind the recorded force, if the response is one to this force


@dataclass(frozen=True, slots=True)
class Curves:
    """A measured signal over time, and the fit of it."""

    time: Floats
    measured: Floats
    fitted: Floats


@dataclass(frozen=True, slots=True)
class Study:
    """A recording with its fit."""

    recording: Recording
    record: RecordingRecord  # what identification.json and the page say of it
    estimates: list[Estimate]  # of the parameters that a problem file states
    lines: list[Lines] = field(default_factory=list)
    curves: Curves | None = None
    remarks: list[Note] = field(default_factory=list)
    friction: float | None = None  # Coulomb friction, N; None if none was found
    force_noise: float | None = None  # standard deviation of a sample of the hand's sensed force, N
    servo_orders: dict[int, float] = field(default_factory=dict)  # -2 log likelihood by the order of a servo


# Keys of [device] by the numbers of a fit, of a mechanism and of a servo
KEYS = {
    "mass": "mass",
    "damping": "damping",
    "damping_back": "damping",
    "delay": "delay",
    "lag": "actuator.bandwidth_hz",
    "sensor_delay": "force_sensor.delay",
    "handle_mass": "structure.handle_mass",
    "frequency_hz": "structure.frequency_hz",
    "damping_ratio": "structure.damping_ratio",
}
SERVO_KEYS = {"delay": "servo.delay", "lag": "servo.bandwidth_hz"}


def number(name: str, value: float, sigma: float | None = None) -> NumberRecord:
    """Return a number of the record."""
    return NumberRecord(name=name, value=float(value), sigma=None if sigma is None else float(sigma))


def record_of(recording: Recording, sample_time: float, **found: Any) -> RecordingRecord:
    """Return the record of a recording; what the kind of fit does not have is empty."""
    found = {"derived": [], "candidates": [], "remarks": []} | found
    known: dict[str, Any] = {"source": recording.name, "sha256": recording.sha256, "samples": len(recording)}
    return RecordingRecord(**known, sample_time=sample_time, **found)


def of_orders(
    name: str, fits: Sequence[tuple[int, float, float]], *, known: bool
) -> tuple[list[CandidateRecord], list[Note]]:
    """Return the candidates of a servo, and a remark unless its order is known; `fits` are orders, costs and shares of
    the motion that is left, the likelier first."""
    best = fits[0][1]
    candidates = [
        CandidateRecord(structure=f"order {order}", chosen=i == 0, chi2=cost / best, model_error=[share])
        for i, (order, cost, share) in enumerate(fits)
    ]
    text = f"{name}: orders 1 and 2 explain it equally well: the box contains both, and unmodelled covers the rest"
    return candidates, [] if known else [Note("remark-order", text)]


def responses(lines: Lines, device: Device, bounds: Sequence[Bounded]) -> Complex:
    """Return the responses of `TRIED` devices of the box: its centre, corners at random and random devices."""
    if lines.delay is not None:  # what lies before the recorded force is not in the lines
        device = replace(device, delay=lines.delay.value, actuator=None)
        bounds = [*(each for each in bounds if each.key not in ("delay", "actuator.bandwidth_hz")), lines.delay]
    has = device.numbers()
    varied = [each for each in bounds if each.key in has]
    random = np.random.default_rng(1).uniform(-1, 1, (TRIED, len(varied)))
    random[: TRIED // 2] = np.sign(random[: TRIED // 2])
    random[0] = 0.0
    tried = [
        device.with_numbers({b.key: b.value * (1 + b.share * at) for b, at in zip(varied, row, strict=True)})
        for row in random
    ]
    order = 0 if device.servo is None else device.servo.order
    drive = replace(lines.drive, T=device.sample_time, servo=order)
    return np.array([response(drive, numbers_of(each), lines.hertz) for each in tried])


def distances(lines: Lines, device: Device, bounds: Sequence[Bounded]) -> Floats:
    """Return the relative difference of each line from the nearest device of the box."""
    return np.asarray(np.abs(lines.ratio / responses(lines, device, bounds) - 1).min(axis=0))


def covered(
    lines: Lines, device: Device, bounds: Sequence[Bounded], radii: Sequence[Sequence[float | None]]
) -> tuple[Floats, Floats]:
    """Return the least and the greatest magnitude over all responses that the file allows."""
    x, y = np.log(np.array(radii, dtype=float)).T
    radius = np.exp(np.interp(np.log(lines.hertz), x, y))
    size = np.abs(responses(lines, device, bounds))
    return size.min(axis=0) * np.maximum(1 - radius, 0.01), size.max(axis=0) * (1 + radius)


def envelope(lines: Sequence[Lines], device: Device, bounds: Sequence[Bounded]) -> list[list[float | None]]:
    """Return a few points (Hz, radius) between which, on logarithmic axes, a line lies above all distances."""
    if sum(each.hertz.size for each in lines) < LEAST_RADII:
        return []
    hertz = np.concatenate([each.hertz for each in lines])
    needed = np.concatenate([distances(each, device, bounds) for each in lines])
    measured, spaced = np.unique(hertz), np.geomspace(hertz.min(), hertz.max(), min(KNOTS, hertz.size))
    nearest = np.argmin(np.abs(np.log(measured[:, None] / spaced)), axis=0)
    knots = np.unique(np.round(measured[nearest], 6))  # no knot lies where nothing was measured
    segment = np.clip(np.searchsorted(knots, hertz, side="right") - 1, 0, knots.size - 2)
    least = np.array([needed[segment == i].max(initial=LEAST) for i in range(knots.size - 1)])
    around = np.maximum(np.append(least, LEAST), np.append(LEAST, least)) * MARGIN
    return [[float(at), float(f"{radius:.6g}")] for at, radius in zip(knots, around * MARGIN, strict=True)]
