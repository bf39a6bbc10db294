"""Identify a device, its box, and the source of each number from recordings. This is the main path of the package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import Recording
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import Bounded, box
from vctune.identification.checks import check
from vctune.identification.known import (
    SENSOR,
    check_known,
    known_parts,
    known_sensor,
    with_known,
)
from vctune.identification.motion.friction_fit import FrictionFound
from vctune.identification.readable import readable
from vctune.identification.record_study import RecordStudy, record_study
from vctune.identification.remarks import what_is_not_told
from vctune.identification.response.periodic_study import behind_force
from vctune.identification.response.unmodelled import distances, envelope
from vctune.identification.servo.servo_study import likelier_order
from vctune.identification.servo.servo_unmodelled import off_other_order, servo_distances
from vctune.model.device import Device
from vctune.model.parts import PARTS, Servo

Progress = Callable[[str], None]
LEAST_LINES = 2
"""Least number of frequencies from which radii can be interpolated."""


@dataclass(frozen=True, slots=True)
class Identified:
    """A device, with the uncertainty of its numbers.

    Attributes
    ----------
    name : name of the device
    device : device at the centre of the box
    bounds : the box, one interval for each number
    unmodelled : points (Hz, radius) of a disc that covers what no device of the box explains; empty if the recordings
        show only slow motion
    distances : relative distance of each line or band from the nearest device of the box, for each recording that has
        them
    friction : friction for the simulation; None if none was found
    force_noise : standard deviation of the noise in a sample of the sensed force, N; None if no force was recorded
    records : one study for each recording
    remarks : remarks on what the recordings do not show
    """

    name: str
    device: Device
    bounds: tuple[Bounded, ...]
    unmodelled: tuple[tuple[float, float], ...]
    distances: tuple[np.ndarray, ...]
    friction: FrictionFound | None
    force_noise: float | None
    records: tuple[RecordStudy, ...]
    remarks: tuple[Note, ...]

    def bounded(self, key: str) -> Bounded | None:
        """Return a number of the device with its interval, by its key; None if it was not identified."""
        return next((each for each in self.bounds if each.key == key), None)


def identify(recordings: Sequence[Recording], known: LogMap, name: str, progress: Progress) -> Identified:
    """Identify a device.

    Parameters
    ----------
    recordings : recordings of one device, at least one
    known : statements of the user about the recordings
    name : name of the device
    progress : function that receives the current stage

    Returns
    -------
    Identified
        The device, its box, and remarks; SI units and hertz.

    Raises
    ------
    InputError
        If a recording cannot be used or has no information, or if the sample times differ.
    """
    times = [check(recording, known.document.sample_time, servo=known.servo) for recording in recordings]
    T = times[0]
    _same_sample_time(recordings, times)
    check_known(known, T)
    studies = []
    for recording, step in zip(recordings, times, strict=True):
        progress(f"fitting {recording.source}")
        studies.append(record_study(recording, step, known))
    found_by_all = [estimate for study in studies for estimate in study.estimates]
    estimates, said = with_known(found_by_all, known, T, recordings)
    bounds = readable(box(estimates, T), recordings[0], T)
    device = _servo(bounds, known, T, studies) if known.servo else _device(bounds, known, T)
    progress("comparing the response with the box")
    found = [_line_distances(study, device, bounds) for study in studies if study.motion is None]
    return Identified(
        name=name,
        device=device,
        bounds=bounds,
        unmodelled=_unmodelled(studies, found, device, bounds),
        distances=tuple(found),
        friction=_friction(studies),
        force_noise=next((s.motion.force_noise for s in studies if s.motion and s.motion.force_noise), None),
        records=tuple(studies),
        remarks=(*said, *what_is_not_told(studies, bounds, known)),
    )


def _same_sample_time(recordings: Sequence[Recording], times: Sequence[float]) -> None:
    for recording, T in zip(recordings, times, strict=True):
        if abs(T / times[0] - 1) > 1e-3:
            message = f"was sampled every {T:g} s, and {recordings[0].source} every {times[0]:g} s; identify them apart"
            raise InputError.of(recording.source, "log-samples", message)


def _device(bounds: Sequence[Bounded], known: LogMap, T: float) -> Device:
    value = {each.key: each.value for each in bounds}
    parts: dict[str, Any] = {}
    for key, part in PARTS.items():
        found = {each.name: value[at] for each in part.numbers if (at := f"{key}.{each.name}") in value}
        parts |= {key: part.record(**found)} if found else {}
    return Device(value["mass"], value["damping"], T, value["delay"], **(parts | known_parts(known)))


def _servo(bounds: Sequence[Bounded], known: LogMap, T: float, studies: Sequence[RecordStudy]) -> Device:
    """Return the servo at the centre of the box. Its order is the likeliest one over all recordings."""
    value, found = {each.key: each.value for each in bounds}, [each.servo for each in studies if each.servo is not None]
    command: Literal["velocity", "position"] = "position" if found[0].seen.is_position else "velocity"
    servo = Servo(value["servo.delay"], value["servo.bandwidth_hz"], likelier_order(found), command)
    parts: dict[str, Any] = {SENSOR: known_sensor(known), "servo": servo}
    return Device(1.0, 0.0, T, display="servo", **parts)


def _line_distances(study: RecordStudy, device: Device, bounds: Sequence[Bounded]) -> np.ndarray:
    if study.servo is not None:
        return servo_distances(device, bounds, study.servo)
    assert study.periodic is not None
    device, bounds = behind_force(study.periodic, study.sample_time, device, bounds)
    return distances(device, bounds, study.periodic.measured, study.periodic.fit.numbers["coulomb"])


def _unmodelled(
    studies: Sequence[RecordStudy], found: Sequence[np.ndarray], device: Device, bounds: Sequence[Bounded]
) -> tuple[tuple[float, float], ...]:
    measured = [study.measured_hz for study in studies if study.motion is None]
    pairs = list(zip(measured, found, strict=True))
    pairs += [
        off_other_order(device, bounds, study.servo)
        for study in studies
        if study.servo is not None and not study.servo.told
    ]
    hertz, needed = (np.concatenate([each[i] for each in pairs] or [np.zeros(0)]) for i in (0, 1))
    if hertz.size < LEAST_LINES:
        return ()
    order = np.argsort(hertz, kind="stable")
    return envelope(hertz[order], needed[order])


def _friction(studies: Sequence[RecordStudy]) -> FrictionFound | None:
    """Return the greatest friction that a recording shows."""
    found = [
        study.motion.friction for study in studies if study.motion is not None and study.motion.friction is not None
    ]
    for study in studies:
        if study.periodic is not None:
            fit = study.periodic.fit
            if fit.numbers["coulomb"] > 2 * fit.sigma("coulomb") > 0:
                found.append(FrictionFound(fit.numbers["coulomb"]))
    return max(found, key=lambda each: each.coulomb, default=None)
