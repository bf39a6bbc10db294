"""Figures of the identification of a servo: its motion in time, and its response in bands."""

from __future__ import annotations

from math import pi

import numpy as np
from matplotlib.figure import Figure

from vctune.document.recording import Floats
from vctune.identification.identify import Identified
from vctune.identification.record_study import RecordStudy
from vctune.identification.servo.servo_motion import Complex, positions
from vctune.identification.servo.servo_study import ServoStudy
from vctune.identification.servo.servo_unmodelled import response_of, tried_servos
from vctune.model.numbers.units import Units
from vctune.report.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    WIDTH,
    canvas,
    decades,
    frequency_axis,
    in_prefixed,
    legend_above,
)

WINDOW = 200  # Number of rows of the part of a log that the figure enlarges
MOST_POINTS = 2000  # Greatest number of drawn points of a log, up to a factor of 2


def following(studies: list[RecordStudy], units: Units) -> Figure:
    """Return the figure of the commanded, measured and fitted motion, and of the residual."""
    figure = canvas(WIDTH, 3.7 * len(studies), left=0.75, top=0.35, gaps=(0.0, 0.62))
    axes = np.atleast_1d(figure.subplots(2 * len(studies), 1))
    for (close, whole), study in zip(axes.reshape(-1, 2), studies, strict=True):
        servo = study.servo
        assert servo is not None
        servo_log, fit = servo.servo_log, servo.fit
        time, measured = servo_log.time[fit.first :], servo_log.position[fit.first :]
        made = fit.gain * _made(servo)
        made += float(np.mean(measured - made))
        left = measured - made
        middle = int(np.clip(np.argmax(np.abs(left)), WINDOW // 2, max(left.size - WINDOW // 2, WINDOW // 2)))
        shown = slice(middle - WINDOW // 2, middle + WINDOW // 2)
        told = np.concatenate([[0.0], np.cumsum(servo_log.velocity[:-1] * np.diff(servo_log.time))])[fit.first :]
        told += float(np.mean(measured - told))
        drawn, unit = in_prefixed(np.stack([told[shown], measured[shown], made[shown]]), units.position)
        labels = "commanded", f"measured, {study.recording.name}", "fit"
        for curve, line, colour, label in zip(drawn, (":", "-", "--"), (GREY, BLUE, ORANGE), labels, strict=True):
            close.plot(time[shown], curve, line, color=colour, label=label)
        close.set(ylabel=f"position, {unit}", xlabel="time, s")
        legend_above(close, 3)
        every = max(1, left.size // MOST_POINTS)
        remaining, unit = in_prefixed(left[::every], units.position)
        whole.plot(time[::every], remaining, color=GREY, linewidth=0.8)
        whole.set(ylabel=f"residual, {unit}", xlabel="time, s")
    return figure


def _made(servo: ServoStudy) -> Floats:
    fit, servo_log = servo.fit, servo.servo_log
    return positions(servo_log.time, servo_log.velocity, fit.delay.value, fit.bandwidth.value, fit.order)[fit.first :]


def servo_response(found: Identified, studies: list[RecordStudy]) -> Figure:
    """Return the figure of the response's magnitude and phase: measured in bands, of the fits, and of the box."""
    figure = canvas(WIDTH, 4.2, left=0.75, top=0.35, gaps=(0.0, 0.12))
    size, phase = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    hertz = np.concatenate([study.measured_hz for study in studies])
    axis = np.geomspace(hertz.min(), hertz.max(), 200)
    first = studies[0].servo
    assert first is not None
    responses = np.array([response_of(each, 2 * pi * axis) for each in tried_servos(found.device, found.bounds, first)])
    x, y = np.log(np.array(found.unmodelled)).T
    radius = np.exp(np.interp(np.log(axis), x, y))
    sizes, turn = np.abs(responses), np.degrees(np.arcsin(np.minimum(radius, 1.0)))
    phases = np.degrees(np.unwrap(np.angle(responses), axis=1))
    low, high = sizes.min(axis=0) * np.maximum(1 - radius, 0.01), sizes.max(axis=0) * (1 + radius)
    size.fill_between(axis, low, high, color=GREY, alpha=0.25, label="box and unmodelled")
    phase.fill_between(axis, phases.min(axis=0) - turn, phases.max(axis=0) + turn, color=GREY, alpha=0.25)
    for study, colour in zip(studies, (BLUE, GREEN, ORANGE, GREY) * len(studies), strict=False):
        servo = study.servo
        assert servo is not None
        bands = servo.bands
        amplitude, off = np.abs(bands.fitted * bands.ratio), np.degrees(np.angle(bands.ratio))
        fitted = _phase(bands.fitted, np.interp(np.log(bands.hertz), np.log(axis), phases[0]))
        size.errorbar(
            bands.hertz, amplitude, 2 * bands.spread * amplitude, fmt=".", color=colour, label=study.recording.name
        )
        size.plot(bands.hertz, np.abs(bands.fitted), color=colour, linewidth=1.0, label="fit")
        phase.errorbar(bands.hertz, fitted + off, np.degrees(2 * bands.spread), fmt=".", color=colour)
        phase.plot(bands.hertz, fitted, color=colour, linewidth=1.0)
    size.set_ylabel("velocity, measured / commanded")
    decades(size)
    phase.set_ylabel("phase, degrees")
    frequency_axis(phase, 0.9 * float(hertz.min()), 1.1 * float(hertz.max()))
    legend_above(size, 3)
    return figure


def _phase(response: Complex, near: Floats) -> Floats:
    """Return the phase of a response, degrees, that differs from a given phase by at most half a turn."""
    return np.asarray(near + np.degrees(np.angle(response * np.exp(-1j * np.radians(near)))))
