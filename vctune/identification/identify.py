"""From recordings to a device, its box, and what is known of each number: the way through this package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from vctune.document.codes import Note
from vctune.document.errors import InputError
from vctune.document.log import LogMap
from vctune.document.recording import Recording
from vctune.identification.box import DELAY_FLOOR, Bounded, Estimate, box
from vctune.identification.checks import check, remarks
from vctune.identification.drive_fit import fit_drive
from vctune.identification.fit import fit_response
from vctune.identification.friction import FrictionFound
from vctune.identification.motion_study import MotionStudy, motion_study
from vctune.identification.periodic_study import PeriodicStudy, behind_force, periodic_estimates
from vctune.identification.response import response
from vctune.identification.unmodelled import distances, envelope
from vctune.model.device import Actuator, Device, ForceSensor, Structure, VelocityEstimate

Progress = Callable[[str], None]
WEAK = 0.5
"""Half-width of a delay, as a share of it, from which on it is said to be weak."""


@dataclass(frozen=True, slots=True)
class RecordStudy:
    """A recording and what came of it: one of the two studies.

    Attributes
    ----------
    recording : as it was read
    sample_time : s
    motion, periodic : of any motion, or of a periodic excitation; None for the other
    remarks : what to know of the recording
    """

    recording: Recording
    sample_time: float
    motion: MotionStudy | None
    periodic: PeriodicStudy | None
    remarks: tuple[Note, ...]


@dataclass(frozen=True, slots=True)
class Identified:
    """A device and how well it is known.

    Attributes
    ----------
    name : of the device
    device : in the middle of the box
    bounds : the box
    unmodelled : (Hz, radius) of what no device of the box has; none without a periodic recording
    distances : relative, of each line to the nearest device of the box, for each periodic record in their order
    friction : for the simulation; None where none was found
    force_noise : of a sample of the sensed force, N; None where none was recorded
    records : one for each recording
    remarks : what the recordings do not tell, and what was done about it
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
        """Return a number of the device with its interval, by its key; None where nothing was found of it."""
        return next((each for each in self.bounds if each.key == key), None)


def identify(recordings: Sequence[Recording], known: LogMap, name: str, progress: Progress) -> Identified:
    """Identify a device.

    Parameters
    ----------
    recordings : at least one, all of the same device
    known : what the user says of them
    name : of the device
    progress : told the stage of the work

    Returns
    -------
    Identified
        The device, its box, and what the recordings do not tell; SI units and hertz.

    Raises
    ------
    InputError
        If a recording cannot be used, says nothing, or the sample times differ.
    """
    times = [check(recording, known.document.sample_time) for recording in recordings]
    _same_sample_time(recordings, times)
    actuator = _actuator(known)
    studies = []
    for recording, T in zip(recordings, times, strict=True):
        progress(f"fitting {recording.source}")
        studies.append(_study(recording, T, actuator, known))
    estimates = [estimate for study in studies for estimate in _estimates(study, times[0])]
    estimates, said = _with_known(estimates, known, times[0], recordings)
    bounds = box(estimates, times[0])
    _check_delay(bounds, recordings[0], times[0])
    device = _device(bounds, known, times[0])
    progress("comparing lines with the box")
    found = [_line_distances(study, device, bounds) for study in studies if study.periodic is not None]
    return Identified(
        name=name,
        device=device,
        bounds=bounds,
        unmodelled=_unmodelled(studies, found),
        distances=tuple(found),
        friction=_friction(studies),
        force_noise=next((s.motion.force_noise for s in studies if s.motion and s.motion.force_noise), None),
        records=tuple(studies),
        remarks=(
            *said,
            *_remarks(studies, bounds, lag_known=actuator is not None or known.document.device.delay is not None),
        ),
    )


def _same_sample_time(recordings: Sequence[Recording], times: Sequence[float]) -> None:
    for recording, T in zip(recordings, times, strict=True):
        if abs(T / times[0] - 1) > 1e-3:
            message = f"was sampled every {T:g} s, and {recordings[0].source} every {times[0]:g} s; identify them apart"
            raise InputError.of(recording.source, "log-samples", message)


def _actuator(known: LogMap) -> Actuator | None:
    stated = known.document.device.actuator
    return None if stated is None else Actuator(stated.bandwidth_hz, stated.order)


def _study(recording: Recording, T: float, actuator: Actuator | None, known: LogMap) -> RecordStudy:
    said = tuple(remarks(recording))
    measured = None if "hand" in recording.channels else response(recording, T)
    if measured is None:
        return RecordStudy(recording, T, motion_study(recording, T, actuator, known), None, said)
    fit, candidates = fit_response(measured, actuator)
    drive = None if measured.drive is None else fit_drive(measured.drive, T)
    return RecordStudy(recording, T, None, PeriodicStudy(measured, fit, tuple(candidates), drive), said)


def _estimates(study: RecordStudy, T: float) -> list[Estimate]:
    source = study.recording.name
    if study.motion is not None:
        return study.motion.estimates(source)
    assert study.periodic is not None
    return periodic_estimates(study.periodic, source, T)


def _with_known(
    estimates: list[Estimate], known: LogMap, T: float, recordings: Sequence[Recording]
) -> tuple[list[Estimate], list[Note]]:
    """Return the estimates with a delay that the user knows in place of what was found of it."""
    stated = known.document.device
    if stated.delay is not None:
        others = [each for each in estimates if each.key != "delay"]
        half = max(stated.delay_uncertainty, DELAY_FLOOR * T)
        text = f"the delay is the stated one, {stated.delay:g} s, within {half:g} s"
        told = Estimate("delay", stated.delay, 0.0, known.source, (half, half), stated=True)
        return [*others, told], [Note("remark-stated-delay", text)]
    if not any(each.key == "delay" for each in estimates):
        message = "the command never moves, so no log tells the delay; write device.delay, and delay_uncertainty"
        raise InputError.of(recordings[0].source, "log-unexplained", message, key="device.delay")
    return estimates, []


def _check_delay(bounds: Sequence[Bounded], recording: Recording, T: float) -> None:
    delay = next(each for each in bounds if each.key == "delay")
    latest, name = max(each.value for each in delay.estimates), recording.units.force_name
    widest = 4 * max(each.sigma for each in delay.estimates)
    if latest + widest < -0.5 * T:
        message = (
            f"the position is {-latest:.3g} s ahead of the {name}: the columns were not sampled together; shift the "
            f"{name}'s column, or log both in the same interrupt"
        )
        raise InputError.of(recording.source, "log-unexplained", message)


def _device(bounds: Sequence[Bounded], known: LogMap, T: float) -> Device:
    stated = known.document.device
    value = {each.key: each.value for each in bounds}
    actuator = _actuator(known)
    if "actuator.bandwidth_hz" in value:
        actuator = Actuator(value["actuator.bandwidth_hz"])
    structure = None
    if "structure.handle_mass" in value:
        handle, hertz, ratio = (value[f"structure.{name}"] for name in ("handle_mass", "frequency_hz", "damping_ratio"))
        structure = Structure(handle, hertz, ratio)
    sensor, estimate = stated.force_sensor, stated.velocity
    found = None
    if sensor is not None:
        found = ForceSensor(sensor.bandwidth_hz, sensor.order, sensor.delay)
    elif "force_sensor.delay" in value:
        found = ForceSensor(delay=value["force_sensor.delay"])
    velocity = None
    if estimate is not None:
        velocity = VelocityEstimate(estimate.source or "measured", estimate.filter_hz, estimate.filter_order)
    return Device(
        value["mass"], value["damping"], T, value["delay"], velocity=velocity, actuator=actuator,
        force_sensor=found, structure=structure,
    )  # fmt: skip


def _line_distances(study: RecordStudy, device: Device, bounds: Sequence[Bounded]) -> np.ndarray:
    assert study.periodic is not None
    device, bounds = behind_force(study.periodic, study.sample_time, device, bounds)
    return distances(device, bounds, study.periodic.measured, study.periodic.fit.numbers["coulomb"])


def _unmodelled(studies: Sequence[RecordStudy], found: Sequence[np.ndarray]) -> tuple[tuple[float, float], ...]:
    measured = [study.periodic.measured for study in studies if study.periodic is not None]
    if not measured:
        return ()
    hertz = np.concatenate([each.position.omega / (2 * pi) for each in measured])
    needed = np.concatenate(list(found))
    order = np.argsort(hertz, kind="stable")
    return envelope(hertz[order], needed[order])


def _friction(studies: Sequence[RecordStudy]) -> FrictionFound | None:
    """Return the friction of the recording that has the most."""
    found = [
        study.motion.friction for study in studies if study.motion is not None and study.motion.friction is not None
    ]
    for study in studies:
        if study.periodic is not None:
            fit = study.periodic.fit
            if fit.numbers["coulomb"] > 2 * fit.sigma("coulomb") > 0:
                found.append(FrictionFound(fit.numbers["coulomb"]))
    return max(found, key=lambda each: each.coulomb, default=None)


def _remarks(studies: Sequence[RecordStudy], bounds: Sequence[Bounded], *, lag_known: bool) -> list[Note]:
    """Return what the recordings do not tell; `lag_known` is whether actuator or delay are the user's."""
    said = [remark for study in studies for remark in study.remarks]
    keys = {each.key for each in bounds}
    if any(study.motion is not None for study in studies) and "actuator.bandwidth_hz" not in keys and not lag_known:
        text = "a log of motion does not tell the actuator's lag from a delay: the delay holds both"
        said.append(Note("remark-actuator-lag", text))
    delay = next(each for each in bounds if each.key == "delay")
    if delay.share > WEAK:
        text = f"the delay is hardly told: anything from {delay.low:.2g} to {delay.high:.2g} s fits"
        said.append(Note("remark-weak-delay", text))
    if "structure.handle_mass" not in keys and all(study.periodic is None for study in studies):
        text = "nothing is known above the motion's own frequencies, neither a resonance nor unmodelled"
        said.append(Note("remark-slow-motion", f"{text}: record a multisine (vctune identify --excitation)"))
    return said + [note for study in studies if study.periodic for note in _of_lines(study, study.periodic)]


def _of_lines(study: RecordStudy, periodic: PeriodicStudy) -> list[Note]:
    top = periodic.measured.position.omega[-1] / (2 * pi)
    text = f"{study.recording.name}: nothing was measured above {top:.4g} Hz, where unmodelled stays what it is"
    said = [Note("remark-highest-line", text)]
    if periodic.fit.candidate.load:
        text = (
            f"{study.recording.name}: the handle has a damping of its own, "
            f"{periodic.fit.numbers['handle_damping']:.3g} {study.recording.units.damping}, which a problem file "
            "cannot say: the intervals of both dampings hold it and the fit without it, unmodelled the rest"
        )
        said.append(Note("remark-handle-damping", text))
    return said
