"""The response of a device to what a log contains, and the disc around the devices of the box (README, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.document.records.identification_json import Bounded
from vctune.identification.stepped import Complex, Drive, Numbers, late_rows, linear, propagators
from vctune.model.device import Device

LAGS = {1: 1.0, 2: sqrt(2)}  # Lag of a low-pass, times its angular frequency, by its order
TRIED = 600  # Number of devices of the box with which a line is compared
KNOTS = 24  # Greatest number of frequencies at which the radius is stated
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


def response(drive: Drive, numbers: Numbers, hertz: Floats) -> Complex:
    """Return the response of the motor's position, of a servo's speed, to the input.

    At the samples to a held input, or to a continuous signal if the drive is a ramp.
    """
    A, B, _ = linear(drive, numbers)
    s, T = 2j * pi * hertz, drive.T
    if drive.ramp:
        at, rate, pushed = s, s, B[:, :1] * np.exp(-s * numbers["delay"])[:, None, None]
    else:
        whole, late = late_rows(np.array([numbers["delay"]]), T)
        lengths = np.concatenate([late, T - late])
        F, G = propagators(np.stack([A, A]), np.stack([B, B]), lengths)
        at, rate, A = np.exp(s * T), (1 - np.exp(-s * T)) / T, F[1] @ F[0]
        pushed = (G[1, :, :1] + F[1] @ G[0, :, :1] / at[:, None, None]) * (at**-whole)[:, None, None]
    place = np.linalg.solve(at[:, None, None] * np.eye(len(A)) - A, pushed)[:, 0, 0]
    return np.asarray(place * rate if drive.servo else place)


def numbers_of(device: Device) -> dict[str, float]:
    """Return the numbers of a fit that a device of a problem file has."""
    if device.servo is not None:
        assert device.servo.bandwidth_hz is not None
        lag = LAGS[device.servo.order] / (2 * pi * device.servo.bandwidth_hz)
        return {"gain": 1.0, "delay": device.servo.delay, "lag": lag}
    numbers = {"mass": device.mass, "damping": device.damping, "delay": device.delay}
    if device.actuator is not None:
        numbers["lag"] = 1 / (2 * pi * device.actuator.bandwidth_hz)
    if (spring := device.structure) is not None:
        numbers |= {"handle_mass": spring.handle_mass, "frequency_hz": spring.frequency_hz}
        numbers["damping_ratio"] = spring.damping_ratio
    return numbers


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


def envelope(hertz: Floats, needed: Floats) -> list[list[float | None]]:
    """Return a few points (Hz, radius) between which, on logarithmic axes, a line lies above all required radii."""
    measured, spaced = np.unique(hertz), np.geomspace(hertz.min(), hertz.max(), min(KNOTS, hertz.size))
    nearest = np.argmin(np.abs(np.log(measured[:, None] / spaced)), axis=0)
    knots = np.unique(np.round(measured[nearest], 6))  # no knot lies where nothing was measured
    segment = np.clip(np.searchsorted(knots, hertz, side="right") - 1, 0, knots.size - 2)
    least = np.array([needed[segment == i].max(initial=LEAST) for i in range(knots.size - 1)])
    around = np.maximum(np.append(least, LEAST), np.append(LEAST, least)) * MARGIN
    return [[float(at), float(f"{radius:.6g}")] for at, radius in zip(knots, around * MARGIN, strict=True)]
