"""Identify a device, its box, and the source of each parameter from recordings. This is the main path of the
package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import Recording
from vctune.document.schema.device_contradictions import MAX_DELAY_SAMPLES
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import Bounded, box
from vctune.identification.checks import check, on_even_rows
from vctune.identification.known import (
    SENSOR,
    check_known,
    known_parts,
    known_sensor,
    with_known,
)
from vctune.identification.record_study import RecordStudy, record_study
from vctune.identification.remarks import LEAST_RADII, remarks_on_gaps
from vctune.identification.response.periodic_study import behind_force
from vctune.identification.response.unmodelled import distances, envelope
from vctune.identification.servo.servo_study import likelier_order
from vctune.identification.servo.servo_unmodelled import off_other_order, servo_distances
from vctune.model.device import Device
from vctune.model.parts import PARTS, Servo

LIGHTER = 1 - 1e-3  # Greatest permitted mass of the handle, relative to the least mass of the device


def readable(bounds: Sequence[Bounded], recording: Recording, sample_time: float) -> tuple[Bounded, ...]:
    """Return a box that the reader of problem files accepts."""
    for each in bounds:
        if each.key.endswith("delay"):
            _check_delay(each, recording, sample_time)
    masses = {each.key: each for each in bounds if each.key.endswith("mass")}
    return tuple(
        _lighter(each, masses["mass"], recording) if each.key == "structure.handle_mass" else each for each in bounds
    )


def _check_delay(delay: Bounded, recording: Recording, T: float) -> None:
    """Refuse a delay that is certainly negative, or greater than the greatest supported delay."""
    latest = max(each.value for each in delay.estimates)
    name = "command" if delay.key == "servo.delay" else recording.units.force_name
    widest = 4 * max(each.sigma for each in delay.estimates)
    remedy = f"the columns were not sampled together; shift the {name}'s column, or log both in the same interrupt"
    if delay.key in ("delay", "servo.delay") and latest + widest < -0.5 * T:
        message = f"the position is {-latest:.3g} s ahead of the {name}: {remedy}"
    elif delay.high > MAX_DELAY_SAMPLES * T > latest:
        limits = f"{max(delay.low, 0):.3g} to {delay.high:.3g} s"
        message = f"{delay.key} is not determined: {limits}; move faster, or record longer"
    elif delay.high > MAX_DELAY_SAMPLES * T:
        message = (
            f"{delay.key} is up to {delay.high:.3g} s, {delay.high / T:.3g} sample times, and at most "
            f"{MAX_DELAY_SAMPLES} are supported: {remedy}"
        )
    else:
        return
    raise InputError.of(recording.source, "log-unexplained", message)


def _lighter(handle: Bounded, mass: Bounded, recording: Recording) -> Bounded:
    """Return the mass of a handle with an interval that ends below the least mass of the device."""
    most = mass.low * LIGHTER
    if handle.high < most:
        return handle
    if handle.value >= most:
        units = recording.units
        message = (
            f"the handle's {units.mass_name}, {handle.low:.3g} to {handle.high:.3g} {units.mass}, is not told from the "
            f"device's, {mass.low:.3g} to {mass.high:.3g}: record longer, or excite more lines around the resonance"
        )
        raise InputError.of(recording.source, "log-unexplained", message)
    limits = (*handle.limits, Note("limit-handle", "lighter than the device"))
    return replace(handle, value=0.5 * (handle.low + most), high=most, limits=limits)


Progress = Callable[[str], None]
SAME_SAMPLE_TIME = 1e-3  # Greatest relative difference between the sample times of recordings of one device


@dataclass(frozen=True, slots=True)
class Identified:
    """A device, with the uncertainty of its parameters."""

    name: str  # name of the device
    device: Device  # device at the centre of the box
    bounds: tuple[Bounded, ...]  # the box, one interval for each parameter
    unmodelled: tuple[tuple[float, float], ...]
    distances: tuple[np.ndarray, ...]
    friction: float | None  # Coulomb friction for the simulation, N; None if none was found, and for a servo
    force_noise: float | None  # standard deviation of the noise in a sample of the hand's sensed force, N
    records: tuple[RecordStudy, ...]  # one study for each recording
    remarks: tuple[Note, ...]  # remarks on what the recordings do not show

    def bounded(self, key: str) -> Bounded | None:
        """Return a parameter of the device with its interval, by its key; None if it was not identified."""
        return next((bounded for bounded in self.bounds if bounded.key == key), None)


def identify(recordings: Sequence[Recording], log_map: LogMap, name: str, progress: Progress) -> Identified:
    """Identify a device."""
    if not log_map.servo:
        recordings = [on_even_rows(recording) for recording in recordings]
    times = [check(recording, log_map.document.sample_time, servo=log_map.servo) for recording in recordings]
    T = times[0]
    _same_sample_time(recordings, times)
    check_known(log_map, T)
    studies = []
    for recording, step in zip(recordings, times, strict=True):
        progress(f"fitting {recording.source}")
        studies.append(record_study(recording, step, log_map))
    all_estimates = [estimate for study in studies for estimate in study.estimates]
    estimates, remarks_on_known = with_known(all_estimates, log_map, T, recordings)
    bounds = readable(box(estimates, T), recordings[0], T)
    device = _servo(bounds, log_map, T, studies) if log_map.servo else _device(bounds, log_map, T)
    progress("comparing the response with the box")
    line_distances = [_line_distances(study, device, bounds) for study in studies if study.motion is None]
    return Identified(
        name=name,
        device=device,
        bounds=bounds,
        unmodelled=_unmodelled(studies, line_distances, device, bounds),
        distances=tuple(line_distances),
        friction=_friction(studies),
        force_noise=next((s.motion.force_noise for s in studies if s.motion and s.motion.force_noise), None),
        records=tuple(studies),
        remarks=(*remarks_on_known, *remarks_on_gaps(studies, bounds, log_map)),
    )


def _same_sample_time(recordings: Sequence[Recording], times: Sequence[float]) -> None:
    """Refuse recordings whose sample times differ by more than the clocks of two runs can differ."""
    for recording, T in zip(recordings, times, strict=True):
        if abs(T / times[0] - 1) > SAME_SAMPLE_TIME:
            message = f"was sampled every {T:g} s, and {recordings[0].source} every {times[0]:g} s; identify them apart"
            raise InputError.of(recording.source, "log-samples", message)


def _device(bounds: Sequence[Bounded], log_map: LogMap, T: float) -> Device:
    """Return the device at the centre of the box, with the parts that the user states."""
    value = {bounded.key: bounded.value for bounded in bounds}
    parts: dict[str, Any] = {}
    for key, part in PARTS.items():
        numbers = {number.name: value[path] for number in part.numbers if (path := f"{key}.{number.name}") in value}
        parts |= {key: part.record(**numbers)} if numbers else {}
    return Device(value["mass"], value["damping"], T, value["delay"], **(parts | known_parts(log_map)))


def _servo(bounds: Sequence[Bounded], log_map: LogMap, T: float, studies: Sequence[RecordStudy]) -> Device:
    """Return the servo at the centre of the box. The order of the servo is the likeliest order over all recordings."""
    value = {bounded.key: bounded.value for bounded in bounds}
    servo_studies = [study.servo for study in studies if study.servo is not None]
    command: Literal["velocity", "position"] = "position" if servo_studies[0].servo_log.is_position else "velocity"
    servo = Servo(value["servo.delay"], value["servo.bandwidth_hz"], likelier_order(servo_studies), command)
    parts: dict[str, Any] = {SENSOR: known_sensor(log_map), "servo": servo}
    return Device(1.0, 0.0, T, display="servo", **parts)


def _line_distances(study: RecordStudy, device: Device, bounds: Sequence[Bounded]) -> np.ndarray:
    """Return the relative difference of each line, or of each band of a servo, from the nearest device of the box."""
    if study.servo is not None:
        return servo_distances(device, bounds, study.servo)
    assert study.periodic is not None
    device, bounds = behind_force(study.periodic, study.sample_time, device, bounds)
    return distances(device, bounds, study.periodic.measured, study.periodic.fit.numbers["coulomb"])


def _unmodelled(
    studies: Sequence[RecordStudy], line_distances: Sequence[np.ndarray], device: Device, bounds: Sequence[Bounded]
) -> tuple[tuple[float, float], ...]:
    """Return the radii of unmodelled: the envelope of the distances of all lines and of the servo with the other
    order."""
    measured = [study.measured_hz for study in studies if study.motion is None]
    pairs = list(zip(measured, line_distances, strict=True))
    pairs += [
        off_other_order(device, bounds, study.servo)
        for study in studies
        if study.servo is not None and not study.servo.order_is_known
    ]
    hertz, distances = (np.concatenate([pair[i] for pair in pairs] or [np.zeros(0)]) for i in (0, 1))
    if hertz.size < LEAST_RADII:
        return ()
    order = np.argsort(hertz, kind="stable")
    return envelope(hertz[order], distances[order])


def _friction(studies: Sequence[RecordStudy]) -> float | None:
    """Return the greatest Coulomb friction that a recording shows; None if no recording shows friction."""
    frictions = [
        study.motion.friction for study in studies if study.motion is not None and study.motion.friction is not None
    ]
    for study in studies:
        if study.periodic is not None:
            fit = study.periodic.fit
            if fit.numbers["coulomb"] > 2 * fit.sigma("coulomb") > 0:
                frictions.append(fit.numbers["coulomb"])
    return max(frictions, default=None)
